"""Plates of inks, for printers and for cutters.

A plate shows where one ink is printed. For example, a scene has yellow ellipses, blue ellipses over
them, and yellow ellipses on top. These are three groups in two inks. The yellow plate has both
yellow groups in black, and between them the blue group in white.

The shapes of a scene lie over each other. A cutter would follow edges that nobody sees, and vinyl
would lie in two layers. So a cut file has one region for each ink, closed and clear of all others.
The region is what is seen of the ink:

    shapes as polygons, the bottom one first -> union with those of the ink, difference of others
    -> what is too thin to be cut goes to the ink beside it

Regions are polygons of lines, and are written as areas (gauss2svg.svg.element). shapely computes
them, which belongs to the extra `cut`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from importlib.util import find_spec
from itertools import groupby
from typing import TYPE_CHECKING, Any

import lazy_loader
import numpy as np

from gauss2svg import portable
from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import Area, Outline
from gauss2svg.scene.falloff import covered_radius
from gauss2svg.scene.inks import ink_colors, ink_name, inks_of_scene, oklab
from gauss2svg.svg import MOST_TRAP
from gauss2svg.svg.element import Floats
from gauss2svg.svg.minimal import color_levels, colors_together, overlapping, projections
from gauss2svg.svg.paths import flat, windings

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from shapely.geometry.base import BaseGeometry

shapely: Any = lazy_loader.load("shapely")  # only cut files need it, and it may not be installed

# Two ellipses count as apart if the gap between them is at least this, in px. It is more than 0,
# because edges are antialiased.
_MARGIN = 1.0
CUT_UNIT = 0.01  # px, to which coordinates of cut files are rounded
_GRID = 1e-3  # px, to which corners of regions are rounded, so that they can be united exactly


def grouped_by_ink(scene: Scene) -> Scene:
    """Return the scene with shapes of the same ink moved together.

    A shape is moved only if this does not change the picture. Each run of shapes of the same ink
    becomes a round. Raise InputError if the scene is not in inks.
    """
    inks_of_scene(scene)
    mean, factor = _drawn(scene)
    keys = np.stack([mean[:, 0], mean[:, 1], scene.beta])
    order = colors_together(mean, factor, color_levels(scene.color, 6), keys, _MARGIN)
    scene = scene.replace(round_index=None, level=None).select(order)
    changes = (np.diff(color_levels(scene.color, 6), axis=0) != 0).any(axis=1)
    index = np.concatenate([[0], np.cumsum(changes)])[: len(scene)]
    return scene.replace(round_index=index)


def plate_of(scene: Scene, tones: Mapping[str, float]) -> Scene:
    """Return the plate of an ink: black where the ink is visible, and white elsewhere.

    tones  strength of the ink in 0..1 in each colour #rrggbb. It is 0 in all others. A strength
           between 0 and 1 is grey

    Shapes that change nothing on the plate are left out. Raise InputError if the scene has none of
    the colours that have a strength.
    """
    _check_ink(tones, [ink_name(one) for one in inks_of_scene(scene)])

    def grey(color: Any) -> float:
        return 1.0 - tones.get(ink_name(np.asarray(color)), 0.0)

    colors, entry = np.unique(scene.color, axis=0, return_inverse=True)
    greys = np.array([grey(color) for color in colors])[entry.reshape(-1)]
    ground = 1.0 if scene.transparent else grey(scene.background)
    areas = [dataclasses.replace(a, paint=(grey(a.paint),) * 3) for a in scene.areas]
    # `shows` marks the shapes whose colour on the plate differs from what may be below them. A
    # shape that is not marked is needed only if it covers a part of a marked shape.
    shows = (greys != ground) | bool(areas)
    ellipses, needed, index = projections(*_drawn(scene)), shows.copy(), np.arange(len(scene))
    for i in np.flatnonzero(shows).tolist():
        needed[overlapping(ellipses, i, index[(index > i) & ~needed], _MARGIN)] = True
    plate = scene.replace(
        color=np.repeat(greys[:, None], 3, axis=1),
        areas=areas,
        background=np.full(3, ground),
        transparent=False,
    )
    return plate.select(needed)


def _drawn(scene: Scene) -> tuple[Floats, Floats]:
    """Return the centres (n, 2) of the ellipses that are drawn, and their factors l11 l21 l22.

    Both are in px. The factors (n, 3) are those of Scene.cholesky.
    """
    return scene.mean, scene.cholesky * covered_radius(scene.beta)[:, None]


def _check_ink(tones: Mapping[str, float], names: Collection[str]) -> None:
    """Raise InputError if none of the colours that have a strength is among `names`."""
    printing = [color for color, tone in tones.items() if tone]
    if not set(printing) & set(names):
        raise refusal("ink", f"one of {', '.join(names)}", quoted(", ".join(printing)))


class CutMissingError(InputError, ImportError):
    """A cut file needs a package that is not installed."""


def require_shapely() -> None:
    """Raise CutMissingError if the package shapely is not installed."""
    if find_spec("shapely") is None:
        needed = "given with shapely installed; got none"
        raise CutMissingError(f'cut must be {needed}. Try pip install "gauss2svg[cut]"')


class Regions:
    """The shapes of a scene in inks as polygons, from which regions of colours are computed.

    thin_parts  number of parts that are too thin to be cut, and so belong to the ink beside them.
                It is 0 until the first region is computed
    """

    def __init__(self, scene: Scene, mm_per_px: float) -> None:
        """Make polygons of all shapes.

        mm_per_px  size of a px of the canvas on paper
        """
        require_shapely()
        self.thin_parts = 0
        self._scene, self._px_per_mm = scene, 1 / mm_per_px
        self.colors = [ink_name(ink) for ink in inks_of_scene(scene)]
        self._page = shapely.box(0, 0, scene.width, scene.height)
        # Lines are at most so far from curves, in px and in mm on paper. Cutters step by 0.025 mm.
        # An ellipse of 3 px, which is a dot in a photo, then has 20 lines.
        tolerance = min(0.05, 0.01 * self._px_per_mm)
        self._shapes: list[tuple[str, BaseGeometry]] = []
        if not scene.transparent:
            self._shapes.append((ink_name(scene.background), self._page))
        names = (ink_name(np.array(area.paint)) for area in scene.areas)
        polygons = (_polygon(area, tolerance) for area in scene.areas)
        self._shapes += zip(names, polygons, strict=True)
        ellipses = (shapely.Polygon(points) for points in _ellipses(scene, tolerance))
        self._shapes += zip(map(ink_name, scene.color), ellipses, strict=True)

    def of(self, colors: Collection[str]) -> BaseGeometry:
        """Return the region of the page in which one of the colours "#rrggbb" is seen.

        Slivers belong to a colour beside them.
        """
        regions = [region for color, region in self._regions.items() if color in colors]
        return self._polygons(shapely.union_all(regions, grid_size=_GRID))

    @cached_property
    def _regions(self) -> dict[str, BaseGeometry]:
        """The region of each colour, without slivers.

        The thinnest slivers go first, because what lies beside them may then be wide enough.
        """
        # What is thinner than this, 0.3 mm on paper, cannot be cut.
        least = 0.3 * self._px_per_mm
        seen = {color: self._seen(color) for color in self.colors}
        regions = dict(seen)
        for width, color in itertools.product((least / 3, least), self.colors):
            slivers = self._slivers(regions[color], width)
            others = [other for other in self.colors if other != color]
            # Each sliver goes to the colour that has most of its edge.
            edges = shapely.buffer(slivers, width / 10)
            shares = np.zeros((len(others), len(slivers)))
            for k, other in enumerate(others):
                shapely.prepare(regions[other])
                near = shapely.intersects(regions[other], edges)
                shares[k, near] = shapely.area(shapely.intersection(regions[other], edges[near]))
            lost = shapely.union_all(slivers)
            region = shapely.difference(regions[color], lost, grid_size=_GRID)
            regions[color] = self._polygons(region)
            for k, other in enumerate(others):
                won = slivers[(shares[k] > 0) & (shares.argmax(axis=0) == k)]
                if len(won):
                    region = shapely.union_all([regions[other], *won], grid_size=_GRID)
                    regions[other] = self._polygons(region)
        for color, region in regions.items():
            lost = shapely.difference(seen[color], region, grid_size=_GRID)
            # What is smaller is left by rounding, as in `_area`.
            self.thin_parts += int((shapely.area(shapely.get_parts(lost)) > 1e-3).sum())
        return regions

    def _slivers(self, region: BaseGeometry, width: float) -> NDArray[np.object_]:
        """Return the parts of a region that are thinner than a width in px, as polygons."""
        wide = region.buffer(-width / 2, join_style="mitre")
        wide = wide.buffer(width / 2 + 2 * _GRID, join_style="mitre")
        rest = shapely.difference(region, wide, grid_size=_GRID)
        parts = shapely.get_parts(self._polygons(rest))
        # The tips of corners are thin too, and stay.
        is_beside = shapely.distance(parts, wide) <= 2 * _GRID
        return parts[~is_beside | (shapely.area(parts) >= width**2)]

    def _seen(self, color: str) -> BaseGeometry:
        """Return the region in which a colour is seen."""
        region = shapely.Polygon()
        for is_inside, run in groupby(self._shapes, key=lambda one: one[0] == color):
            together = shapely.union_all([polygon for _, polygon in run])
            region = region.union(together) if is_inside else region.difference(together)
        region = shapely.intersection(region, self._page, grid_size=_GRID)
        return self._polygons(region)

    def _polygons(self, region: BaseGeometry) -> BaseGeometry:
        """Return the polygons of a region, without its lines and points."""
        parts = shapely.get_parts(region)
        return shapely.MultiPolygon([one for one in parts if one.geom_type == "Polygon"])

    def plate(self, tones: Mapping[str, float], trap: float = 0.0) -> Scene:
        """Return the plate of an ink: one area for each of its strengths, and no background.

        tones  as in `plate_of`
        trap   width in mm by which colours spread below darker ones beside them
        """
        _check_ink(tones, self.colors)
        seen, areas = {color: tones.get(color, 0.0) for color in self.colors}, []
        for tone in sorted(set(seen.values()) - {0.0}):
            region = self._trapped([c for c, other in seen.items() if other == tone], trap)
            areas += self._area(region, (1.0 - tone,) * 3)
        return self._of_areas(areas)

    def outlines(self, colors: Iterable[str], trap: float = 0.0) -> Scene:
        """Return a scene with one area for each of the colours that is seen, lightest first."""
        by_light = sorted(set(colors) & set(self.colors), key=_lightness, reverse=True)
        areas = []
        for color in by_light:
            areas += self._area(self._trapped([color], trap), tuple(ink_colors(color)[0]))
        return self._of_areas(areas)

    def _trapped(self, colors: list[str], trap: float) -> BaseGeometry:
        """Return the region of colours, with what spreads below darker colours beside it."""
        region = self.of(colors)
        if not (reach := Field("trap", float, 0, MOST_TRAP).checked(trap) * self._px_per_mm):
            return region
        for color in colors:
            if darker := {c for c in self.colors if _lightness(c) < _lightness(color)}:
                alone = region if colors == [color] else self.of([color])
                region = region.union(alone.buffer(reach).intersection(self.of(darker)))
        return region

    def _area(self, region: BaseGeometry, color: Any) -> list[Area]:
        """Return a region as an area, or no area if it is empty."""
        paths = []
        for part in shapely.get_parts(region):
            for ring in (part.exterior, *part.interiors):
                # What is smaller is left by rounding between edges that meet. shapely has holes run
                # the other way, so they are holes by either fill rule.
                if min(part.area, shapely.Polygon(ring).area) > 1e-3:
                    points = tuple(ring.coords[:-1])
                    paths.append(Outline(points, (False,) * len(points)))
        return [Area(tuple(paths), color)] if paths else []

    def _of_areas(self, areas: list[Area]) -> Scene:
        return Scene(self._scene.width, self._scene.height, transparent=True, areas=tuple(areas))


def _lightness(color: str) -> float:
    return float(oklab(ink_colors(color))[0, 0])


def _ellipses(scene: Scene, tolerance: float) -> Iterable[Floats]:
    """Yield the points (k, 2) of each plain ellipse as a polygon of the same area."""
    factor = scene.factor * covered_radius(scene.beta)[:, None, None]
    reach = portable.hypot(factor[:, :, 0], factor[:, :, 1]).max(axis=1)
    for center, matrix, radius in zip(scene.mean, factor, reach.tolist(), strict=True):
        count = _lines(radius, 2 * math.pi, tolerance)
        step = 2 * math.pi / count
        angle = step * np.arange(count)
        circle = np.stack([portable.cos(angle), portable.sin(angle)], axis=1)
        circle *= math.sqrt(step / portable.sin(step))
        yield center + portable.product(circle, matrix.T)


def _lines(radius: float, angle: float, tolerance: float) -> int:
    """Return the number of lines of an arc. Each spans at most an eighth of a turn."""
    step = 2 * portable.arccos(max(1 - tolerance / max(radius, tolerance), 0.5))
    return math.ceil(angle / min(step, math.pi / 4) - 1e-9)


def _polygon(area: Area, tolerance: float) -> BaseGeometry:
    """Return the region that an area fills, or the one that its strokes cover."""
    points = [flat(outline, tolerance) for outline in area.outlines]
    if not area.is_line:
        return _filled(points)
    half = 0.5 * area.width
    style = {
        "cap_style": {"butt": "flat"}.get(area.cap, area.cap),
        "join_style": "round" if area.cap == "round" else "mitre",
        "mitre_limit": 4.0,  # the default of SVG, which files do not change
        "quad_segs": _lines(half, 0.5 * math.pi, tolerance),
    }
    strokes = []
    for line, outline in zip(points, area.outlines, strict=True):
        path = shapely.LinearRing if outline.closed and len(line) > 3 else shapely.LineString
        strokes.append(path(line).buffer(half, **style))
    return shapely.union_all(strokes)


def _filled(rings: list[Floats]) -> BaseGeometry:
    """Return the region around which rings run more often one way than the other ("nonzero")."""
    rings = [ring for ring in rings if len(ring) > 3]
    if len(rings) == 1 and (polygon := shapely.Polygon(rings[0])).is_valid:
        return polygon
    edges = shapely.union_all([shapely.LineString(ring) for ring in rings])
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(edges)))
    points = shapely.get_coordinates([face.representative_point() for face in faces])
    winding = sum(windings(ring[:-1], points) for ring in rings)
    return shapely.union_all(faces[winding != 0])
