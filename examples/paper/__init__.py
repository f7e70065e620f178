"""The figures and claims of "Investigation into 2D Gaussian Splatting for Image Representation".

settings -> photos, engine -> schedules, windows, losses, shapes, table -> claims -> plots, page
"""
