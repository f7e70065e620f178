"""Five graphics as designers make them, drawn by script and the same in every run.

Pillow draws them at eight times the size, and each pixel is the mean of 8x8: edges are antialiased
as by an SVG renderer, and flat areas keep one colour up to the edge.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

_SIZE = 256  # px of each picture
_FINER = 8  # supersampling

Point = tuple[float, float]
_WHITE, _BLACK = "#ffffff", "#000000"


def own_pictures() -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Name and picture (h, w, 3) in 0..1, on 8 bits."""
    for name, draw in (
        ("icon", _icon),
        ("face", _face),
        ("line art", _line_art),
        ("buttons", _buttons),
        ("screenshot", _screenshot),
    ):
        yield name, np.asarray(draw().image.reduce(_FINER), np.float32) / np.float32(255)


class _Canvas:
    """A supersampled picture, drawn in px of the final one."""

    def __init__(self, colour: str) -> None:
        self.image = Image.new("RGB", (_SIZE * _FINER, _SIZE * _FINER), colour)
        self._draw = ImageDraw.Draw(self.image)

    def disc(
        self, x: float, y: float, rx: float, ry: float, fill: str, rim: str = "", width: float = 0
    ) -> None:
        """An ellipse around (x, y), with a rim inside it."""
        if width:
            self.disc(x, y, rx, ry, rim)
        rx, ry = rx - width, ry - width
        self._draw.ellipse(_finer((x - rx, y - ry), (x + rx, y + ry), inclusive=True), fill)

    def box(
        self, x0: float, y0: float, x1: float, y1: float, fill: str, radius: float = 0,
        rim: str = "", width: float = 0,
    ) -> None:  # fmt: skip
        """A rectangle with round corners, with a rim inside it."""
        if width:
            self.box(x0, y0, x1, y1, rim, radius)
        inner = (x0 + width, y0 + width), (x1 - width, y1 - width)
        rounding = max(radius - width, 0) * _FINER
        self._draw.rounded_rectangle(_finer(*inner, inclusive=True), rounding, fill)

    def polygon(self, points: Sequence[Point], fill: str) -> None:
        """A filled polygon."""
        self._draw.polygon(_finer(*points), fill)

    def stroke(self, points: Sequence[Point], width: float, colour: str = _BLACK) -> None:
        """A line through the points with round ends and joints."""
        self._draw.line(_finer(*points), colour, round(width * _FINER))
        for x, y in points:
            self.disc(x, y, width / 2, width / 2, colour)

    def text(
        self, x: float, y: float, words: str, size: float, colour: str, anchor: str = "ls"
    ) -> None:
        """Words on a baseline from (x, y), or at another anchor."""
        font = ImageFont.load_default(size * _FINER)
        self._draw.text((x * _FINER, y * _FINER), words, colour, font, anchor)

    def blend(self, layer: Image.Image | str, mask: Image.Image) -> None:
        """Composite another picture or a colour over this one by a mask."""
        self.image.paste(layer, (0, 0, *mask.size), mask)


def _finer(*points: Point, inclusive: bool = False) -> list[float]:
    """Coordinates on the supersampled canvas; inclusive: the last point is a pixel of the shape."""
    flat = [c * _FINER for point in points for c in point]
    return flat[:-2] + [flat[-2] - 1, flat[-1] - 1] if inclusive else flat


def _curve(a: Point, b: Point, c: Point, d: Point, steps: int = 48) -> list[Point]:
    """Points of a cubic Bezier curve."""
    points = []
    for i in range(steps + 1):
        t, s = i / steps, 1 - i / steps
        share = (s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t)
        x, y = (
            sum(w * p[axis] for w, p in zip(share, (a, b, c, d), strict=True)) for axis in (0, 1)
        )
        points.append((x, y))
    return points


def _arc(x: float, y: float, rx: float, ry: float, start: float, end: float) -> list[Point]:
    """Points of an ellipse's arc between angles in degrees, clockwise from the right."""
    angles = np.radians(np.linspace(start, end, 97))
    return [(x + rx * math.cos(a), y + ry * math.sin(a)) for a in angles]


def _mask(
    x0: float, y0: float, x1: float, y1: float, radius: float, drop: float = 0
) -> Image.Image:
    """White in a rounded rectangle, moved down by `drop` px."""
    mask = Image.new("L", (_SIZE * _FINER, _SIZE * _FINER))
    corners = _finer((x0, y0 + drop), (x1, y1 + drop), inclusive=True)
    ImageDraw.Draw(mask).rounded_rectangle(corners, radius * _FINER, 255)
    return mask


def _shadow(mask: Image.Image, blur: float, share: float) -> Image.Image:
    """The mask of a soft shadow of a shape with this mask."""
    blurred = mask.filter(ImageFilter.GaussianBlur(blur * _FINER))
    return blurred.point([round(v * share) for v in range(256)])


def _ramp(y0: float, y1: float, top: Sequence[float], bottom: Sequence[float]) -> Image.Image:
    """A vertical gradient between two rows, with as many channels as the ends."""
    rows = (np.arange(_SIZE * _FINER) + 0.5) / _FINER
    share = np.clip((rows - y0) / (y1 - y0), 0, 1)[:, None]
    column = np.asarray(top) * (1 - share) + np.asarray(bottom) * share
    pixels = np.repeat(np.round(column).astype(np.uint8)[:, None], _SIZE * _FINER, axis=1)
    return Image.fromarray(pixels.squeeze())


def _icon() -> _Canvas:
    """A house on a hill in a rounded square: six flat colours."""
    blue, red, cream, brown, green = "#2b7de0", "#d9403a", "#fff3d9", "#7a4a2b", "#57b04a"
    inside = _Canvas(blue)
    inside.disc(204, 60, 17, 17, cream)
    inside.disc(128, 292, 190, 110, green)
    inside.box(158, 60, 178, 104, brown)  # the chimney
    inside.box(72, 112, 184, 210, cream)
    inside.polygon([(128, 48), (214, 126), (42, 126)], red)
    inside.disc(128, 98, 12, 12, cream)
    inside.box(88, 144, 120, 176, blue, radius=4)
    inside.box(102.5, 144, 105.5, 176, cream)
    inside.box(88, 158.5, 120, 161.5, cream)
    inside.disc(153, 158, 17, 17, brown)  # a door with a round top
    inside.box(136, 158, 170, 210, brown)
    inside.disc(163, 184, 3, 3, cream)
    canvas = _Canvas(_WHITE)
    canvas.blend(inside.image, _mask(10, 10, 246, 246, radius=48))
    return canvas


def _face() -> _Canvas:
    """A laughing yellow face with a dark outline."""
    ink, yellow, cheek = "#4a2c0a", "#ffd03a", "#ff9a5c"
    canvas = _Canvas(_WHITE)
    canvas.disc(128, 128, 112, 112, yellow, ink, 5)
    for side in (-1, 1):
        canvas.disc(128 + side * 74, 146, 17, 13, cheek)
        canvas.disc(128 + side * 36, 98, 13, 19, ink)
        canvas.disc(128 + side * 36 - 4, 90, 4.5, 6, _WHITE)
        canvas.stroke(_arc(128 + side * 38, 76, 22, 15, 215, 325), 4.5, ink)
    mouth = [*_arc(128, 144, 56, 58, 0, 180)]
    opening = Image.new("L", canvas.image.size)
    ImageDraw.Draw(opening).polygon(_finer(*mouth), 255)
    inside = _Canvas("#7d1a24")
    inside.disc(128, 204, 34, 26, "#f0616d")  # the tongue
    inside.box(82, 130, 174, 157, _WHITE, radius=6)  # the teeth
    canvas.blend(inside.image, opening)
    canvas.stroke([*mouth, mouth[0]], 5, ink)
    return canvas


def _line_art() -> _Canvas:
    """A steaming mug in black pen strokes with hatching on white."""
    canvas = _Canvas(_WHITE)
    canvas.stroke(_arc(118, 210, 96, 22, 0, 360), 3)  # the saucer
    canvas.stroke(_arc(118, 213, 78, 17, 20, 160), 2)
    outer = _curve((170, 106), (240, 84), (236, 176), (160, 172))
    inner = _curve((170, 120), (212, 110), (212, 156), (164, 157))
    canvas.stroke(outer, 3)
    canvas.stroke(inner, 2.5)
    left = _curve((56, 86), (56, 140), (66, 176), (84, 202))
    right = [(236 - x, y) for x, y in left]
    bottom = _arc(118, 202, 34, 8, 180, 0)
    rim = _arc(118, 86, 62, 15, 0, 360)
    canvas.polygon([*left, *bottom, *reversed(right)], _WHITE)
    canvas.polygon(rim, _WHITE)
    for i in range(4, len(right) - 3, 2):  # the shaded side
        x, y = right[i]
        long = 26 + 9 * math.sin(i * 0.9)
        canvas.stroke([(x - 1, y), (x - long, y + 0.45 * long)], 2)
        if i > 22:
            canvas.stroke([(x - 2, y), (x - 0.6 * long, y - 0.7 * long)], 2)
    for points in (left, right, bottom, rim):
        canvas.stroke(points, 3.5)
    canvas.stroke(_arc(118, 91, 52, 9, 180, 360), 2)  # the coffee
    for x, height, width in ((92, 46, 2), (118, 58, 3), (144, 42, 2)):
        top = 64 - height
        curl = _curve((x, 66), (x + 20, 64 - height / 3), (x - 22, 64 - height / 2), (x + 4, top))
        canvas.stroke(curl, width)
    for i in range(4):  # the saucer's shadow
        y, start = 226 + 6 * i, 176 - 26 * i
        canvas.stroke([(start, y), (start + 66 - 9 * (i % 2), y)], 2)
    return canvas


def _buttons() -> _Canvas:
    """Two glossy buttons with vertical gradients, soft shadows and labels."""
    canvas = _Canvas("#eef1f5")
    for box, radius, rim, top, bottom, words, ink, size in (
        ((20, 46, 236, 130), 22, "#174ea6", (104, 178, 255), (24, 92, 214), "Download", _WHITE, 32),
        ((62, 166, 194, 212), 23, "#9aa3ad", (255, 255, 255), (203, 210, 218), "Cancel", "#3c4650",
         20),
    ):  # fmt: skip
        x0, y0, x1, y1 = box
        canvas.blend("#1c2a3c", _shadow(_mask(*box, radius, drop=5), blur=5, share=0.45))
        canvas.box(*box, rim, radius)
        inner = (x0 + 1.5, y0 + 1.5, x1 - 1.5, y1 - 1.5)
        canvas.blend(_ramp(y0, y1, top, bottom), _mask(*inner, radius - 1.5))
        half = (y0 + y1) / 2
        gloss = _mask(x0 + 5, y0 + 4, x1 - 5, half, min(radius - 4, (half - y0 - 4) / 2))
        fading = _ramp(y0, half, (150,), (45,))
        canvas.blend(_WHITE, Image.composite(fading, Image.new("L", fading.size), gloss))
        middle = ((x0 + x1) / 2, half)
        if ink == _WHITE:
            canvas.text(middle[0], middle[1] + 1.5, words, size, "#123f8c", "mm")
        canvas.text(*middle, words, size, ink, "mm")
    return canvas


_LINES = (
    "Dear all,",
    "the new drawings are in the folder of",
    "the project. Please look at the icons",
    "first: edges should be crisp, and the",
    "white paper around them clean.",
    "",
    "We meet on Monday at 10:30, room 4B.",
    "Bring 2 or 3 sketches each.",
)
_MARKED = 6  # the line that is highlighted


def _screenshot() -> _Canvas:
    """A window with a title bar, lines of text, one of them highlighted, and buttons."""
    canvas = _Canvas("#4f6d8f")
    canvas.blend(_BLACK, _shadow(_mask(10, 10, 246, 246, 9, drop=3), blur=3, share=0.5))
    canvas.box(10, 10, 246, 246, "#fbfbfa", radius=9, rim="#8c939b", width=1)
    canvas.box(11, 11, 245, 40, "#e3e6ea", radius=8)
    canvas.box(11, 26, 245, 40, "#e3e6ea")
    canvas.box(11, 40, 245, 41, "#b9bfc6")
    for i, colour in enumerate(("#ed6a5e", "#f4bf4f", "#61c554")):
        canvas.disc(25 + 15 * i, 26, 5, 5, colour)
    canvas.text(138, 26, "Message", 12, "#3b4048", "mm")
    for i, line in enumerate(_LINES):
        baseline = 63 + 18 * i
        if i == _MARKED:
            canvas.box(18, baseline - 13, 230, baseline + 5, "#2f6fd6")
        canvas.text(22, baseline, line, 11, _WHITE if i == _MARKED else "#24282d")
    canvas.box(235, 46, 241, 204, "#e9ebee", radius=3)
    canvas.box(235, 46, 241, 110, "#aeb5bd", radius=3)
    canvas.box(172, 212, 234, 236, "#ffffff", radius=5, rim="#8c939b", width=1)
    canvas.text(203, 224, "Reply", 12, "#24282d", "mm")
    canvas.box(104, 212, 164, 236, "#2f6fd6", radius=5)
    canvas.text(134, 224, "Archive", 12, _WHITE, "mm")
    return canvas


def flat_faces() -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Name and picture of two faces of few flat colours, as the demonstrations of LIVE have."""
    smile = _Canvas(_WHITE)
    smile.disc(128, 128, 108, 108, "#ffcc33", rim="#3b2a10", width=6)
    for x in (90, 166):
        smile.disc(x, 100, 13, 20, "#3b2a10")
    smile.stroke(_arc(128, 138, 62, 52, 15, 165), 9, "#3b2a10")
    bear = _Canvas("#cfe8f5")
    for x in (68, 188):
        bear.disc(x, 72, 36, 36, "#8a5a33")
        bear.disc(x, 72, 20, 20, "#e3b98f")
    bear.disc(128, 138, 92, 86, "#8a5a33")
    bear.disc(128, 168, 46, 38, "#e3b98f")
    bear.disc(128, 152, 15, 11, _BLACK)
    for x in (94, 162):
        bear.disc(x, 118, 10, 12, _BLACK)
        bear.disc(x + 3, 113, 3, 3, _WHITE)
    bear.stroke(_arc(128, 172, 22, 14, 20, 160), 4)
    for name, canvas in (("smile", smile), ("bear", bear)):
        yield name, np.asarray(canvas.image.reduce(_FINER), np.float32) / np.float32(255)
