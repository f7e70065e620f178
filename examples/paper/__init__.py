"""The figures and claims of "Investigation into 2D Gaussian Splatting for Image Representation".

settings -> photos, engine -> schedules, windows, losses, shapes, table -> claims -> plots, page
"""

# Before torch: it loads OpenMP, which then no longer hears that threads are to sleep while they
# wait. Beside a busy program a fit of 0.1 s took up to 3 s.
import gauss2svg.render  # noqa: F401
