"""The model: a canvas, a background and an ordered list of Gaussians with their falloff."""

import lazy_loader

# Scenes load on first use, with NumPy, because options need only the names of blends.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

OVER, ADD = "over", "add"
BLENDS = (OVER, ADD)
