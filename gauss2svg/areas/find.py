"""Find the areas and lines of a picture."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas import clean, lines, merge, outlines, regions, thin
from gauss2svg.areas.arrays import Bools, Content, Floats, Ints
from gauss2svg.areas.paint import LEAST_OPACITY, Paint, opacity_of, paints_of
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.regions import Regions
from gauss2svg.scene.areas import CAPS, Area, Outline

RATE = 0.0012  # squared error that a byte of an area must save
# Least squared error that a byte of an outline must save, for each unit of the median squared error
# of pixels along outlines, because nodes that follow antialiasing save some too
PRICE_OF_SCATTER = 27.0
# The same if edges are soft, because no window makes the drawing quite as soft
PRICE_IF_SOFT = 100.0
UNIT = 1 / 32  # px of path data
STEPS = 20  # steps of refinement before nodes are merged, and after each time that they are


class NoDrawingError(Exception):
    """A picture has so many cores that it is no drawing."""


@dataclass(frozen=True)
class FoundAreas:
    """The areas of a picture.

    areas       from the lowest to the highest one, in px of the picture
    background  (3,) sRGB colour below them, or None if the picture is transparent there
    explained   share of the pixels whose colour the areas draw
    psnr        PSNR in dB of their exact raster against the picture, as soft as it is
    find_s, refine_s  seconds in which they were found, and in which they were refined
    window      half of the window that makes the edges of the picture soft. None: they are crisp
    drawing     the same areas as arrays, from which `refined` goes on
    """

    areas: tuple[Area, ...]
    background: tuple[float, float, float] | None
    explained: float
    psnr: float
    find_s: float
    refine_s: float
    window: Floats | None = None
    drawing: Drawing | None = field(default=None, repr=False, compare=False)


# Function that is called at every step, with the share of the steps that are done, and a function
# that returns the areas as they are. It is None until the first areas are found. An exception ends
# the search.
Progress = Callable[[float, Callable[[], FoundAreas] | None], None]

# Function that is called before outlines are found, with the squared error that areas will have,
# and with the number of px between different regions. An exception ends the search.
Glance = Callable[[float, int], None]


def find_areas(
    picture: NDArray[np.float32],
    rate: float = RATE,
    unit: float = UNIT,
    progress: Progress | None = None,
    shaded: bool = False,
    most_cores: int | None = None,
    glance: Glance = lambda error, edges: None,
    focus: Floats | None = None,
    is_clean: bool = False,
) -> FoundAreas:
    """Return the areas and lines that draw a picture (h, w, 3), or (h, w, 4) with straight alpha.

    rate  squared error, summed over the pixels and channels, that each byte must save
    unit  user unit in px of the file for which nodes are counted
    shaded  whether shading without crisp edges is left to Gaussians
    most_cores  raise NoDrawingError if the picture has more cores. None: never
    focus  (h, w) weights of the errors of pixels, of mean 1. None: all are 1
    is_clean  whether no JPEG and no filter that overshoots has changed the picture
    """
    started = time.perf_counter()
    poll = (lambda: None) if progress is None else (lambda: progress(0.0, None))
    channels = channels_of(picture)
    content = Content.of(channels)
    drawing = first_drawing(
        channels, content, unit, rate, shaded, most_cores, poll, glance, is_clean
    )
    drawing.focus = None if focus is None else focus[drawing.content.box]
    drawing.is_clean = is_clean
    drawing.soften()
    # Faint layers are not even refined. Before that, the others save less than they will.
    layers = merge.without_cheap(drawing, unit, min(max(0.0015, rate), 0.004))
    drawing = drawing.with_layers(layers, is_tied=False)
    find_s = time.perf_counter() - started
    return refined(drawing, rate, unit, progress, STEPS, find_s)


def refined(
    drawing: Drawing, rate: float, unit: float, progress: Progress | None = None,
    steps: int = STEPS, find_s: float = 0.0, refine_s: float = 0.0,
) -> FoundAreas:  # fmt: skip
    """Refine a drawing, merge its nodes, and leave out what does not pay. Return its areas.

    steps  of the refinement before nodes are merged. With 0, a drawing that was refined for a lower
           rate gets fewer areas and nodes
    find_s, refine_s  seconds that the search has taken before
    """
    started = time.perf_counter()
    # In larger pictures, first outlines are off by a smaller part of what is seen.
    share = min(1.0, 320 / math.sqrt(math.prod(drawing.shape[:2])))
    steps, later = round(share * steps), max(6, round(share * STEPS))
    whole, done = steps + 4 * later, 0

    def so_far() -> FoundAreas:
        """Return the areas as they are now."""
        areas, background = shown_areas(drawing)
        error = ((drawing.draw() - drawing.picture) ** 2).mean(axis=-1)
        part = error.size / math.prod(drawing.content.shape)
        explained = 1 - part * float((3 * error > 0.01).mean())
        psnr = -10 * portable.log10(max(part * float(error.mean()), 1e-12))
        taken_s = refine_s + time.perf_counter() - started
        return FoundAreas(
            areas, background, explained, psnr, find_s, taken_s, drawing.window, drawing
        )

    def refine(count: int) -> None:
        nonlocal done

        def on_step(k: int) -> None:
            if progress is not None:
                progress((done + k) / whole, so_far)

        drawing.refine(count, on_step=on_step)
        done += count

    first = drawing.layers
    refine(steps)
    layers = merge.without_cusps(drawing.current(), first)
    if layers is not None:
        drawing = drawing.with_layers(layers)
        refine(later)
    for _ in range(2):
        price = rate
        if drawing.window is not None:
            price = max(rate, PRICE_IF_SOFT * drawing.scatter)
        elif drawing.is_clean:
            price = max(rate, PRICE_OF_SCATTER * drawing.scatter)
        drawing = drawing.with_layers(merge.merged(drawing, unit, price))
        refine(later)
    drawing = drawing.with_layers(merge.without_cheap(drawing, unit, rate))
    drawing = drawing.with_layers(merge.with_caps(drawing, rate))
    drawing = drawing.with_layers(merge.without_kinks(drawing))
    refine(later)
    return so_far()


def channels_of(picture: NDArray[np.float32]) -> Floats:
    """Return the channels (h, w, 3) of an opaque picture, or (h, w, 6) of one with alpha."""
    pixels = np.asarray(picture, np.float32)
    if pixels.shape[2] == 3 or pixels[..., 3].min() >= 1 - LEAST_OPACITY:
        return np.ascontiguousarray(pixels[..., :3])
    return both_views(pixels)


def steps_of(picture: NDArray[np.float32]) -> float:
    """Return the sum of the squared steps between neighbouring pixels, for three channels."""
    channels = channels_of(picture)
    steps = sum(float((np.diff(channels, axis=axis) ** 2).sum()) for axis in (0, 1))
    return 3 / channels.shape[2] * steps


def both_views(picture: Floats) -> Floats:
    """Return the channels (h, w, 6) of a picture (h, w, 4) with straight alpha."""
    over_black, alpha = picture[..., :3] * picture[..., 3:], picture[..., 3:]
    return np.concatenate([over_black, over_black + 1 - alpha], axis=-1)


def first_drawing(
    picture: Floats, content: Content, unit: float, rate: float, shaded: bool,
    most_cores: int | None, poll: Callable[[], None], glance: Glance, is_clean: bool = False,
) -> Drawing:  # fmt: skip
    """Return a drawing of the content of a picture, whose outlines have not been refined yet.

    poll  function that is called often. An exception ends the search
    """
    poll()
    is_clean = is_clean and regions.is_even(picture)
    whole, picture = picture, np.ascontiguousarray(picture[content.box])
    cores = regions.cores_of(picture, is_clean)
    pixels = clean.with_even_photos(picture, cores)
    if shaded:
        pixels = clean.without_shading(pixels)
    if pixels is not picture:
        cores = regions.cores_of(pixels, is_clean)
    poll()
    cores = regions.without_edge_shades(pixels, cores)
    count = cores.max() + 1
    poll()
    if most_cores is not None and count > most_cores:
        raise NoDrawingError
    if not count:  # no two pixels are alike
        ground = Paint(np.median(pixels, axis=(0, 1)))
        return Drawing(pixels, ground, [], [], picture=picture, content=content)
    paints = paints_of(pixels, cores)
    poll()
    if content.margin is not None and paints[cores[content.margin]].is_shaded:
        # What fades into the margins needs all of them to tell its gradient.
        content = Content.whole(whole.shape)
        return first_drawing(whole, content, unit, rate, shaded, most_cores, poll, glance, is_clean)
    parts = Regions.of(pixels, cores, paints)
    letter_ground = thin.add_letters(parts)
    poll()
    thin.add_thin_regions(parts)
    glance(*error_and_edges_of(picture, parts))
    weight_at = outlines.contrast_of(pixels)
    strokes = lines.take_lines(parts, weight_at, unit, rate, letter_ground, poll)
    strokes = lines.with_sure_widths(parts, strokes)
    labels = regions.join_touching(parts)
    opacity = np.array([opacity_of(paint.color) for paint in paints])
    ground = ground_of(labels, paints, opacity, content)
    is_ground = np.array([paint is ground for paint in paints]) | (opacity < LEAST_OPACITY)
    is_opaque = opacity > 1 - 2 * LEAST_OPACITY
    layers, curve_rate = [], min(rate, RATE)  # coarse first curves would be refined less well
    for region, share, box in regions.masks_of(labels, parts, is_ground, ~is_opaque):
        poll()
        contours = outlines.contours_of(share, box, pixels.shape)
        if paths := [outlines.first_path(c, weight_at, unit, curve_rate) for c in contours]:
            layers.append(Layer(region, paths))
    layers += lines.grouped(strokes, paints)
    paints = with_opacity(paints, opacity, is_opaque)
    return Drawing(pixels, ground, paints, layers, False, picture, content=content)


def error_and_edges_of(picture: Floats, parts: Regions) -> tuple[float, int]:
    """Return the squared error of the paints of regions, and the number of px between regions."""
    label, largest = parts.label[..., 0], parts.largest
    off = np.array([paint.color for paint in parts.paints], np.float32)[label]
    for k, paint in enumerate(parts.paints):
        if paint.is_shaded:
            ys, xs = np.nonzero(label == k)
            off[ys, xs] = paint.at(xs, ys)
    off -= picture
    squared = np.where(parts.share[..., 0] == 1, (off**2).sum(axis=2), parts.error)
    edges = np.count_nonzero(np.diff(largest)) + np.count_nonzero(np.diff(largest, axis=0))
    return float(squared.sum(dtype=np.float64)), int(edges)


def transparent_paint() -> Paint:
    """Return the paint of pixels that are transparent: black over black, and white over white."""
    return Paint(np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]))


def ground_of(labels: Ints, paints: list[Paint], opacity: Floats, content: Content) -> Paint:
    """Return the paint below all layers.

    It is that of the margins, or else that of the regions along more than half of the picture's
    border, or else that of the largest region. A picture with alpha has a transparent one.
    """
    if len(paints[0].color) == 6:
        clear = (paints[k] for k in np.flatnonzero(opacity < LEAST_OPACITY))
        return next(clear, transparent_paint())
    if content.margin is not None:
        return paints[labels[content.margin]]
    border = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
    paint, along = Counter(paints[k] for k in border.tolist()).most_common(1)[0]
    if along > 0.5 * len(border):
        return paint
    return paints[int(np.bincount(labels.ravel()).argmax())]


def with_opacity(paints: list[Paint], opacity: Floats, is_opaque: Bools) -> list[Paint]:
    """Return paints in which partly transparent colours are multiplied by their opacity.

    Until here, a colour is what shows over black and over white. Paints that are shared stay so.
    """
    new: dict[int, Paint] = {}
    for paint, alpha, hides in zip(paints, opacity, is_opaque, strict=True):
        if not hides and id(paint) not in new:
            over_black = np.tile(paint.color[:3], 2)
            new[id(paint)] = Paint(over_black, opacity=max(float(alpha), LEAST_OPACITY))
    return [new.get(id(paint), paint) for paint in paints]


def on_page(segments: Floats, width: int, height: int) -> Floats:
    """Return segments (k, 4, 2) whose points beside an edge of the page lie on that edge.

    A seam would show there otherwise.
    """
    for edge in np.zeros(2), np.array([width, height]):
        segments = np.where(np.abs(segments - edge) <= 0.06, edge, segments)
    return segments


def whole_raster(drawing: Drawing) -> NDArray[np.float32]:
    """Return the raster (h, w, c) of a drawing and of the margins around it."""
    drawn, content = drawing.draw(), drawing.content
    raster = np.empty((*content.shape, drawn.shape[2]), np.float32)
    raster[:] = drawn[content.margin or (0, 0)]
    raster[content.box] = drawn
    return raster


def shown_areas(drawing: Drawing) -> tuple[tuple[Area, ...], tuple[float, float, float] | None]:
    """Return the areas of a drawing as they are now, and the colour below them."""
    (h, w), corner, areas = drawing.content.shape, drawing.content.corner, []
    for layer in drawing.current():
        paint = drawing.paints[layer.paint]
        opacity = round(paint.opacity, 2)
        color = np.clip(paint.color.reshape(-1, 3).mean(axis=0) / paint.opacity, 0, 1)
        shown = tuple(np.round(color * 255) / 255)
        if paint.gradient is not None:
            shown = paint.gradient.moved(*corner)
        outlines = tuple(
            Outline.of_segments(on_page(p.segments + corner, w, h), p.curved, p.closed)
            for p in layer.paths
        )
        areas.append(Area(outlines, shown, opacity, layer.width, CAPS[layer.cap]))
    background = None
    if drawing.shape[2] == 3:
        background = tuple((np.round(drawing.ground.color * 255) / 255).tolist())
        if drawing.ground.gradient is not None:
            page = Outline(((0, 0), (w, 0), (w, h), (0, h)), (False,) * 4)
            areas.insert(0, Area((page,), drawing.ground.gradient.moved(*corner)))
    return tuple(areas), background
