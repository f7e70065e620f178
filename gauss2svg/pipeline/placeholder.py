"""Placeholders: SVGs of about a kilobyte that a page shows until its photos are loaded.

Placeholders of several photos go into one file or into a file each. Unchanged ones are kept.
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from gauss2svg.errors import Gauss2SvgError, InputError, quoted, refusal
from gauss2svg.files import STANDARD_STREAM, check_outputs, make_folder, reading
from gauss2svg.options import Field, OptionGroup, byte_size
from gauss2svg.photo.alpha import has_alpha, pixels_of, shrunk
from gauss2svg.photo.load import ImageSource
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.options import Goal, Options, RunOptions, SvgOptions
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, Plan
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.pipeline.run import ProgressCallback, Run
from gauss2svg.pipeline.search.by_bytes import ByBytes
from gauss2svg.pipeline.search.outcome import Subject
from gauss2svg.svg.document import MINIMAL
from gauss2svg.svg.element import hex_color
from gauss2svg.version import __version__

DEFAULT_BYTES = 1000
# Attributes of Placeholder whose bytes may be limited.
Counted = Literal["svg", "inline", "data_uri", "data_uri_base64"]
# Longest side in px of the loaded photo, from which a working picture of at most 384 px is made.
_LONGEST_SIDE = 640
# Characters that browsers accept unescaped in a data URI. % and # have a meaning there, and " would
# end the attribute or the url("") that holds the URI (docs/decisions/small.md).
_UNESCAPED = " !$&'()*+,/:;<=>?@[]^`{|}"
_MEDIA_TYPE = "image/svg+xml"
# Positions at which a minimal file names an element or refers to one.
_IDS = re.compile(r'(?<=id=")|(?<=href="#)|(?<=url\(#)')


@dataclass(frozen=True)
class Placeholder:
    """A small SVG that stands for a photo until the photo is loaded.

    svg            text of the file
    width, height  size of the photo in px. The SVG has its proportions
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
        """SVG for a page's own markup, with ids of its own. It is 50 to 90 bytes longer."""
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

        source  URL of the photo, escaped as URLs are
        alt     description of the photo, for readers who do not see it

        Its width and height reserve the photo's space, and it is no wider than its container. If
        the photo has alpha, through which the placeholder would be seen, an onload attribute
        removes the placeholder.
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
        """Return an HTML <picture> around the `snippet`, with other files that a browser may take.

        others  media types of the other files of the photo by URL, the best first:
                {"a.avif": "image/avif"}
        """
        found = "".join(
            f'<source srcset="{_in_attribute(url)}" type="{_in_attribute(kind)}">'
            for url, kind in others.items()
        )
        return f"<picture>{found}{self.snippet(source, alt)}</picture>"


def _in_attribute(text: str) -> str:
    """Escape the value of an HTML attribute in double quotes, which may contain < and >."""
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
    """Return the best SVG of a photo within max_bytes, such as 1000 or "1k".

    image                path, bytes, binary file, PIL image, numpy array or torch tensor
    bytes_of             attribute of the placeholder that max_bytes limits, such as "data_uri"
    threads, max_memory  see RunOptions
    progress, stop       see `vectorize`
    Raise InputError for invalid input, for more than 20 kB, and for fewer bytes than a file without
    Gaussians has.
    """
    limit = check_bytes("max_bytes", max_bytes)
    Field("bytes_of", words=get_args(Counted)).checked(bytes_of)
    options = Options(
        goal=Goal(max_bytes=limit),
        svg=SvgOptions(markup=MINIMAL),
        run=RunOptions(threads=threads, max_memory=max_memory),
    )

    def count(svg: str) -> int:
        return len(getattr(Placeholder(svg, 1, 1, "", 0), bytes_of).encode())

    with watched(progress) as callback:
        plan, run = Plan(options, by_bytes=True), Run(options.run, callback, stop)
        photo = run.read(image, needed=_LONGEST_SIDE)
        pixels = pixels_of(photo)
        with run.compiled():
            found = ByBytes(plan, Subject.of(pixels, photo.full), run, count).file()
    mean = shrunk(pixels, 1, 1)[0, 0, :3]  # mean of the visible pixels
    color = hex_color(np.round(255 * mean).astype(np.intp))
    return Placeholder(found.svg, *photo.full, color, len(found.scene), has_alpha(pixels))


def check_bytes(name: str, value: Any) -> int:
    """Return the limit of a placeholder in bytes. Raise InputError with `name` if invalid."""
    size = byte_size(name, value)
    if size > MINIMAL_UP_TO:
        needed = f"at most {MINIMAL_UP_TO} bytes for a placeholder"
        raise refusal(name, needed, quoted(value), str(MINIMAL_UP_TO))
    return size


# Beginning of a line of HTML, with the address of the photo.
_LINE = re.compile(r'(?:<picture>(?:<source [^>]*>)*)?<img src="([^"]*)"')
# Suffixes of the files beside a photo that a <picture> offers first, in this order.
_SOURCES = {".avif": "image/avif", ".webp": "image/webp"}


@dataclass(frozen=True, kw_only=True)
class PlaceholderOptions(OptionGroup):
    """Options of placeholders for a list of photos."""

    max_bytes: Annotated[int | str, check_bytes] = DEFAULT_BYTES
    """Maximum size of each placeholder in bytes, up to 20k."""

    bytes_of: Counted = "svg"
    """What --max-bytes limits. svg: the file. inline: the SVG as it stands inside a page ("content"
    in the JSON). data_uri, data_uri_base64: the data URI of that form."""

    format: Literal["json", "object", "html", "picture", "svg"] = "json"
    """json: a list with the SVG, data URIs, size and mean colour of each photo, by the keys of
    SQIP. object: the same, by the paths of the photos. html: an img element for each photo, with
    the placeholder as its background. picture: the same in a picture element, which also offers the
    AVIF and WebP of the same name beside the photo. svg: one SVG file for each photo."""

    root: Path | None = None
    """Folder to which paths and addresses are relative. The default is the folder of the output."""


class PlaceholderList:
    """Placeholders of photos, and the entries that an earlier run has written.

    photos     the given photos, each once
    copies     number of photos that were given again
    made       placeholders of this run
    unchanged  number of photos whose entry has the same photo, options and version
    failures   a line for each photo that failed
    Raise InputError for an output that is a photo or a file other than a list of placeholders,
    because replacing it would lose its content. Raise OutputError for an output that cannot be
    written.
    """

    def __init__(self, paths: list[str], output: str, options: PlaceholderOptions) -> None:
        self._output, self._options, form = output, options, options.format
        self._is_json = form in ("json", "object")
        self._made_by = f"gauss2svg {__version__}, {options.max_bytes} bytes of {options.bytes_of}"
        self.photos = listed_photos(paths)
        self.copies = len(paths) - len(self.photos)
        self.made: dict[ListedPhoto, Placeholder] = {}
        self.failures: list[str] = []
        self.unchanged = 0
        if form == "picture":
            sources = {one for photo in self.photos for one in _sources(photo)}
            self.photos = [photo for photo in self.photos if Path(photo.path) not in sources]
        self._targets = self._files_of_photos()
        for folder in {target.parent for target in self._targets.values()}:
            make_folder(folder)
        inputs = {photo.path: "a photo" for photo in self.photos}
        check_outputs(inputs, list(self._targets.values()))
        self._data, self._before = b"", dict[str, Any]()  # content of the output so far
        if form != "svg" and output != STANDARD_STREAM and Path(output).is_file():
            with reading(output, "another name for --output") as file:
                self._data = file.read()
            try:
                self._before = self._entries_of(self._data.decode())
            except (ValueError, TypeError, KeyError, RecursionError) as error:
                needed = f"a file of placeholders in {form}, or none yet"
                got = f"{output}, which has something else or is damaged"
                raise refusal("--output", needed, got, "another name, or remove it") from error

    def add(self, photo: ListedPhoto) -> None:
        """Make the placeholder of a photo, unless its entry is unchanged."""
        options = self._options
        known = self._before.get(self._key(photo), {}) if self._is_json else {}
        metadata = known.get("metadata", {})
        if photo.problem is not None:
            self.failures.append(f"failed: {photo.problem}")
        elif (metadata.get("sha256"), metadata.get("madeBy")) == (photo.digest, self._made_by):
            self.unchanged += 1
        else:
            try:
                one = placeholder(photo.path, options.max_bytes, bytes_of=options.bytes_of)
                self.made[photo] = one
            except Gauss2SvgError as error:
                line = str(error).replace("max_bytes must", "--max-bytes must")
                self.failures.append(f"failed: {photo.name}: {line}")

    @property
    def count(self) -> int:
        """Number of placeholders that are made or unchanged."""
        return len(self.made) + self.unchanged

    @property
    def kept(self) -> int:
        """Number of entries of an earlier run that are kept for photos that failed now."""
        left = [photo for photo in self.photos if photo not in self.made]
        return sum(self._key(photo) in self._before for photo in left) - self.unchanged

    def files(self) -> dict[str, bytes]:
        """Return the contents of the files to write, by name.

        A list that would not change is left out, because writing it makes servers reload pages.
        """
        form = self._options.format
        if form == "svg":
            names = {photo: str(self._targets.get(photo, STANDARD_STREAM)) for photo in self.made}
            return {names[photo]: one.svg.encode() for photo, one in self.made.items()}
        entries = dict[str, Any]()
        for photo in self.photos:
            key, made = self._key(photo), self.made.get(photo)
            entry = self._before.get(key) if made is None else self._entry(photo, made)
            if entry is not None:
                entries[key] = entry
                if self._is_json:  # depends on the other photos' names
                    entry["metadata"]["filename"] = photo.file
        if self._is_json:
            text = json.dumps(entries if form == "object" else [*entries.values()], indent=2) + "\n"
        else:
            text = "".join(f"{line}\n" for line in entries.values())
        is_same = text.encode() == self._data and Path(self._output).is_file()
        return {} if is_same else {self._output: text.encode()}

    def _files_of_photos(self) -> dict[ListedPhoto, Path]:
        """Return the file of each photo, or an empty dict for standard output."""
        form, path = self._options.format, Path(self._output)
        if self._output == STANDARD_STREAM:
            if form == "svg" and len(self.photos) > 1:
                raise InputError("--output must be given for several SVGs. Try -o folder")
            return {}
        if form != "svg":
            return dict.fromkeys(self.photos[:1], path)
        if path.suffix.lower() == ".svg":
            advice = str(path.with_suffix(""))
            raise refusal("--output", "a folder with --format svg", quoted(self._output), advice)
        return {photo: path / f"{photo.slug}.svg" for photo in self.photos}

    def _key(self, photo: ListedPhoto) -> str:
        """Return the path of a photo relative to the root, escaped as an address in HTML."""
        folder = "" if self._output == STANDARD_STREAM else os.path.dirname(self._output)
        root = self._options.root or folder or "."
        try:
            path = Path(os.path.relpath(photo.path, root)).as_posix()
        except ValueError as error:  # Windows has no relative path from one drive to another
            needed, advice = "on the drive of the photos", "a folder above them"
            raise refusal("--root", needed, quoted(str(root)), advice) from error
        return path if self._is_json else _url(path)

    def _entry(self, photo: ListedPhoto, one: Placeholder) -> Any:
        key = self._key(photo)
        if self._options.format == "html":
            return one.snippet(key)
        if self._options.format == "picture":
            folder = key[: key.rfind("/") + 1]
            files = _sources(photo)
            return one.picture(
                key, {folder + _url(file.name): _SOURCES[file.suffix] for file in files}
            )
        record = one.record(photo.file)
        record["metadata"] |= {"path": key, "sha256": photo.digest, "madeBy": self._made_by}
        return record

    def _entries_of(self, text: str) -> dict[str, Any]:
        """Return the entries of a file by the keys of their photos."""
        if not self._is_json:
            lines = [line for line in text.split("\n") if line.strip()]
            found = {match[1]: line for line in lines if (match := _LINE.match(line))}
            if not lines or len(found) < len(lines):
                raise ValueError("not lines of <img>")
            return found
        records = json.loads(text)
        if not isinstance(records, dict if self._options.format == "object" else list):
            raise TypeError("of another form")
        entries = records.values() if isinstance(records, dict) else records
        return {entry["metadata"]["path"]: entry for entry in entries}


def _sources(photo: ListedPhoto) -> list[Path]:
    """Return the files beside a photo that a browser should prefer, the best first."""
    own = Path(photo.path)
    better = takewhile(lambda suffix: suffix != own.suffix.lower(), _SOURCES)
    files = [own.with_suffix(suffix) for suffix in better if photo.problem is None]
    return [file for file in files if file.is_file()]


def _url(path: str) -> str:
    """Return a path as an address, with the bytes of its names escaped."""
    return quote(os.fsencode(path))
