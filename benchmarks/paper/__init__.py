"""The figures and claims of "Investigation into 2D Gaussian Splatting for Image Representation".

settings -> photos, engine -> schedules, kernel_window, losses, shapes, table -> claims -> plots,
page
"""

# Before torch, which loads OpenMP: after that the policy by which waiting threads sleep is ignored,
# and beside a busy program a fit of 0.1 s took up to 3 s.
import gauss2svg.render  # noqa: F401
