"""What an SVG refers to: only itself and pictures that it holds as data: are let through.

resvg reads local files that an href names, by path or relative to the current folder, and a
browser would load more than any renderer here does, so that a score would be another picture's.
"""

from __future__ import annotations

import re
import warnings
from urllib.request import DataHandler, Request

from PIL import Image

from gauss2svg.errors import InputError
from gauss2svg.raster.css import plain_css

_PICTURES = ("image", "feImage")
_FORMATS = ("PNG", "JPEG", "GIF", "WEBP")
MOST_EMBEDDED_PIXELS = 100_000_000  # of all embedded pictures together
_NAMESPACE = re.compile(r"@namespace[^;]*;", re.IGNORECASE)  # it has an address, and loads nothing
_URL = re.compile(r"""url\(\s*["']?\s*([^"')\s]*)""", re.IGNORECASE)


def check_css(text: str) -> None:
    """Raise InputError if a style sheet or a property refers to anything outside."""
    text = _NAMESPACE.sub(" ", plain_css(text))
    if "@import" in text.lower():
        raise _outside("@import of a style sheet")
    for match in _URL.finditer(text):
        if not match[1].startswith("#") and not _is_data(match[1]):
            raise _outside(match[0] + ")")


def check_link(tag: str, target: str) -> int:
    """Pixels of the picture that a link embeds, 0 for a link within the file.

    tag     local name of the element whose href it is
    target  its value
    Raises InputError for any other link, and for data: that is no PNG, JPEG, GIF or WebP.
    """
    target = target.strip()
    if not target or target.startswith("#"):
        return 0
    if _is_data(target) and tag in _PICTURES:
        return _pixels(target)
    raise _outside(target)


def _is_data(target: str) -> bool:
    return target[:5].lower() == "data:"


def _outside(what: str) -> InputError:
    shown = what if len(what) <= 80 else what[:77] + "..."
    return InputError(
        f"SVG refers to {shown}, and nothing outside of it is loaded; embed pictures by data:, or "
        "remove it"
    )


def _pixels(uri: str) -> int:
    try:
        with (
            warnings.catch_warnings(action="ignore"),  # its size is counted by the caller
            DataHandler().data_open(Request(uri)) as data,
            # Only the header is read. A nested SVG would be drawn without having been checked.
            Image.open(data, formats=_FORMATS) as picture,
        ):
            return picture.width * picture.height
    except Image.DecompressionBombError as error:
        raise InputError(f"picture in the SVG is too large: {error}; shrink it first") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(
            "data: in the SVG is no picture that can be read; needed is one of "
            f"{', '.join(_FORMATS)}"
        ) from error
