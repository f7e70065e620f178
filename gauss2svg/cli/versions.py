"""The text that --version prints, which a fault report needs.

A package is imported only while its version is read, because a package that cannot be imported may
be the fault that is reported.
"""

from __future__ import annotations

import platform
import re
import textwrap
from collections.abc import Callable
from importlib.metadata import distributions
from typing import get_args

from gauss2svg.options import Renderer
from gauss2svg.version import __version__

_WIDTH = 79  # characters in a line, so that no terminal breaks it elsewhere
# The packages that decode, fit and measure. Renderers have a line of their own.
_PACKAGES = (
    "numpy", "scipy", "numba", "scikit-image", "pillow", "pyvips", "pi-heif", "svgwrite", "torch",
    "ssimulacra2", "flip-evaluator",
)  # fmt: skip


def versions() -> str:
    """Return the versions of the program, its packages and its renderers, and the machine."""
    renderers = (_or_reason(name, _renderer) for name in get_args(Renderer))
    installed = {dist.name.lower().replace("_", "-"): dist.version for dist in distributions()}
    packages = (f"{name} {installed[name]}" for name in _PACKAGES if name in installed)
    lines = [
        f"gauss2svg {__version__}",
        f"system: {platform.platform()}, Python {platform.python_version()}",
        _or_reason("CPU", _machine),
        f"renderers: {', '.join(renderers)}",
        f"packages: {', '.join(packages)}",
    ]
    return "\n".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") for line in lines)


def _or_reason(name: str, describe: Callable[[str], str]) -> str:
    """Return describe(name), or the name and the reason why it failed, without advice."""
    try:
        return describe(name)
    except Exception as error:  # a package that is missing or broken may raise anything
        return f"{name}: {re.split(r'; got |[.] Try ', str(error))[0]}"


def _machine(name: str) -> str:
    from gauss2svg.compare.records import machine

    about = machine()
    return f"{name}: {about['cpu']}, {about['cores']} cores"


def _renderer(name: str) -> str:
    from gauss2svg.raster import renderer_version

    return renderer_version(name)
