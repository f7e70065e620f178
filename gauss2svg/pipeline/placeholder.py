"""Placeholders: SVGs of about a kilobyte that a page shows until its photos are loaded."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Field, byte_size
from gauss2svg.photo.load import ImageSource
from gauss2svg.photo.pixels import has_alpha, pixels_of, shrunk
from gauss2svg.pipeline.by_bytes import ByBytes
from gauss2svg.pipeline.options import Options, ProgressCallback
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, Plan
from gauss2svg.pipeline.run import Run, watched
from gauss2svg.svg import MINIMAL
from gauss2svg.svg.element import hex_color

DEFAULT_BYTES = 1000
# Attributes of Placeholder whose bytes may be limited.
Counted = Literal["svg", "inline", "data_uri", "data_uri_base64"]
# px, longest side to which the photo is reduced while it is read. It is then reduced further, to
# the working picture of at most 384 px.
_LONGEST_SIDE = 640
# Characters that browsers accept unescaped in a data URI. % and # have a meaning in URIs, and "
# would end the attribute or the url("") that holds the URI (docs/decisions/small.md).
_UNESCAPED = " !$&'()*+,/:;<=>?@[]^`{|}"
_MEDIA_TYPE = "image/svg+xml"
# Positions at which a minimal file names an element or refers to one.
_IDS = re.compile(r'(?<=id=")|(?<=href="#)|(?<=url\(#)')


@dataclass(frozen=True)
class Placeholder:
    """A small SVG that stands for a photo until the photo is loaded.

    svg            text of the file
    width, height  size of the photo in px. The SVG has the same proportions
    color          mean colour of the photo's visible pixels, such as #8a7f6d
    gaussians      number of Gaussians, 0 if the bytes suffice for none
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
        """SVG to paste into a page, with ids of its own that make it 50 to 90 bytes longer."""
        own = "g" + hashlib.sha256(self.svg.encode()).hexdigest()[:5]
        return _IDS.sub(own, self.svg)

    @property
    def data_uri(self) -> str:
        """SVG as the shortest data URI that browsers accept in src="" and in CSS url("")."""
        plain = "'" if "'" not in self.svg else '"'
        return f"data:{_MEDIA_TYPE}," + quote(self.svg.replace('"', plain), safe=_UNESCAPED)

    @property
    def data_uri_base64(self) -> str:
        """SVG as a data URI in base64, for programs that refuse the shorter `data_uri`."""
        return f"data:{_MEDIA_TYPE};base64," + base64.b64encode(self.svg.encode()).decode()

    def record(self, name: str) -> dict[str, Any]:
        """Return a dict for JSON with the keys of SQIP's result and `transparent`.

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
        """Return an HTML <img> of the photo with the placeholder behind it.

        source  URL of the photo, percent-encoded where needed
        alt     description of the photo, for readers who do not see it

        Width and height of the <img> reserve the photo's space, and the <img> is no wider than its
        container. Through a loaded photo with alpha the placeholder would be visible, so an onload
        attribute removes the placeholder.
        """
        color = "" if self.transparent else f"{self.color} "
        style = f'max-width:100%;height:auto;background:{color}url("{self.data_uri}") 0 0/100% 100%'
        gone = " onload=\"this.style.background='none'\"" if self.transparent else ""
        shown = f'src="{_in_attribute(source)}" alt="{_in_attribute(alt)}"'
        size = f'width="{self.width}" height="{self.height}"'
        return f'<img {shown} {size} style="{_in_attribute(style)}"{gone}>'

    def picture(self, source: str, others: Mapping[str, str], alt: str = "") -> str:
        """Return an HTML <picture> of the `snippet` and of other files that a browser may load.

        others  media types of the other files of the photo, by their URLs, the best file first:
                {"a.avif": "image/avif"}
        """
        sources = ""
        for url, kind in others.items():
            sources += f'<source srcset="{_in_attribute(url)}" type="{_in_attribute(kind)}">'
        return f"<picture>{sources}{self.snippet(source, alt)}</picture>"


def _in_attribute(text: str) -> str:
    """Escape text for an HTML attribute in double quotes. There < and > need no escape."""
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
    """Return a photo's placeholder, the best SVG within max_bytes, such as 1000 or "1k".

    image                path, bytes, binary file, PIL image, numpy array or torch tensor
    bytes_of             attribute of the placeholder that max_bytes limits, such as "data_uri"
    threads, max_memory  see RunOptions
    progress, stop       see `vectorize`
    Raise InputError for invalid input, for more than 20 kB, and for fewer bytes than a file without
    Gaussians has.
    """
    limit = check_bytes("max_bytes", max_bytes)
    Field("bytes_of", words=get_args(Counted)).checked(bytes_of)
    options = Options().changed(max_bytes=limit, markup=MINIMAL)
    options = options.changed(threads=threads, max_memory=max_memory)

    def count(svg: str) -> int:
        return len(getattr(Placeholder(svg, 1, 1, "", 0), bytes_of).encode())

    with watched(progress) as callback:
        plan, run = Plan(options, by_bytes=True), Run(options.run, callback, stop)
        photo = run.read(image, needed=_LONGEST_SIDE)
        pixels = pixels_of(photo)
        with run.compiled():
            found = ByBytes(plan, Subject.of(pixels, photo.original_size), run, count).file()
    mean = shrunk(pixels, 1, 1)[0, 0, :3]  # mean of the visible pixels
    color = hex_color(np.round(255 * mean).astype(np.intp))
    return Placeholder(found.svg, *photo.original_size, color, len(found.scene), has_alpha(pixels))


def check_bytes(name: str, value: Any) -> int:
    """Return the limit of a placeholder in bytes. Raise InputError with `name` if invalid."""
    size = byte_size(name, value)
    if size > MINIMAL_UP_TO:
        needed = f"at most {MINIMAL_UP_TO} bytes for a placeholder"
        raise refusal(name, needed, quoted(value), str(MINIMAL_UP_TO))
    return size
