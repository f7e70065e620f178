"""Lists of inks that users give: hex colours, names, or a palette file.

--help needs this module, so nothing that is imported here imports NumPy.
"""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import plain_scalar, quoted, refusal
from gauss2svg.files import reading
from gauss2svg.options import Field, file_name, hex_of

# The number of inks, or their colours, or the path of a palette file. The command line builds its
# option from the simpler type below, because it cannot read a sequence.
if TYPE_CHECKING:
    Inks = int | str | os.PathLike[str] | Sequence[str]
else:
    Inks = int | str

LEAST_INKS, MOST_INKS = 2, 64
MOST_TONES = 7  # tones of an ink that overprints. Two inks then have 64 mixes
PALETTE_SUFFIX = ".gpl"
_ADVICE = '6, or "#f7c306,#c0322c,#17324d"'


def check_inks(name: str, value: Any) -> int | str:
    """Return the number of inks, or their colours as "#rrggbb,#rrggbb,..".

    name   name of the option, which errors show
    value  a number, hex colours in a text or a sequence, or the path of a .gpl file

    Raise InputError if the value is none of these, if the number of inks to choose is not in
    LEAST_INKS..MOST_INKS, if more than MOST_INKS are listed, or if a colour occurs twice.
    """
    value = plain_scalar(value)
    if isinstance(value, str):
        with suppress(ValueError):  # it is no number, or one of thousands of digits
            value = int(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return Field(name, int, LEAST_INKS, MOST_INKS).checked(value)
    texts: Any = value.split(",") if isinstance(value, str) else value
    if isinstance(value, os.PathLike) or (
        isinstance(value, str) and value.strip().lower().endswith(PALETTE_SUFFIX)
    ):
        texts = _read_palette(name, file_name(name, value))
    try:
        inks = [hex_of(text) for text in texts]
    except (TypeError, ValueError) as error:
        needed = "colours such as #c0322c or red, a number of them or a .gpl file"
        close = str(error) if isinstance(error, ValueError) else ""
        raise refusal(name, needed, quoted(value), close or _ADVICE) from None
    if not 1 <= len(inks) == len(set(inks)) <= MOST_INKS:
        raise refusal(name, f"1 to {MOST_INKS} different colours", quoted(value), _ADVICE)
    return ",".join(inks)


def _read_palette(name: str, path: str) -> list[str]:
    """Return the distinct colours of a palette file of GIMP or Inkscape, each as six hex digits."""
    from PIL.GimpPaletteFile import GimpPaletteFile

    with reading(path, "a palette file") as file:
        lines = [line.strip() for line in file.read(1_000_000).splitlines() if line.strip()]
    try:
        levels = GimpPaletteFile(io.BytesIO(b"\n".join(lines))).palette
    except (SyntaxError, ValueError):
        needed = "a palette of GIMP, with three levels of 0 to 255 a line"
        raise refusal(name, needed, quoted(path), _ADVICE) from None
    return list(dict.fromkeys(levels[k : k + 3].hex() for k in range(0, len(levels), 3)))
