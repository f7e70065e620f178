"""Areas and lines: closed outlines with a paint, and centrelines that are drawn as strokes.

They lie above the background of a scene, the bottom one first. All of their values are tuples of
numbers, so that they can be compared, copied and written as JSON. Coordinates are in px of the
canvas, and (0, 0) is its upper left corner.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import SceneError, brief, quoted, several

Point = tuple[float, float]
Color = tuple[float, float, float]
Cap = Literal["butt", "round", "square"]
CAPS: tuple[Cap, ...] = ("butt", "round", "square")  # the enum of core/coverage.c has this order
MOST_COORDINATE = 1e9  # largest absolute value of a coordinate, in px
MOST_STOPS = 64  # largest number of stops of a gradient


def checked_array(
    name: str,
    values: Any,
    shape: tuple[int, ...],
    low: float,
    high: float,
    domain: str = "",
    advice: str = "to clip it",
) -> NDArray[np.float64]:
    """Return a copy of `values` as float64.

    A -1 in `shape` stands for any length. Raise SceneError if the values have another shape, or if
    one is not in low..high.

    name, domain, advice  the error is "NAME[INDEX] must be finite and in LOW..HIGH DOMAIN; got
                          VALUE. Try ADVICE"
    """
    try:
        # Masked elements become NaN, and the test below refuses NaN.
        values = np.ma.filled(np.asanyarray(values), np.nan)
        array = values.astype(np.float64, "C", "same_kind", subok=False)
    except Exception as error:
        # NumPy and torch (if a tensor requires_grad) raise many classes, so all are caught.
        raise SceneError(f"{name} must be numbers; got {brief(error)}") from None
    sides = zip(array.shape, shape, strict=False)
    if array.ndim != len(shape) or any(side != most != -1 for side, most in sides):
        needed = str(shape).replace("-1", "n")
        raise SceneError(f"{name} must be of shape {needed}; got {array.shape}")
    bad = ~((array >= low) & (array <= high))
    if bad.any():
        at = tuple(int(i) for i in np.argwhere(bad)[0])
        advice = "to replace NaN and masked values" if np.isnan(array[at]) else advice
        raise SceneError(
            f"{name}{list(at) or ''} must be finite and in {low:.16g}..{high:.16g}{domain}; got "
            f"{array[at]!s}. Try {advice}"
        )
    return array


def _numbers(
    name: str, values: Any, shape: tuple[int, ...], high: float, least: float | None = None
) -> Any:
    """Return `values` as nested tuples of floats in least..high. A `least` of None is -high."""
    numbers = checked_array(name, values, shape, -high if least is None else least, high).tolist()
    return tuple(map(tuple, numbers)) if len(shape) == 2 else tuple(numbers) if shape else numbers


@dataclass(frozen=True)
class Outline:
    """A path of straight lines and cubic Bezier curves.

    points  the start, and then for each segment its end, or, if the segment is curved, its two
            handles and its end. The last segment of a closed path ends at the start, and this end
            is left out
    curved  for each segment, whether it is a cubic curve
    closed  whether the path ends where it starts
    """

    points: tuple[Point, ...]
    curved: tuple[bool, ...]
    closed: bool = True

    def __post_init__(self) -> None:
        points = _numbers("points of an outline", self.points, (-1, 2), MOST_COORDINATE)
        curved = tuple(map(bool, self.curved))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "curved", curved)
        object.__setattr__(self, "closed", bool(self.closed))
        count = len(curved) + 2 * sum(curved) + (not self.closed)
        if not curved or len(points) != count:
            kind = "a closed" if self.closed else "an open"
            raise SceneError(
                f"points of {kind} outline with {len(curved)} segments must be {count}, and at "
                f"least one segment; got {len(points)}"
            )

    def __repr__(self) -> str:
        kind = "closed" if self.closed else "open"
        return f"<gauss2svg.Outline {kind}, {len(self.points)} points>"

    @property
    def segments(self) -> NDArray[np.float64]:
        """Control points (k, 4, 2) of the segments. A line repeats each of its two ends."""
        points = np.array(self.points)
        cubic = np.array(self.curved)
        end = np.cumsum(np.where(cubic, 3, 1))
        start = np.concatenate([[0], end[:-1]])
        index = np.stack([start, start + cubic, end - cubic, end], axis=1)
        return points[index % len(points)]

    @property
    def nodes(self) -> NDArray[np.float64]:
        """Ends (n, 2) of the segments, each of them once."""
        segments = self.segments
        return segments[:, 0] if self.closed else np.vstack([segments[:, 0], segments[-1:, 3]])

    @classmethod
    def of_segments(cls, segments: Any, curved: Iterable[bool], closed: bool = True) -> Self:
        """Return the outline that has these control points (k, 4, 2). Each starts at an end."""
        points = [segments[0][0]]
        for segment, is_curve in zip(segments, curved, strict=True):
            points += list(segment[1:]) if is_curve else [segment[3]]
        return cls(tuple(points[:-1] if closed else points), tuple(curved), closed)

    def scaled(self, factor_x: float, factor_y: float) -> Self:
        """Return the outline with its coordinates multiplied by factor_x and factor_y."""
        points = tuple((x * factor_x, y * factor_y) for x, y in self.points)
        return dataclasses.replace(self, points=points)


@dataclass(frozen=True)
class _Gradient:
    """The stops of a gradient.

    offsets  at least two places in 0..1, which never decrease
    colors   sRGB colour in 0..1 at each of them. Between them it is interpolated, and beyond the
             first and the last offset it stays the same
    """

    offsets: tuple[float, ...]
    colors: tuple[Color, ...]

    def __post_init__(self) -> None:
        offsets = _numbers("offsets of a gradient", self.offsets, (-1,), 1, 0)
        colors = _numbers("colors of a gradient", self.colors, (-1, 3), 1, 0)
        if not 2 <= len(offsets) == len(colors) <= MOST_STOPS or sorted(offsets) != list(offsets):
            raise SceneError(
                f"offsets of a gradient must be 2..{MOST_STOPS}, one for each color, and never "
                f"decrease; got {quoted(offsets)} for {len(colors)} colors"
            )
        object.__setattr__(self, "offsets", offsets)
        object.__setattr__(self, "colors", colors)
        for field in dataclasses.fields(self)[2:]:  # the place
            least, value = 1e-9 if field.name == "radii" else None, getattr(self, field.name)
            name = f"{field.name} of a gradient"
            place = _numbers(name, value, (2,), MOST_COORDINATE, least)
            object.__setattr__(self, field.name, place)

    @property
    def place(self) -> tuple[Point, ...]:
        """The two pairs of numbers in px that say where the gradient is."""
        return tuple(getattr(self, field.name) for field in dataclasses.fields(self)[2:])

    def colors_at(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the colours (.., 3) at positions along the gradient."""
        channels = np.array(self.colors).T
        return np.stack([np.interp(position, self.offsets, c) for c in channels], axis=-1)


@dataclass(frozen=True)
class LinearGradient(_Gradient):
    """A gradient along a line. Its offsets are 0 at `start` and 1 at `end`."""

    start: Point = (0.0, 0.0)
    end: Point = (1.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == self.end:
            raise SceneError(f"end of a gradient must differ from its start; got {self.end}")

    def at(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
        """Return the colours (.., 3) at points in px."""
        across, down = np.subtract(self.end, self.start)
        along = (x - self.start[0]) * across + (y - self.start[1]) * down
        return self.colors_at(along / (across**2 + down**2))

    def moved(self, x: float, y: float) -> Self:
        """Return the gradient moved by x and y px."""
        start, end = np.add((self.start, self.end), (x, y))
        return dataclasses.replace(self, start=start, end=end)

    def scaled(self, factor_x: float, factor_y: float) -> Self:
        """Return the gradient of a canvas that is scaled by factor_x and factor_y.

        If the factors differ, the direction across the gradient is turned as well, so that each
        point keeps its colour.
        """
        axis = np.subtract(self.end, self.start)
        # The position is (p - start) . axis / |axis|^2. In scaled coordinates q = S p it must be
        # (q - S start) . g with g = S^-1 axis / |axis|^2, so the new axis is g / |g|^2.
        g = axis / portable.dot(axis, axis) / [factor_x, factor_y]
        start = np.array(self.start) * [factor_x, factor_y]
        end = start + g / portable.dot(g, g)
        return dataclasses.replace(self, start=tuple(start), end=tuple(end))


@dataclass(frozen=True)
class RadialGradient(_Gradient):
    """A gradient around a point. Its offsets are 0 at `center`, and 1 on an upright ellipse."""

    center: Point = (0.0, 0.0)
    radii: Point = (1.0, 1.0)

    def at(self, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.float64]:
        """Return the colours (.., 3) at points in px."""
        (cx, cy), (rx, ry) = self.center, self.radii
        return self.colors_at(portable.hypot((x - cx) / rx, (y - cy) / ry))

    def moved(self, x: float, y: float) -> Self:
        """Return the gradient moved by x and y px."""
        return dataclasses.replace(self, center=np.add(self.center, (x, y)))

    def scaled(self, factor_x: float, factor_y: float) -> Self:
        """Return the gradient of a canvas that is scaled by factor_x and factor_y."""
        center, radii = np.multiply((self.center, self.radii), (factor_x, factor_y))
        return dataclasses.replace(self, center=center, radii=radii)


Paint = Color | LinearGradient | RadialGradient


@dataclass(frozen=True)
class Area:
    """Outlines that are filled with one paint, or a line that is drawn with it.

    outlines  at least one. Those of a filled area are closed. Points around which the outlines run
              as often one way as the other are holes (the fill rule "nonzero" of SVG)
    paint     sRGB colour in 0..1, or a gradient
    opacity   in 0..1
    width     width in px of the strokes along the outlines, or 0 for a filled area
    cap       ends of open strokes. With "round", corners of strokes are round too. Otherwise they
              are mitred
    """

    outlines: tuple[Outline, ...]
    paint: Paint
    opacity: float = 1.0
    width: float = 0.0
    cap: Cap = "butt"

    def __post_init__(self) -> None:
        outlines = tuple(self.outlines)
        if not outlines or not all(isinstance(outline, Outline) for outline in outlines):
            raise SceneError(f"outlines of an area must be Outlines; got {quoted(outlines)}")
        object.__setattr__(self, "outlines", outlines)
        if not isinstance(self.paint, (LinearGradient, RadialGradient)):
            object.__setattr__(self, "paint", _numbers("color of an area", self.paint, (3,), 1, 0))
        for name, high in (("opacity", 1), ("width", MOST_COORDINATE)):
            value = _numbers(f"{name} of an area", getattr(self, name), (), high, 0)
            object.__setattr__(self, name, value)
        if self.cap not in CAPS:
            raise SceneError(f"cap of a line must be one of {', '.join(CAPS)}; got {self.cap!r}")
        if self.width == 0 and not all(outline.closed for outline in outlines):
            raise SceneError("outlines of a filled area must be closed; got an open one. Try width")

    def __repr__(self) -> str:
        return f"<gauss2svg.Area {AreaCounts.of([self])}>"

    @property
    def is_line(self) -> bool:
        """Whether the outlines are drawn as strokes."""
        return self.width > 0

    @property
    def nodes(self) -> int:
        """Number of nodes of all outlines."""
        return sum(len(outline.curved) + (not outline.closed) for outline in self.outlines)

    def scaled(self, factor_x: float, factor_y: float) -> Self:
        """Return the area on a canvas that is scaled by factor_x and factor_y.

        The width of a line is multiplied by the geometric mean of the factors.
        """
        outlines = tuple(outline.scaled(factor_x, factor_y) for outline in self.outlines)
        paint, width = self.paint, self.width * math.sqrt(factor_x * factor_y)
        paint = paint if isinstance(paint, tuple) else paint.scaled(factor_x, factor_y)
        return dataclasses.replace(self, outlines=outlines, paint=paint, width=width)


class AreaCounts(NamedTuple):
    """Numbers of areas, of lines and of nodes. As text: 12 areas and 3 lines of 140 nodes."""

    areas: int
    lines: int
    nodes: int

    @classmethod
    def of(cls, areas: Sequence[Area]) -> Self:
        """Return the counts of some areas."""
        lines = sum(area.is_line for area in areas)
        return cls(len(areas) - lines, lines, sum(area.nodes for area in areas))

    @property
    def without_nodes(self) -> str:
        """Numbers of areas and lines as text, such as "12 areas and 1 line", or "" for none."""
        counts = (self.areas, "area"), (self.lines, "line")
        return " and ".join(several(*one) for one in counts if one[0])

    def __str__(self) -> str:
        both = self.without_nodes
        return f"{both} of {several(self.nodes, 'node')}" if both else "no areas"


def areas_to_json(areas: Iterable[Area]) -> str:
    """Return areas as a text, from which `areas_from_json` makes exactly the same areas."""
    return json.dumps([dataclasses.asdict(area) for area in areas], separators=(",", ":"))


def areas_from_json(text: str) -> tuple[Area, ...]:
    """Return the areas of a text of `areas_to_json`. Raise SceneError or KeyError for another."""
    areas = list[Area]()
    for row in json.loads(text):
        row["outlines"] = [Outline(**outline) for outline in row["outlines"]]
        if isinstance(paint := row["paint"], dict):
            row["paint"] = (LinearGradient if "start" in paint else RadialGradient)(**paint)
        areas.append(Area(**row))
    return tuple(areas)
