"""gauss2svg turns photos into SVGs of fitted 2D Gaussians, and measures what a renderer draws."""

import lazy_loader

# Each public name is imported when it is first used, so that `import gauss2svg` takes only
# milliseconds. __init__.pyi lists the public names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
# The studio needs packages of an optional extra, so `import *` must not import it.
__all__.remove("studio")  # pyright: ignore[reportUnsupportedDunderAll] (pyright reads the stub)
