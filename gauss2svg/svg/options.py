"""How a scene is written."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from gauss2svg.checks import number_within, whole_number
from gauss2svg.errors import InputError
from gauss2svg.svg.blur import FORMS, GRADIENT
from gauss2svg.svg.stops import STOP_COUNTS

# Over 1 px thin shapes would be rounded to nothing.
LEAST_PRECISION, MOST_PRECISION = 0.001, 1.0


@dataclass(frozen=True)
class SvgOptions:
    """How a scene is written.

    form              of shapes that are no plain ellipses: gradient; blur, a disc under
                      feGaussianBlur, save for small ones; hybrid, blur for large ones alone
    palette           most gradients, one for each pair of a colour and an exponent, and in
                      proportion where shapes are blurred; 0 writes every pair
    color_error       squared error, mean over pixels and channels, that using fewer of them
                      may add; 0: as many as the palette has
    stops             gradient stops, one of STOP_COUNTS
    precision         px, LEAST_PRECISION..MOST_PRECISION: the file's user unit. Coordinates are
                      whole numbers of it. Rounding means alone to 0.1, 0.04, 0.01 px leaves
                      55 to 57, 62 to 64, 74 to 76 dB of Kodak 04 and 20 in 5000 shapes
    opacity_decimals  of fill-opacity, 1..6; rounding to 2 leaves 69 dB there, to 3 89 dB

    An additive scene is written in gradients alone, and has no opacities.
    """

    form: str = GRADIENT
    palette: int = 1250
    color_error: float = 0.0
    stops: int = 5
    precision: float = 0.04
    opacity_decimals: int = 2

    def __post_init__(self) -> None:
        if self.form not in FORMS:
            raise InputError(f"form is {self.form!r}; needed is one of {', '.join(FORMS)}")
        whole_number("palette", self.palette, 0, 2**24)
        if self.stops not in STOP_COUNTS:
            known = ", ".join(map(str, STOP_COUNTS))
            raise InputError(f"stops is {self.stops}; needed is one of {known}")
        number_within("color_error", self.color_error, 0, 1e9)
        number_within("precision", self.precision, LEAST_PRECISION, MOST_PRECISION)
        whole_number("opacity_decimals", self.opacity_decimals, 1, 6)

    @property
    def every_color(self) -> SvgOptions:
        """The same without a palette: for colours that are of one already."""
        return dataclasses.replace(self, palette=0, color_error=0.0)
