"""How a scene is written: the form of its shapes, and how exact its numbers are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from gauss2svg.options import Number, OneOf, OptionGroup, Whole

Form = Literal["gradient", "blur"]
EDITABLE, MINIMAL = "editable", "minimal"
ROUNDS, INKS = "rounds", "inks"
# Over 1 px thin shapes would be rounded to nothing.
LEAST_PRECISION, MOST_PRECISION = 0.001, 1.0
STOP_COUNTS = (5, 6, 8, 10, 12)  # of a gradient


@dataclass(frozen=True, kw_only=True)
class SvgFormat(OptionGroup):
    """How write_svg writes a scene, as its caller says it.

    A run of vectorize takes SvgOptions, and finds this by them, its preset and its limits.

    An additive scene is written in gradients alone, and without opacities.
    """

    form: Form = "gradient"
    """Form of the shapes that are not plain ellipses: a radial gradient, or, except for small
    ones, a disc under feGaussianBlur."""

    markup: Literal["editable", "minimal"] = "editable"
    """editable: layers with names, for editors; minimal: nothing that does not draw."""

    stops: Annotated[int, OneOf(STOP_COUNTS)] = 5
    """Stops of a gradient, one of STOP_COUNTS."""

    precision: Annotated[float, Number(LEAST_PRECISION, MOST_PRECISION)] = 0.04
    """The file's user unit in px, of which coordinates are whole numbers: docs/decisions/numbers.md
    has what rounding costs."""

    layers: Literal["rounds", "inks"] = "rounds"
    """Layers of editable markup: the rounds of the fit, or shapes of one ink."""

    opacity_decimals: Annotated[int, Whole(1, 6)] = 2
    """Decimals of fill-opacity."""
