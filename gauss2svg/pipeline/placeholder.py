"""Placeholders: an SVG of about a kilobyte that a page shows until its photo has come."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.options import OneOf, byte_size
from gauss2svg.photo.alpha import alpha_of, has_alpha, pixels_of
from gauss2svg.photo.load import ImageSource
from gauss2svg.pipeline.options import Goal, Options, RunOptions, SvgOptions
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, Plan
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.pipeline.run import ProgressCallback, Run
from gauss2svg.pipeline.search.drawing import search_by_bytes
from gauss2svg.pipeline.search.outcome import Watch
from gauss2svg.pipeline.search.subject import Subject
from gauss2svg.svg.document import MINIMAL
from gauss2svg.svg.element import hex_color

DEFAULT_BYTES = 1000
# Attributes of Placeholder of which the bytes may be limited.
Counted = Literal["svg", "inline", "data_uri", "data_uri_base64"]
# px of the photo, from which the working picture of at most 384 px is made.
_LONGEST_SIDE = 640
# What browsers take as it is in a data URI; % and # have a meaning of their own, and " would end
# the attribute or the url("") that holds it (docs/decisions/small.md).
_UNESCAPED = " !$&'()*+,/:;<=>?@[]^`{|}"
_MEDIA_TYPE = "image/svg+xml"
# Where a minimal file names an element or refers to one.
_IDS = re.compile(r'(?<=id=")|(?<=href="#)|(?<=url\(#)')


@dataclass(frozen=True)
class Placeholder:
    """A small SVG that stands for a photo until the photo is loaded.

    svg            text of the file
    width, height  px of the photo; the SVG has its proportions
    color          mean colour of the photo's visible pixels, such as #8a7f6d
    gaussians      number of Gaussians; 0 where the bytes leave room for none
    transparent    whether the photo has alpha
    """

    svg: str
    width: int
    height: int
    color: str
    gaussians: int
    transparent: bool = False

    @property
    def inline(self) -> str:
        """The SVG for a page's own markup: its ids are no other file's. 50 to 90 bytes longer."""
        own = "g" + hashlib.sha256(self.svg.encode()).hexdigest()[:5]
        return _IDS.sub(own, self.svg)

    @property
    def data_uri(self) -> str:
        """The SVG as the shortest data URI that browsers take in src="" and in CSS url("")."""
        plain = "'" if "'" not in self.svg else '"'
        return f"data:{_MEDIA_TYPE}," + quote(self.svg.replace('"', plain), safe=_UNESCAPED)

    @property
    def data_uri_base64(self) -> str:
        """The SVG as a data URI in base64, for wherever the shorter `data_uri` is refused."""
        return f"data:{_MEDIA_TYPE};base64," + base64.b64encode(self.svg.encode()).decode()

    def record(self, name: str) -> dict[str, Any]:
        """The keys of SQIP's result and `transparent`, ready for JSON; name is the file's."""
        return {
            "content": self.inline,
            "metadata": {
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
            },
        }

    def snippet(self, source: str, alt: str = "") -> str:
        """An HTML <img> of the photo with the placeholder behind it, at most as wide as its place.

        source  URL of the photo, escaped as URLs are
        alt     what the photo shows, for those who do not see it

        Its width and height keep the room for the photo. The placeholder of a photo with alpha,
        which would shine through, goes when the photo has come, by an onload attribute.
        """
        size = f'width="{self.width}" height="{self.height}"'
        color = "" if self.transparent else f"{self.color} "
        style = f'max-width:100%;height:auto;background:{color}url("{self.data_uri}") 0 0/100% 100%'
        gone = " onload=\"this.style.background='none'\"" if self.transparent else ""
        return (
            f'<img src="{_in_attribute(source)}" alt="{_in_attribute(alt)}" {size} '
            f'style="{_in_attribute(style)}"{gone}>'
        )

    def picture(self, source: str, others: Mapping[str, str], alt: str = "") -> str:
        """An HTML <picture> of the `snippet`, for which a browser may take another file.

        others  media types of the other files of the photo by their URLs, the best first:
                {"a.avif": "image/avif"}
        """
        found = "".join(
            f'<source srcset="{_in_attribute(url)}" type="{_in_attribute(kind)}">'
            for url, kind in others.items()
        )
        return f"<picture>{found}{self.snippet(source, alt)}</picture>"


def _in_attribute(text: str) -> str:
    """Text as the value of an HTML attribute in double quotes, in which < and > may stand."""
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
    """The best SVG of at most max_bytes for a photo, such as 1000 or "1k"; see `vectorize`.

    image                path, bytes, binary file, PIL image, numpy array or torch tensor
    bytes_of             attribute of the placeholder that max_bytes limits, such as "data_uri"
    threads, max_memory  see RunOptions
    progress, stop       see `vectorize`
    Raises InputError for invalid input, for more than 20 kB, and for fewer bytes than a file
    without Gaussians takes.
    """
    limit = check_bytes("max_bytes", max_bytes)
    OneOf(get_args(Counted))("bytes_of", bytes_of)
    options = Options(
        goal=Goal(max_bytes=limit),
        svg=SvgOptions(markup=MINIMAL),
        run=RunOptions(threads=threads, max_memory=max_memory),
    )

    def count(svg: str) -> int:
        return len(getattr(Placeholder(svg, 1, 1, "", 0), bytes_of).encode())

    with watched(progress) as callback:
        plan, run = Plan(options, by_bytes=True), Run(options.run, callback, stop)
        photo = run.read(*run.opened(image), needed=_LONGEST_SIDE)
        pixels = pixels_of(photo)
        with run.compiled():
            watch = Watch(report=run.notify, stop=run.stop)
            found = search_by_bytes(plan, Subject.of(pixels, photo.full), watch, count).file()
    transparent = has_alpha(pixels)
    return Placeholder(found.svg, *photo.full, _mean_color(pixels), len(found.scene), transparent)


def _mean_color(pixels: NDArray[np.float32]) -> str:
    """The mean colour of what is visible."""
    transparent = has_alpha(pixels)
    weight = alpha_of(pixels) if transparent else np.ones((*pixels.shape[:2], 1), np.float32)
    total = max(float(weight.sum(dtype=np.float64)), 1e-9)
    mean = (pixels[:, :, :3] * weight).sum(axis=(0, 1), dtype=np.float64) / total
    return hex_color(np.round(255 * mean).astype(np.intp))


def check_bytes(name: str, value: Any) -> int:
    """Bytes of a placeholder; raises InputError that names it."""
    size = byte_size(name, value)
    if size > MINIMAL_UP_TO:
        raise InputError(
            f"{name} must be at most {MINIMAL_UP_TO} bytes for a placeholder; got "
            f"{quoted(value)}. Try {MINIMAL_UP_TO}"
        )
    return size
