"""Additive files read back: signed colours from differences on a canvas.

A shape adds to the channels that are inverted when it is drawn and subtracts from the others
(gauss2svg.svg.additive.encode). Which ones are inverted in the end is the sign of the filter's
slope, and each rectangle after a shape that inverts a channel goes back by one. With the canvas v
that the rectangles alone leave,

    color = +- |slope| shade,   background = slope v + intercept - half a level's half.

The stops of a gradient are whole levels of a Gaussian, cut where they are black. Its shade and
where it would end are those of the nearest one: least squares over the disc.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene import MOST_SIGNED
from gauss2svg.scene.falloff import cut_radius, profile
from gauss2svg.svg.additive.differences import HALF_WAY, TRANSFER, WHITE
from gauss2svg.svg.reader.gradient import Gradients, Stop
from gauss2svg.svg.reader.shape import Shape, check_cover, in_user_space
from gauss2svg.svg.syntax.affine import Affine, compose
from gauss2svg.svg.syntax.parse import SVG
from gauss2svg.svg.syntax.values import Color, color, length, reference

_SAMPLES = 128
# Where a Gaussian's stops may turn black, as shares of its cut radius.
_REACHES = np.linspace(0.02, 1, 393)
_ROUNDED = 0.01  # of 0..1: by it a background may lie outside, as slope and intercept are rounded
_FUNCTIONS = tuple(f"{SVG}feFunc{channel}" for channel in "RGB")


class _Ramp(NamedTuple):
    """A gradient of differences: shade at its centre in 0..1, radius in sigmas, and its disc."""

    shade: Color
    radius: float
    disc: Affine
    in_box: bool


class Differences:
    """The filter, rectangles and ramps of an additive file, in the order of drawing."""

    def __init__(self, group: str, by_id: Mapping[str, Any], gradients: Gradients) -> None:
        self.group = group
        self._by_id, self._gradients = by_id, gradients
        self._ramps: dict[str, _Ramp] = {}
        self._transfer: NDArray[np.float64] | None = None  # (2, 3) slope, intercept
        self._covers: list[tuple[int, Color]] = []

    def begin(self, attributes: Mapping[str, str]) -> None:
        """Read the filter of the group; raises InputError for one that write_svg does not write."""
        if self._transfer is not None:
            raise InputError("the additive group must be one; got another of its id")
        key = reference(attributes.get("filter", "")) or ""
        element = self._by_id.get(key) if key.startswith(TRANSFER) else None
        steps = [] if element is None or element.tag != SVG + "filter" else list(element)
        linear = (
            len(steps) == 1
            and steps[0].tag == SVG + "feComponentTransfer"
            and tuple(one.tag for one in steps[0]) == _FUNCTIONS
            and all(one.get("type") == "linear" for one in steps[0])
        )
        space = None if element is None else element.get("color-interpolation-filters")
        if not linear or space != "sRGB":
            raise InputError("its filter must be the one that write_svg writes for it; got another")
        self._transfer = np.array(
            [[length(one.get(n, ""), n) for one in steps[0]] for n in ("slope", "intercept")]
        )
        if not self._transfer[0].all():
            raise InputError("slopes of its filter must be other than 0; got 0")

    def cover(self, paint: Color, count: int) -> None:
        """Draw a rectangle over `count` shapes: the first begins, others invert whole channels."""
        if self._covers and any(level not in (0, 1) for level in paint):
            raise InputError(f"its fill must be of channels that are 0 or full; got {paint}")
        if not self._covers and count:
            raise InputError("a rectangle must be under all shapes; got none. Try to restore it")
        self._covers.append((count, paint))

    def shape(self, edge: Affine, fill: str, onto: Affine) -> Shape:
        """A shape whose colour is its shade on the canvas; arguments as in read_shape."""
        key = reference(fill)
        if key is None:
            raise InputError(
                f"its fill must be a gradient of write_svg; got {quoted(fill)}. Try to delete it"
            )
        if key not in self._ramps:
            stops, disc, in_box = self._gradients.parts(key)
            shade, reach = _nearest(stops)
            self._ramps[key] = _Ramp(shade, float(cut_radius(1.0)) * reach, disc, in_box)
        ramp = self._ramps[key]
        disc = in_user_space(ramp.disc, edge) if ramp.in_box else ramp.disc
        disc = compose(onto, disc)
        check_cover(compose(onto, edge), disc)
        return Shape(ramp.shade, disc, 1.0, ramp.radius)

    def colors(
        self, shades: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Signed colours (n, 3) of shapes of these shades (n, 3), and the background (3,).

        Raises InputError where they are none of a scene.
        """
        if self._transfer is None or not self._covers:
            raise InputError("the additive group must be in the file; got none")
        slope, intercept = self._transfer
        inverted = slope < 0
        takes = np.zeros(shades.shape, bool)
        level, end = np.array(self._covers[0][1]), len(shades)
        for _, paint in self._covers[1:]:
            level = np.abs(level - paint)
        for begin, paint in reversed(self._covers):
            takes[begin:end], end = ~inverted, begin
            inverted = inverted ^ np.array(paint, bool)
        signed = np.where(takes, -1, 1) * np.abs(slope) * shades
        background = slope * level + intercept - HALF_WAY / WHITE
        if not (np.abs(signed) <= MOST_SIGNED).all():
            raise InputError(
                f"colours of the file must be at most {MOST_SIGNED:g} either way; got more"
            )
        if not (np.abs(background - 0.5) <= 0.5 + _ROUNDED).all():
            levels = ", ".join(f"{value:.3g}" for value in background)
            raise InputError(f"background of the file must be in 0..1; got {levels}")
        return signed, np.clip(background, 0, 1)


def _nearest(stops: list[Stop]) -> tuple[Color, float]:
    """Shade (3,) and reach, in cut radii, of the Gaussian that stops to black are nearest to.

    With P(t) the stops over the disc and f(x) the profile up to its cut, both over 0..1, the error

        integral of (P(t) - shade f(reach t))^2 2 t dt,   t up to 1 / reach, P(t > 1) = 0

    is least, for each reach, at shade = reach^2 integral(P f 2 t dt) / integral(f^2 2 x dx).
    """
    polygon = np.array([color(stop.color, "stop-color") for stop in stops]).reshape(-1, 3)
    offsets = np.maximum.accumulate([stop.offset for stop in stops]) if stops else np.zeros(0)
    opaque = all(stop.opacity == 1 for stop in stops)
    if not opaque or not polygon.any() or polygon[-1].any():
        raise InputError(
            "its stops must be opaque colours of write_svg that end in black; got others"
        )
    t, weight, falloffs, mass = _falloffs()
    drawn = np.stack([np.interp(t, offsets, channel) for channel in polygon.T], axis=1)
    square = float((weight[:, None] * drawn * drawn).sum())
    shades = np.square(_REACHES)[:, None] * (falloffs @ (weight[:, None] * drawn)) / mass
    error = square - mass * np.square(shades).sum(axis=1) / np.square(_REACHES)
    best = int(error.argmin())
    shade = shades[best]
    return (float(shade[0]), float(shade[1]), float(shade[2])), float(_REACHES[best])


@lru_cache(maxsize=1)
def _falloffs() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Places t (m,) in 0..1, weights (m,) 2 t dt, profiles (reaches, m) there, and f^2 in all."""
    t = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    weight, radius = 2 * t / _SAMPLES, float(cut_radius(1.0))
    falloffs = np.asarray(profile(_REACHES[:, None] * t * radius, 1.0), np.float64)
    mass = float((weight * np.square(profile(t * radius, 1.0))).sum())
    return t, weight, falloffs, mass
