"""The placeholders of several photos in one file, or a file each; what has not changed is kept."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal
from urllib.parse import quote

from gauss2svg.errors import Gauss2SvgError, InputError, quoted
from gauss2svg.files import STANDARD_STREAM, check_outputs, make_folder, reading
from gauss2svg.options import OptionGroup
from gauss2svg.pipeline.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.placeholder import (
    DEFAULT_BYTES,
    Counted,
    Placeholder,
    check_bytes,
    placeholder,
)
from gauss2svg.version import __version__

# The begin of a line of HTML, with the address of the photo.
_LINE = re.compile(r'(?:<picture>(?:<source [^>]*>)*)?<img src="([^"]*)"')
# Files of these suffixes beside a photo are what a <picture> offers first, in this order.
_SOURCES = {".avif": "image/avif", ".webp": "image/webp"}


@dataclass(frozen=True, kw_only=True)
class PlaceholderOptions(OptionGroup):
    """What is written for each photo."""

    max_bytes: Annotated[int | str, check_bytes] = DEFAULT_BYTES
    """Maximum size of each placeholder, 20k or less."""

    bytes_of: Counted = "svg"
    """What has that size: the file, the SVG inline in a page (content in JSON), or a data URI."""

    format: Literal["json", "object", "html", "picture", "svg"] = "json"
    """json: a list with SVG, data URIs, size and mean colour of each photo, by SQIP's keys; object:
    the same by the photos' paths; html: an img element for each, with the placeholder behind it;
    picture: the same in a picture element, with the AVIF and WebP of that name beside the photo;
    svg: files."""

    root: Path | None = None
    """Folder to which paths and addresses are relative; that of the output if not given."""


class PlaceholderList:
    """Placeholders of photos, beside the entries that an earlier run has written.

    photos     each given photo once; `copies` were given again
    unchanged  number of photos whose entry is of the same bytes, options and version
    failures   a line for each photo that cannot be read
    Raise InputError for an output that is a photo, and for a file that is no list of placeholders,
    since replacing it would lose what it has; OutputError for one that cannot be written.
    """

    def __init__(self, paths: list[str], output: str, options: PlaceholderOptions) -> None:
        self._output, self._options = output, options
        self.photos = listed_photos(paths)
        self.copies = len(paths) - len(self.photos)
        if options.format == "picture":
            sources = {one for photo in self.photos for one in _sources(photo)}
            self.photos = [photo for photo in self.photos if Path(photo.path) not in sources]
        targets = self._targets()
        for folder in {target.parent for target in targets.values()}:
            make_folder(folder)
        check_outputs({photo.path: "a photo" for photo in self.photos}, [*targets.values()])
        self.made: dict[ListedPhoto, Placeholder] = {}
        self.failures: list[str] = []
        self.unchanged = 0
        self._made_by = f"gauss2svg {__version__}, {options.max_bytes} bytes of {options.bytes_of}"
        self._is_json = options.format in ("json", "object")
        self._data = b""  # of the file that is there
        is_list = options.format != "svg" and output != STANDARD_STREAM and Path(output).is_file()
        self._before = self._entries() if is_list else {}

    def add(self, photo: ListedPhoto) -> None:
        """Make the placeholder of a photo, unless its entry is unchanged."""
        known = self._before.get(self._key(photo), {}) if self._is_json else {}
        metadata = known.get("metadata", {})
        if photo.problem is not None:
            self.failures.append(f"failed: {photo.problem}")
        elif (metadata.get("sha256"), metadata.get("madeBy")) == (photo.digest, self._made_by):
            self.unchanged += 1
        else:
            options = self._options
            try:
                self.made[photo] = placeholder(
                    photo.path, options.max_bytes, bytes_of=options.bytes_of
                )
            except Gauss2SvgError as error:
                line = str(error).replace("max_bytes must", "--max-bytes must")
                self.failures.append(f"failed: {photo.name}: {line}")

    @property
    def count(self) -> int:
        """Number of placeholders that are made or unchanged."""
        return len(self.made) + self.unchanged

    @property
    def kept(self) -> int:
        """Number of entries of an earlier run for photos that failed now."""
        return sum(self._key(photo) in self._before for photo in self._left) - self.unchanged

    @property
    def _left(self) -> Iterable[ListedPhoto]:
        return (photo for photo in self.photos if photo not in self.made)

    def files(self) -> dict[str, bytes]:
        """Return the files to write, by name, with an entry for each photo that has one.

        One that is there and would be the same is left out: writing it makes servers reload pages.
        """
        form = self._options.format
        if form == "svg" and self._output != STANDARD_STREAM:
            targets = self._targets()
            return {str(targets[photo]): one.svg.encode() for photo, one in self.made.items()}
        entries: dict[str, Any] = {}
        for photo in self.photos:
            key = self._key(photo)
            if photo in self.made:
                entries[key] = self._entry(photo, self.made[photo])
            elif key in self._before:
                entries[key] = self._before[key]
            if key in entries and self._is_json:  # the name depends on what else is given
                entries[key]["metadata"]["filename"] = photo.file
        if self._is_json:
            text = json.dumps(entries if form == "object" else [*entries.values()], indent=2) + "\n"
        else:
            text = "".join(line + "\n" * (form != "svg") for line in entries.values())
        is_same = text.encode() == self._data and Path(self._output).is_file()
        return {} if is_same else {self._output: text.encode()}

    def _targets(self) -> dict[ListedPhoto, Path]:
        """Return the file of each photo; none for standard output."""
        form, path = self._options.format, Path(self._output)
        if self._output == STANDARD_STREAM:
            if form == "svg" and len(self.photos) > 1:
                raise InputError("--output must be given for several SVGs. Try -o folder")
            return {}
        if form != "svg":
            return dict.fromkeys(self.photos[:1], path)
        if path.suffix.lower() == ".svg":
            raise InputError(
                f"--output must be a folder with --format svg; got {quoted(self._output)}. Try "
                f"{path.with_suffix('')!s}"
            )
        return {photo: path / f"{photo.slug}.svg" for photo in self.photos}

    def _key(self, photo: ListedPhoto) -> str:
        """Return the path of a photo from the root; in HTML its address."""
        folder = "" if self._output == STANDARD_STREAM else os.path.dirname(self._output)
        root = self._options.root or folder or "."
        try:
            path = Path(os.path.relpath(photo.path, root)).as_posix()
        except ValueError as error:  # Windows knows no way from one drive to another
            raise InputError(
                f"--root must be on the drive of the photos; got {quoted(str(root))}. Try a folder "
                "above them"
            ) from error
        return path if self._is_json else _url(path)

    def _entry(self, photo: ListedPhoto, one: Placeholder) -> Any:
        form, key = self._options.format, self._key(photo)
        if form == "svg":
            return one.svg
        if form == "html":
            return one.snippet(key)
        if form == "picture":
            place = PurePosixPath(key)
            kinds = {
                str(place.with_name(_url(path.name))): _SOURCES[path.suffix]
                for path in _sources(photo)
            }
            return one.picture(key, kinds)
        record = one.record(photo.file)
        record["metadata"] |= {"path": key, "sha256": photo.digest, "madeBy": self._made_by}
        return record

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file by the keys of their photos."""
        form = self._options.format
        with reading(self._output, "another name for --output") as file:
            self._data = file.read()
        try:
            text = self._data.decode()
            if not self._is_json:
                lines = [line for line in text.split("\n") if line.strip()]
                found = {match[1]: line for line in lines if (match := _LINE.match(line))}
                if not lines or len(found) < len(lines):
                    raise ValueError("not lines of <img>")
                return found
            records = json.loads(text)
            if not isinstance(records, dict if form == "object" else list):
                raise TypeError("of another form")
            entries = records.values() if isinstance(records, dict) else records
            return {entry["metadata"]["path"]: entry for entry in entries}
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise InputError(
                f"--output must be a file of placeholders in {form}, or none yet; got "
                f"{self._output}, which has something else or is damaged. Try another name, or "
                "remove it"
            ) from error


def _sources(photo: ListedPhoto) -> list[Path]:
    """Return the files beside a photo that a browser should rather take, the best first."""
    own = Path(photo.path)
    better = takewhile(lambda suffix: suffix != own.suffix.lower(), _SOURCES)
    files = [own.with_suffix(suffix) for suffix in better if photo.problem is None]
    return [file for file in files if file.is_file()]


def _url(path: str) -> str:
    """Return the address of a path; any bytes of a name are escaped."""
    return quote(os.fsencode(path))
