"""Bytes of a Gaussian in a file: what is assumed of them until a file has been measured."""

from __future__ import annotations

# Bytes of a Gaussian in editable markup.
USUAL = 120  # bytes of an ellipse and its share of the palette (docs/decisions/numbers.md)
GZIPPED = 0.17  # share of the bytes that gzip leaves (docs/decisions/numbers.md)
LIMITED = 100  # bytes of an ellipse in a file that fills a limit (docs/decisions/time.md)
LEAST = 60  # fewest bytes of such an ellipse
IN_INKS = 60  # bytes of an ellipse of one of a few inks (docs/decisions/inks.md)
LEAST_IN_INKS = 20  # fewest bytes of it, in minimal markup
# In minimal markup of a soft shape, of a plain ellipse, of a shape of a drawing; and gzipped
# (docs/decisions/small.md).
MINIMAL, MINIMAL_GZIPPED = (62, 44, 36), (22, 20, 18)
