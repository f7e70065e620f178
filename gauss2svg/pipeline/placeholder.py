"""Placeholders: SVGs of about a kilobyte that a page shows until its photos are loaded."""

from __future__ import annotations

import base64
import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.texture import may_have_areas
from gauss2svg.errors import quoted, refusal, several
from gauss2svg.options import Field, byte_size
from gauss2svg.photo.load import ImageSource
from gauss2svg.photo.pixels import Size, averaged, elongation, has_alpha, shrunk
from gauss2svg.pipeline.by_bytes import ByBytes
from gauss2svg.pipeline.options import ALWAYS, Options, ProgressCallback
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, Plan
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.svg import MINIMAL, NAMESPACE, signed
from gauss2svg.svg.element import hex_color, with_own_ids
from gauss2svg.svg.file import image as html_image

DEFAULT_BYTES = 1000
# Attributes of Placeholder whose bytes may be limited.
Counted = Literal["svg", "inline", "data_uri", "data_uri_base64"]
# Characters that browsers accept in a data URI without escapes. The characters % and # are missing,
# because they have a meaning in URIs. The character " is missing, because it would end the
# attribute or the url("") that contains the URI (docs/decisions/small.md).
_UNESCAPED = " !$&'()*+,/:;<=>?@[]^`{|}"
_MEDIA_TYPE = "image/svg+xml"


@dataclass(frozen=True)
class Placeholder:
    """A small SVG that stands for a photo until the photo is loaded.

    svg            text of the file
    width, height  size of the photo in px. The SVG has the same proportions
    color          mean colour of the photo's visible pixels, such as #8a7f6d
    gaussians      number of Gaussians in the SVG. 0 if areas draw all of it, or if the limit leaves
                   no bytes for them
    transparent    whether the photo has alpha
    areas          number of areas and lines in the SVG
    """

    svg: str
    width: int
    height: int
    color: str
    gaussians: int
    transparent: bool = False
    areas: int = 0

    @classmethod
    def of(cls, svg: str, scene: Scene, size: Size, pixels: NDArray[np.float32]) -> Placeholder:
        """Return the placeholder of a photo of this size in px.

        svg, scene  text of the file, and the scene that it draws
        pixels      photo at any size, (h, w, 3) or (h, w, 4) in 0..1
        """
        mean = shrunk(pixels, 1, 1)[0, 0, :3]  # mean of the visible pixels
        color = hex_color(np.round(255 * mean).astype(np.intp))
        return cls(svg, *size, color, len(scene), has_alpha(pixels), len(scene.areas))

    @property
    def inline(self) -> str:
        """SVG to paste into an HTML page.

        Its ids begin with a hash of the file, so that several placeholders can be in one page. This
        makes the text up to 60 bytes longer than `svg`.
        """
        return with_own_ids(self.svg)

    @property
    def data_uri(self) -> str:
        """SVG as the shortest data URI that browsers accept in src="" and in CSS url("")."""
        svg = self.svg.replace(signed(NAMESPACE), NAMESPACE)
        plain = "'" if "'" not in svg else '"'
        return f"data:{_MEDIA_TYPE}," + quote(svg.replace('"', plain), safe=_UNESCAPED)

    @property
    def data_uri_base64(self) -> str:
        """SVG as a data URI in base64, for programs that do not accept the shorter `data_uri`."""
        return f"data:{_MEDIA_TYPE};base64," + base64.b64encode(self.svg.encode()).decode()

    def _repr_html_(self) -> str:
        return html_image(self.svg.encode(), _MEDIA_TYPE, "placeholder")

    def __repr__(self) -> str:
        areas = f"{several(self.areas, 'area')}, " * bool(self.areas)
        shapes = areas + several(self.gaussians, "Gaussian")
        size = f"{self.width}x{self.height}"
        return f"<gauss2svg.Placeholder {size}, {shapes}, {len(self.svg.encode())} bytes>"

    def record(self, name: str) -> dict[str, Any]:
        """Return a dict for JSON. It has the keys of a result of SQIP, and the key `transparent`.

        name  name of the photo's file
        """
        metadata = {
            "filename": name,
            "originalWidth": self.width,
            "originalHeight": self.height,
            "width": self.width,
            "height": self.height,
            "type": "svg",
            "mimeType": _MEDIA_TYPE,
            "backgroundColor": self.color,
            "transparent": self.transparent,
            "dataURI": self.data_uri,
            "dataURIBase64": self.data_uri_base64,
        }
        return {"content": self.inline, "metadata": metadata}

    def snippet(self, source: str, alt: str = "") -> str:
        """Return an HTML <img> of the photo that has the placeholder as its background.

        source  URL of the photo, percent-encoded where needed
        alt     description of the photo, for readers who do not see it

        The width and height of the <img> reserve the space of the photo, but the <img> is never
        wider than its container. If the photo has alpha, the placeholder would be visible behind
        the loaded photo, so an onload attribute removes it.
        """
        color = "" if self.transparent else f"{self.color} "
        # If object-fit: cover crops the photo, center/cover crops the placeholder alike.
        style = f'max-width:100%;height:auto;background:{color}url("{self.data_uri}") center/cover'
        gone = " onload=\"this.style.background='none'\"" if self.transparent else ""
        shown = f'src="{_in_attribute(source)}" alt="{_in_attribute(alt)}"'
        size = f'width="{self.width}" height="{self.height}"'
        return f'<img {shown} {size} style="{_in_attribute(style)}"{gone}>'

    def picture(self, source: str, others: Mapping[str, str], alt: str = "") -> str:
        """Return an HTML <picture> that contains the `snippet` and other files of the photo.

        The browser loads the first file that it supports.

        others  media types of the other files by their URLs, the preferred file first:
                {"a.avif": "image/avif"}
        """
        sources = ""
        for url, kind in others.items():
            sources += f'<source srcset="{_in_attribute(url)}" type="{_in_attribute(kind)}">'
        return f"<picture>{sources}{self.snippet(source, alt)}</picture>"


def _in_attribute(text: str) -> str:
    """Escape text for an HTML attribute in double quotes, in which < and > need no escape."""
    return text.replace("&", "&amp;").replace('"', "&quot;")


def placeholder(
    image: ImageSource,
    max_bytes: int | str = DEFAULT_BYTES,
    *,
    bytes_of: Counted = "svg",
    threads: int | None = None,
    max_memory: int | str | None = None,
    progress: ProgressCallback | bool | None = None,
    stop: Callable[[], bool] | None = None,
) -> Placeholder:
    """Return a placeholder for a photo: the best SVG of at most max_bytes bytes.

    image                path, bytes, binary file, PIL image, numpy array or torch tensor
    max_bytes            limit such as 1000 or "1k", at most 20 kB
    bytes_of             attribute of the placeholder whose bytes are limited, such as "data_uri"
    threads, max_memory  see RunOptions
    progress, stop       see `vectorize`
    Raise InputError for invalid input, if max_bytes is more than 20 kB, and if it is less than a
    file without Gaussians needs.
    """
    limit = check_bytes("max_bytes", max_bytes)
    Field("bytes_of", words=get_args(Counted)).checked(bytes_of)
    options = Options().changed(
        max_bytes=limit, markup=MINIMAL, threads=threads, max_memory=max_memory
    )

    def count(svg: str) -> int:
        return len(getattr(Placeholder(svg, 1, 1, "", 0), bytes_of).encode())

    with watched(progress) as callback:
        run = Run(options.run, callback, stop)
        photo = run.read(image, needed=_size_read)
        pixels = photo.pixels
        subject = Subject(pixels, pixels, photo.original_size, bytes_of=count)
        has_areas = may_have_areas(pixels)
        with run.threaded():
            best = ByBytes(Plan(options), subject, run).run()
            if has_areas and not run.ended:
                # Imported here because it loads the kernels of areas.
                from gauss2svg.pipeline.by_areas import ByAreas

                small = dataclasses.replace(subject, working=_small(pixels, limit))
                other = ByAreas(Plan(options.changed(areas=ALWAYS)), small, run).run()
                if other.file.size <= limit:
                    best = max(best, other, key=attrgetter("psnr"))
    return Placeholder.of(best.file.svg, best.file.scene, photo.original_size, pixels)


def _small(pixels: NDArray[np.float32], limit: int) -> NDArray[np.float32]:
    """Return a picture reduced to the detail that areas have in so many bytes.

    At 285 px for 1000 bytes, areas are found in half of the time, and are as close.
    """
    height, width = pixels.shape[:2]
    scale = 9 * math.sqrt(limit) * elongation(width, height) / max(height, width)
    if scale >= 1:
        return pixels
    return averaged(pixels, max(1, round(scale * height)), max(1, round(scale * width)))


def _size_read(width: int, height: int) -> Size:
    """Return the size to which a photo is reduced while it is read: 640 px for its longest side.

    A strip has as many pixels. For the fits it is usually reduced further.
    """
    scale = min(1.0, 640 * elongation(width, height) / max(width, height))
    return max(1, round(scale * width)), max(1, round(scale * height))


def check_bytes(name: str, value: Any) -> int:
    """Return the limit of a placeholder as a number of bytes.

    Raise InputError if `value` is not a valid limit. The error names the option `name`.
    """
    size = byte_size(name, value)
    if size > MINIMAL_UP_TO:
        needed = f"at most {MINIMAL_UP_TO} bytes for a placeholder"
        raise refusal(name, needed, quoted(value), str(MINIMAL_UP_TO))
    return size
