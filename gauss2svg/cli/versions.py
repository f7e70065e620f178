"""The block that --version prints, which a fault report needs.

Packages are imported where they are asked for their versions, because one that cannot be imported
may be the fault that is reported.
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

_WIDTH = 79  # characters, so that no terminal breaks a line elsewhere
# The packages that decode, fit and measure; renderers have their own line.
_PACKAGES = (
    "numpy", "scipy", "numba", "scikit-image", "pillow", "pyvips", "pi-heif", "svgwrite", "torch",
    "ssimulacra2", "flip-evaluator",
)  # fmt: skip


def versions() -> str:
    """Return the versions of the program, of its packages and renderers, and the machine."""
    renderers = (_or_reason(name, _renderer) for name in get_args(Renderer))
    installed = {one.name.lower().replace("_", "-"): one.version for one in distributions()}
    packages = (f"{name} {installed[name]}" for name in _PACKAGES if name in installed)
    lines = [
        f"gauss2svg {__version__}",
        f"system: {platform.platform()}, Python {platform.python_version()}",
        _or_reason("CPU", _machine),
        f"renderers: {', '.join(renderers)}",
        f"packages: {', '.join(packages)}",
    ]
    return "\n".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") for line in lines)


def _or_reason(name: str, ask: Callable[[str], str]) -> str:
    """Return what a function says of a name, or the reason why it cannot, without advice."""
    try:
        return ask(name)
    except Exception as error:  # of any package that is missing or broken
        return f"{name}: {re.split(r'; got |[.] Try ', str(error))[0]}"


def _machine(name: str) -> str:
    from gauss2svg.compare.records import machine

    here = machine()
    return f"{name}: {here['cpu']}, {here['cores']} cores"


def _renderer(name: str) -> str:
    from gauss2svg.raster import renderer_version

    return renderer_version(name)
