"""Changes to found areas, and trials of what Gaussians save beside them: colours, inks, films.

A trial on a small picture tells what some Gaussians save below, above or in place of areas. Nearly
equal colours become one.

In inks, the nearest ink of each pixel would be a third ink along many edges, because antialiased
pixels mix two colours. So the areas of a drawing get their nearest inks, gradients become bands of
inks, and the picture that is drawn so has crisp edges between inks. Areas are then found in that
picture:

    picture -> areas -> picture in inks -> areas in inks

In a film, the areas of each frame are found anew, because things move, turn, appear and hide each
other. An area of the frame before takes the place of the new one that it matches best, if the
picture then has hardly more error. So what does not move has the same numbers in each frame.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas.arrays import squared
from gauss2svg.areas.find import FoundAreas
from gauss2svg.areas.pixels import Sprite
from gauss2svg.fit import GAUSSIAN, PSNR, FitConfig, FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.photo.pixels import Focus, from_views, has_alpha, over, shrunk, views
from gauss2svg.pipeline.outcome import Export, Exporter, Subject, scaled_to
from gauss2svg.pipeline.plan import SHAPE_BYTES, USUAL_BYTES, Plan
from gauss2svg.render import render, render_rgba
from gauss2svg.render.areas import coverage_of, draw_areas
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import MOST_STOPS, Area, Color, LinearGradient, Paint, RadialGradient
from gauss2svg.scene.inks import ink_colors
from gauss2svg.svg import MINIMAL
from gauss2svg.without_scipy import nearest_entry

TRIED = 24  # Gaussians of a trial, unless their number follows from a limit of bytes
# Largest number of Gaussians above areas that a target asks for, if a trial says that they do not
# pay. They then only repair edges, which shapes alone draw in fewer.
MOST_ON_EDGES = 1000
IN_SHORT = 1500  # shapes of a run that ends before areas are found. They take up to a second
# If the PSNR in dB between a drawing and its file is less than this, people can see differences at
# the drawing's own size (docs/decisions/areas.md).
SEEN_UP_TO = 41.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial(Export):
    """A file of areas with Gaussians below them, and what some Gaussians above would save.

    ground  scene of the file on the working canvas
    error   squared error of this scene, summed over pixels and channels of the working picture
    saved   by how much Gaussians above lower it
    cost    value by which trials are compared: the error that is expected of the best file with
            these areas, to which the price of the bytes is added
    shaded  whether the picture has shading that Gaussians draw better than areas
    """

    found: FoundAreas
    ground: Scene
    error: float
    saved: float
    cost: float
    shaded: bool


class Trials:
    """Trials of areas and Gaussians, in the currency of squared error for bytes.

    plan     plan whose rate is the squared error that a byte must save
    is_over  function that tells whether the run has to end
    most     largest number of Gaussians
    """

    def __init__(
        self, plan: Plan, subject: Subject, exporter: Exporter, is_over: Callable[[], bool]
    ) -> None:
        self._plan, self._subject, self._exporter = plan, subject, exporter
        self._limit, self._is_over = plan.goal.byte_limit or math.inf, is_over
        self._rate, self._price = plan.rate, plan.rate * plan.shape_bytes
        width, height = subject.size
        # Trials see about 256 px a side. If the factor were no whole number, the small picture
        # would be blurrier than areas are at its size. What is left over at the edges is cut off.
        self._times = times = min(max(1, round(max(width, height) / 256)), width, height)
        rows, columns = height // times, width // times
        part = subject.working[: rows * times, : columns * times]
        self._small = shrunk(part, rows, columns)
        self.most = math.inf if plan.goal.count is None else plan.goal.count
        if plan.sketch or plan.in_inks:
            self.most = 0  # they would draw errors along edges, which look like stains

    def trial(self, found: FoundAreas, count: int = TRIED) -> Trial:
        """Return areas with what `count` Gaussians below or above them are expected to save."""
        scene = alone = scene_of(self._subject, found)
        count = int(min(count, self.most, self._small[..., 0].size // 3))
        if found.areas and not self._has_shading(scene):
            count = 0  # Gaussians on edges and thin parts are glows when the file is enlarged
        export = self._exporter.unscored(scene)
        first = error = cost = self._error(scene)
        # As long as more of them pay, more Gaussians are tried below the areas.
        for below in (8, 24, 72) if count and found.areas and not len(scene) else ():
            if self._is_over() or cost <= self._price * below or below > self.most:
                break
            tried = with_gaussians_below(self._cut(alone), self._small, below, self._is_over)
            tried = tried.replace(width=scene.width, height=scene.height)
            tried_export, tried_error = self._exporter.unscored(tried), self._error(tried)
            if tried_export.size > self._limit or tried_error + self._price * below >= cost:
                break
            scene, export, error = tried, tried_export, tried_error
            cost = error + self._price * below
        if error < first:
            scene = without_idle(scene, self._error)
            found = dataclasses.replace(found, areas=scene.areas)
            export, error = self._exporter.unscored(scene), self._error(scene)
        saved, price = 0.0, self._price * count
        if count and error > price / 2:
            after = self._fitted(scene, count, self._is_over).population.psnr()
            saved = max(error - self.error_at(after), 0.0)
        # A trial that leaves less than .85 of the error shows shading that areas only imitate.
        is_shaded = error < first or error - saved < 0.85 * error
        cost = error + self._rate * export.size - max(saved - price, 0.0)
        return Trial(
            **vars(export), found=found, ground=scene, error=error, saved=saved, cost=cost,
            shaded=is_shaded,
        )  # fmt: skip

    def _fitted(self, ground: Scene, count: int, stop: Callable[[], bool]) -> FitSession:
        """Return a short fit of `count` Gaussians to the small picture, above a ground."""
        inks = self._plan.options.fit.inks
        options = FitOptions(tune=PSNR, falloff=GAUSSIAN if inks is None else None, inks=inks)
        focus, ground = self._subject.focus, self._cut(ground)
        return _fitted(self._small, options, count, 80, focus, ground, stop)

    def _cut(self, scene: Scene) -> Scene:
        """Return a scene without what the small picture lacks at the right and at the bottom."""
        height, width = self._small.shape[:2]
        return scene.replace(width=width * self._times, height=height * self._times)

    def _has_shading(self, scene: Scene) -> bool:
        """Return whether the error of a scene is wide, as that of shading is."""
        picture = over(self._small)
        error = render(self._cut(scene), *picture.shape[1::-1]) - picture
        means: Any = ndimage.uniform_filter(error, [3, 3, 1])  # pyright: ignore[reportArgumentType]
        return squared(means) > 0.4 * squared(error)  # docs/decisions/areas.md

    def error_at(self, psnr: float) -> float:
        """Return the squared error of the working picture at a PSNR in dB."""
        return 3 * math.prod(self._subject.size) * portable.power(10, -psnr / 10)

    def _error(self, scene: Scene) -> float:
        """Return the squared error of a scene, measured on the small picture."""
        weight = self._subject.weight(self._small)
        return self.error_at(model_psnr(self._cut(scene), self._small, weight))

    def shapes_win(self, size: float, error: float) -> bool:
        """Return whether shapes alone, in a file of so many bytes, may be closer than areas.

        They may be if the errors of the areas can be seen, and if a trial of as many bytes of
        shapes leaves less than twice the squared error.

        error  squared error of the areas
        """
        if self._plan.prefers_areas or error <= self.error_at(SEEN_UP_TO):
            return False
        each = SHAPE_BYTES[1] if self._plan.markup == MINIMAL else USUAL_BYTES
        count = int(min(max(size / each, TRIED), 1000))
        shapes = self.trial(nothing(self._subject.working), count)
        return shapes.error - shapes.saved < 2 * error

    def wants_gaussians(self, trial: Trial) -> bool:
        """Return whether Gaussians are fitted above the areas of a trial."""
        return self.most_above(trial) > 0 and (self._plan.aim is not None or self._pays(trial))

    def most_above(self, trial: Trial) -> float:
        """Return the largest number of Gaussians above the areas of a trial."""
        most = self.most - len(trial.ground)
        if self._pays(trial) or self._subject.start is not None:
            return most
        return min(most, MOST_ON_EDGES)

    def _pays(self, trial: Trial) -> bool:
        return trial.saved > TRIED * self._price

    def blank(self) -> Trial:
        """Return no areas and no Gaussians."""
        return self.trial(nothing(self._subject.working), 0)

    def in_short(self) -> Trial:
        """Return shapes alone, fitted in about a second for a run that ends now."""
        trial = self.blank()
        if self._plan.sketch:
            return trial
        most, pixels = self._plan.goal.count or IN_SHORT, self._small[..., 0].size
        count = min(IN_SHORT, most, self._limit / SHAPE_BYTES[0], pixels // 3)
        session = self._fitted(trial.ground, int(count), lambda: False)
        width, height = self._subject.size
        scene = session.scene().scaled(self._times, self._times).replace(width=width, height=height)
        export = self._exporter.unscored(scene)
        if export.size > self._limit:
            export = self._exporter.pruned(export, int(self._limit))
        return dataclasses.replace(trial, ground=export.scene, **vars(export))


def with_gaussians_below(
    scene: Scene, picture: NDArray[np.float32], count: int, stop: Callable[[], bool]
) -> Scene:
    """Return a scene of areas with `count` Gaussians on its page, fitted to a picture.

    These are glows and soft shadows, whose upper parts areas hide. The page is the background, or
    the first area if that covers the canvas. An area hides crisply what lies below it. So the
    Gaussians are fitted to the page as it would be without the areas, and errors count only as far
    as the page shows. If the areas add the light f to a pixel p, and let through the share s of the
    page, the page there is (p - f) / s, and a squared error of the page counts s^2 times.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    stop     function that ends the fit if it returns True
    """
    height, width = picture.shape[:2]
    scale = width / scene.width, height / scene.height
    level = int(_covers_canvas(scene))
    light, seen = np.zeros((height, width, 3)), np.ones((height, width, 1))
    draw_areas(scene.areas[level:], light, scale)
    for area in scene.areas[level:]:
        seen *= 1 - area.opacity * coverage_of(area, 0, 0, width, height, scale)[..., None]
    shows = seen > 0.05  # less of the page does not tell its colour
    if not shows.any():
        return scene
    pages = [(view - light) / np.maximum(seen, 0.05) for view in views(picture)]
    pages = [np.clip(np.where(shows, page, 0.5), 0, 1).astype(np.float32) for page in pages]
    page = from_views(*pages) if has_alpha(picture) else pages[0]
    # An error counts a million times more where all of the page shows than where none does.
    focus = Focus(np.where(shows, seen * seen, 0).astype(np.float32), 1e6)
    below = scene.replace(areas=scene.areas[:level])
    new = _fitted(page, FitOptions(tune=PSNR, falloff=GAUSSIAN), count, 120, focus, below, stop)
    new = new.scene().scaled(scene.width / width, scene.height / height)
    color, opacity = np.round(new.color * 255) / 255, np.round(new.opacity, 2)
    return new.replace(
        width=scene.width, height=scene.height, color=color, opacity=opacity,
        round_index=np.zeros_like(new.round_index), level=np.full_like(new.level, level),
        background=scene.background, transparent=scene.transparent, areas=scene.areas,
    )  # fmt: skip


def _fitted(
    picture: NDArray[np.float32], fit: FitOptions, count: int, steps: int, focus: Focus | None,
    ground: Scene, stop: Callable[[], bool],
) -> FitSession:  # fmt: skip
    """Return a short fit of `count` Gaussians to a picture, above a ground."""
    config = FitConfig(gaussians=count, iterations=steps, fit=fit)
    target = Target(picture, PSNR, mask=focus, ground=ground)
    session = FitSession(target, config, stop=stop)
    session.fit()
    return session


def _covers_canvas(scene: Scene) -> bool:
    """Return whether the first area covers the canvas."""
    if not scene.areas or scene.areas[0].is_line or scene.areas[0].opacity < 1:
        return False
    (first, *others) = scene.areas[0].outlines
    corners = {(x, y) for x in (0.0, scene.width) for y in (0.0, scene.height)}
    return not (others or any(first.curved)) and {(x, y) for x, y in first.points} == corners


def nothing(picture: NDArray[np.float32]) -> FoundAreas:
    """Return no areas, on the mean colour of a picture."""
    background = None if has_alpha(picture) else tuple(picture.mean(axis=(0, 1)).tolist())
    return FoundAreas((), background, 0.0, 0.0, 0.0, 0.0)


def without_idle(scene: Scene, error_of: Callable[[Scene], float]) -> Scene:
    """Return a scene without the areas without which its error is less.

    Such areas were strips of shading, which Gaussians draw now.
    """
    error = error_of(scene)
    for k in reversed(range(len(scene.areas))):
        areas, level = scene.areas[:k] + scene.areas[k + 1 :], scene.level
        rest = scene.replace(areas=areas, level=np.where(level > k, level - 1, level))
        if (left := error_of(rest)) < error:
            scene, error = rest, left
    return scene


def scene_of(subject: Subject, found: FoundAreas) -> Scene:
    """Return a scene of the areas, and of the Gaussians of a start that lie among them."""
    start, background = subject.start, found.background
    page = {
        "background": np.ones(3) if background is None else np.array(background),
        "transparent": background is None, "areas": found.areas,
    }  # fmt: skip
    if start is None or (start.level == ABOVE).all():
        return Scene(*subject.size, **page)
    below = scaled_to(start.select(start.level != ABOVE), subject.size)
    return below.replace(**page, level=np.minimum(below.level, len(found.areas)))


# Levels of 255 by which colours of areas may differ that become one. In a picture with noise, it is
# OFF divided by the root of the smaller one's px, within NEARLY_EQUAL (docs/decisions/areas.md).
EQUAL, NEARLY_EQUAL, OFF = 2.0, (3.0, 24.0), 128.0


def with_shared_colors(found: FoundAreas, is_noisy: bool) -> FoundAreas:
    """Return areas whose nearly equal flat colours are one, that of the larger areas.

    is_noisy  whether noise or JPEG has moved the colours of small areas
    """
    sizes: dict[Any, float] = {} if found.background is None else {found.background: math.inf}
    for area in found.areas:
        if isinstance(area.paint, tuple):
            sizes[area.paint] = sizes.get(area.paint, 0.0) + _size(area)
    shared: dict[Any, Any] = {}
    kept = np.zeros((0, 3))
    for color in sorted(sizes, key=lambda color: -sizes[color]):
        most = float(np.clip(OFF / math.sqrt(max(sizes[color], 1.0)), *NEARLY_EQUAL))
        difference = 255 * np.abs(kept - color).max(axis=1)
        if len(kept) and difference.min() <= (most if is_noisy else EQUAL):
            shared[color] = tuple(kept[difference.argmin()].tolist())
        else:
            shared[color], kept = color, np.vstack([kept, color])
    areas = tuple(
        dataclasses.replace(area, paint=shared.get(area.paint, area.paint)) for area in found.areas
    )
    return dataclasses.replace(found, areas=areas)


def _size(area: Area) -> float:
    """Return about how many px an area has, or a line."""
    total = 0.0
    for outline in area.outlines:
        x, y = outline.nodes.T
        if area.is_line:
            total += area.width * float(portable.hypot(np.diff(x), np.diff(y)).sum())
        else:
            total += 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return abs(total)


OPAQUE = 0.5  # areas of at least this opacity are drawn, and are opaque


def nearest_inks(colors: Any, inks: str) -> NDArray[np.float64]:
    """Return for each colour (n, 3) the nearest one of the inks "#rrggbb,#rrggbb,..".

    The distance is that of levels of sRGB, as in fits.
    """
    table = ink_colors(inks)
    return table[nearest_entry(table, np.asarray(colors, np.float64))[1]]


def areas_in_inks(areas: Iterable[Area], inks: str, banded: bool = False) -> tuple[Area, ...]:
    """Return opaque areas in inks. Those that are nearly transparent are left out.

    banded  whether gradients become bands of inks. Otherwise they get the ink nearest to their mean
    """

    def ink(paint: Paint) -> Paint:
        if isinstance(paint, tuple):
            return _nearest(paint, inks)
        return _banded(paint, inks) if banded else _nearest(np.mean(paint.colors, axis=0), inks)

    return tuple(
        dataclasses.replace(area, paint=ink(area.paint), opacity=1.0)
        for area in areas
        if area.opacity >= OPAQUE
    )


def found_in_inks(found: FoundAreas, inks: str) -> FoundAreas:
    """Return areas and a background that each have the nearest ink."""
    background = None if found.background is None else _nearest(found.background, inks)
    areas = areas_in_inks(found.areas, inks)
    return dataclasses.replace(found, areas=areas, background=background)


def picture_in_inks(found: FoundAreas, inks: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the picture of areas in inks, with a band of each ink in place of gradients.

    It is (h, w, 3), or (h, w, 4) without a background. Only antialiased pixels mix inks.
    """
    scene = Scene(width, height, areas=areas_in_inks(found.areas, inks, banded=True))
    if found.background is None:
        return render_rgba(scene.replace(transparent=True), width, height).astype(np.float32)
    scene = scene.replace(background=np.array(_nearest(found.background, inks)))
    return render(scene, width, height).astype(np.float32)


def sprite_in_inks(sprite: Sprite, inks: str) -> Sprite:
    """Return a sprite whose cells have their nearest inks, or are transparent."""
    colors = nearest_inks(sprite.levels[:, :3] / 255, inks)
    opaque = np.rint(255 * np.pad(colors, ((0, 0), (0, 1)), constant_values=1)).astype(np.int64)
    levels = np.where(sprite.levels[:, 3:] < 255 * OPAQUE, 0, opaque)
    levels, entry = np.unique(levels, axis=0, return_inverse=True)
    return sprite._replace(cells=entry.ravel()[sprite.cells], levels=levels)


def _nearest(color: Any, inks: str) -> Color:
    red, green, blue = nearest_inks([color], inks)[0].tolist()
    return red, green, blue


def _banded(paint: LinearGradient | RadialGradient, inks: str) -> LinearGradient | RadialGradient:
    """Return a gradient in the nearest ink at each place. Bands meet within about a pixel."""
    is_linear = isinstance(paint, LinearGradient)
    across = np.subtract(paint.end, paint.start) if is_linear else paint.radii
    half = 0.5 / max(portable.hypot(*across), 1.0)
    place = np.linspace(0, 1, 1024)
    ink = nearest_inks(paint.colors_at(place), inks)
    changes = np.flatnonzero((np.diff(ink, axis=0) != 0).any(axis=1))
    changes = changes[:: 1 + len(changes) // (MOST_STOPS // 2 - 1)]  # a band takes two stops
    middle = 0.5 * (place[changes] + place[changes + 1])
    ends = np.stack([middle - half, middle + half], axis=1).ravel()
    offsets = sorted([0.0, *np.clip(ends, 0, 1).tolist(), 1.0])
    colors = [ink[0], *(ink[k + j] for k in changes for j in (0, 1)), ink[-1]]
    return dataclasses.replace(paint, offsets=tuple(offsets), colors=tuple(map(tuple, colors)))


def kept(
    areas: tuple[Area, ...],
    before: tuple[Area, ...],
    error_of: Callable[[tuple[Area, ...]], float],
) -> tuple[Area, ...]:
    """Return areas of which those that have not changed are areas of the frame before.

    error_of  function that returns the squared error of areas
    """
    most = 1.1 * error_of(areas) + 0.15  # such a rise of the squared error is seen nowhere
    left = list(before)
    for k, area in enumerate(areas):
        old = next((one for one in left if _is_alike(one, area)), area)
        tried = (*areas[:k], old, *areas[k + 1 :])
        if old is not area and error_of(tried) <= most:
            areas = tried
            left.remove(old)
    return areas


def _is_alike(one: Area, other: Area) -> bool:
    """Return whether two areas have the same kind, and about the same box and paint."""
    if one.is_line != other.is_line or type(one.paint) is not type(other.paint):
        return False

    def features(area: Area) -> NDArray[np.float64]:
        colors = area.paint if isinstance(area.paint, tuple) else area.paint.colors
        nodes = np.concatenate([outline.nodes for outline in area.outlines])
        # A difference of 1 px counts as much as one of .06 in a colour.
        mean = np.atleast_2d(colors).mean(axis=0) / 0.06
        return np.concatenate([nodes.min(axis=0), nodes.max(axis=0), mean])

    return bool(np.abs(features(one) - features(other)).max() <= 1)
