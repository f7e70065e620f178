"""Bytes of a Gaussian in a file: what is assumed of them until a file has been measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BytesEachTuning:
    """Bytes of a Gaussian in editable markup.

    usual    its share of the palette included (docs/decisions/numbers.md)
    gzipped  share of its bytes that gzip leaves (docs/decisions/numbers.md)
    limited  usual where a limit of bytes is to be filled (docs/decisions/time.md)
    least    fewest there
    in_inks        usual of an ellipse of one of a few inks (docs/decisions/inks.md)
    least_in_inks  fewest of it, in minimal markup
    """

    usual: int = 120
    gzipped: float = 0.17
    limited: int = 100
    least: int = 60
    in_inks: int = 60
    least_in_inks: int = 20


TUNING = BytesEachTuning()
# In minimal markup of a soft shape, of a plain ellipse, of a shape of a drawing; and gzipped
# (docs/decisions/small.md).
MINIMAL, MINIMAL_GZIPPED = (62, 44, 36), (22, 20, 18)
