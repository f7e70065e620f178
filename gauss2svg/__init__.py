"""gauss2svg: photos as SVG, fitted by 2D Gaussians and measured by a real renderer."""

import lazy_loader

# Names load on first use, so that `import gauss2svg` costs milliseconds; __init__.pyi has them.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
# An extra, which `import *` must not load.
__all__.remove("studio")  # pyright: ignore[reportUnsupportedDunderAll] (the stub is what it reads)
