"""gauss2svg: photos as SVGs of fitted 2D Gaussians, measured by a real renderer."""

import lazy_loader

# Names load on first use, so `import gauss2svg` takes milliseconds. __init__.pyi lists them.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
# The studio is an optional extra, so `import *` must not load it.
__all__.remove("studio")  # pyright: ignore[reportUnsupportedDunderAll] (pyright reads the stub)
