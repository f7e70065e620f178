"""The model: a canvas, a background and an ordered list of Gaussians with their falloff."""

import lazy_loader

# The names of the stub file, such as Scene, need NumPy. They are imported only when they are first
# used. So modules that need only the names of the blends, such as the options, load without NumPy.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

OVER, ADD = "over", "add"
BLENDS = (OVER, ADD)
