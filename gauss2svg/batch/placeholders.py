"""Make placeholders of many photos, in one file for all or in one file for each photo.

If the file exists, its entries are kept for photos that have not changed.
"""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import quote

from gauss2svg import files
from gauss2svg.batch.inputs import ListedPhoto, listed_photos
from gauss2svg.errors import Gauss2SvgError, brief, of_file, quoted, refusal
from gauss2svg.options import OptionGroup, file_path
from gauss2svg.pipeline.placeholder import (
    DEFAULT_BYTES,
    Counted,
    Placeholder,
    check_bytes,
    placeholder,
)
from gauss2svg.svg.file import is_own
from gauss2svg.version import __version__


@dataclass(frozen=True, kw_only=True)
class PlaceholderOptions(OptionGroup):
    """Options of placeholders for a list of photos."""

    max_bytes: Annotated[int | str, check_bytes] = DEFAULT_BYTES
    """Maximum size of each placeholder in bytes, up to 20k."""

    bytes_of: Counted = "svg"
    """What --max-bytes limits. svg: the file. inline: the SVG as it stands inside a page ("content"
    in the JSON). data_uri, data_uri_base64: the data URI of that form."""

    format: Literal["json", "object", "html", "picture", "svg"] | None = None
    """json: a list with the SVG, data URIs, size and mean colour of each photo, by the keys of
    SQIP. object: the same, by the paths of the photos. html: an img element for each photo, with
    the placeholder as its background. picture: the same in a picture element, which also offers the
    AVIF and WebP of the same name beside the photo. svg: one SVG file for each photo. The default
    is svg for a folder and for the ending .svg, html for .html, and json for any other output."""

    root: Annotated[Path | None, file_path] = None
    """Folder to which paths and addresses are relative. The default is the folder of the output."""


class PlaceholderList:
    """Placeholders of photos, and the entries that an earlier run has written.

    photos     the photos, each once
    count      number of photos whose placeholder is new or unchanged
    unchanged  number of photos whose entry is kept, because it was made from the same bytes with
               the same options by the same version of gauss2svg
    failures   a line for each photo that failed

    The constructor creates the folder of the output. It raises InputError if the output is one of
    the photos, or an existing file that is no list of placeholders, because the content of that
    file would be lost. It raises OutputError if the output cannot be written.
    """

    def __init__(self, paths: list[str], output: str, options: PlaceholderOptions) -> None:
        self._output, self._options = output, options
        self._form = form = _format_of(output, options.format)
        self._is_json = form in ("json", "object")
        # Whether the output is an SVG, and not a folder of SVGs or a list.
        is_file = output.lower().endswith(".svg") and not os.path.isdir(output)
        self._is_one_svg = form == "svg" and (is_file or output == files.STANDARD_STREAM)
        self._made_by = f"gauss2svg {__version__}, {options.max_bytes} bytes of {options.bytes_of}"
        self.photos = listed_photos(paths)
        self.failures: list[str] = []
        self.count = self.unchanged = 0
        if form == "picture":
            sources = {file for photo in self.photos for file in _sources(photo)}
            self.photos = [photo for photo in self.photos if Path(photo.path) not in sources]
        elif self._is_one_svg and len(self.photos) > 1:
            raise refusal("--output", "a folder for several SVGs", quoted(output), "-o svgs/")
        keys = [self._key(photo) for photo in self.photos]
        for key in keys if form == "svg" and not self._is_one_svg else ():
            if os.path.isfile(key) and not is_own(key):
                needed = "a folder without SVGs of others by the names of the photos"
                raise refusal("--output", needed, brief(key), "another folder")
        if output != files.STANDARD_STREAM:
            targets = [Path(name) for name in (keys if form == "svg" else [output])]
            files.make_folder(targets[0].parent)
            files.check_outputs({photo.path: "a photo" for photo in self.photos}, targets)
        is_list = form != "svg" and output != files.STANDARD_STREAM and Path(output).is_file()
        before = self._entries_before() if is_list else {}
        self._entries = {key: before.get(key) for key in keys}

    def add(self, photo: ListedPhoto) -> None:
        """Make the placeholder of a photo, unless the entry of an earlier run is up to date.

        If the placeholder cannot be made, add a line to `failures`.
        """
        key, options = self._key(photo), self._options
        metadata = (self._entries[key] or {}).get("metadata", {}) if self._is_json else {}
        source = {"sha256": photo.digest, "madeBy": self._made_by}
        is_unchanged = source.items() <= metadata.items()
        try:
            if not is_unchanged:
                one = placeholder(photo.path, options.max_bytes, bytes_of=options.bytes_of)
                self._entries[key] = self._entry(photo, one)
            self.unchanged += is_unchanged
            self.count += 1
        except Gauss2SvgError as error:
            line = str(error).replace("max_bytes must", "--max-bytes must")
            self.failures.append(f"failed: {of_file(photo.name, line)}")

    def files(self) -> dict[str, bytes]:
        """Return {file name: content} for the files to write.

        If all placeholders are in one file and this file would not change, return {}. Some web
        servers reload their pages whenever a file is written.
        """
        entries = {key: entry for key, entry in self._entries.items() if entry is not None}
        if self._form == "svg":
            return {name: svg.encode() for name, svg in entries.items()}
        if self._is_json:
            # The name `photo.name` also depends on the names of the other photos. The earlier run
            # may have had other photos. So this name is also set in the entries that are kept.
            for photo in self.photos:
                if entry := entries.get(self._key(photo)):
                    entry["metadata"]["filename"] = photo.name
            contents = entries if self._form == "object" else [*entries.values()]
            text = json.dumps(contents, indent=2) + "\n"
        else:
            text = "".join(f"{line}\n" for line in entries.values())
        path = Path(self._output)
        is_same = path.is_file() and path.read_bytes() == text.encode()
        return {} if is_same else {self._output: text.encode()}

    def _key(self, photo: ListedPhoto) -> str:
        """Return the key of a photo's entry.

        With the format svg, the key is the path of the photo's SVG. With any other format, it is
        the photo's path relative to the root. With the formats html and picture, this path is
        written as a URL, with its bytes percent-encoded.
        """
        if self._form == "svg":
            in_folder = str(Path(self._output) / f"{photo.slug}.svg")
            return self._output if self._is_one_svg else in_folder
        root = self._options.root or os.path.dirname(self._output) or "."
        try:
            path = Path(os.path.relpath(photo.path, root)).as_posix()
        except ValueError as error:  # Windows has no relative path from one drive to another
            needed, advice = "on the drive of the photos", "a folder above them"
            raise refusal("--root", needed, quoted(str(root)), advice) from error
        return path if self._is_json else _url(path)

    def _entry(self, photo: ListedPhoto, one: Placeholder) -> Any:
        key = self._key(photo)
        if self._form == "svg":
            return one.svg
        if self._form == "html":
            return one.snippet(key)
        if self._form == "picture":
            folder = key[: key.rfind("/") + 1]
            sources = _sources(photo).items()
            return one.picture(key, {folder + _url(file.name): kind for file, kind in sources})
        record = one.record(photo.name)
        record["metadata"] |= {"path": key, "sha256": photo.digest, "madeBy": self._made_by}
        return record

    def _entries_before(self) -> dict[str, Any]:
        """Return the entries of the output file, which exists, as {key of a photo: entry}."""
        with files.reading(self._output, "another name for --output") as file:
            data = file.read()
        try:
            text = files.text_of(data, self._output)
            if self._is_json:
                records = json.loads(text)
                if not isinstance(records, dict if self._form == "object" else list):
                    raise TypeError("of another form")
                entries = records.values() if isinstance(records, dict) else records
                return {entry["metadata"]["path"]: entry for entry in entries}
            # Each photo has a line, which begins with this and the address of the photo.
            begin = re.compile(r'(?:<picture>(?:<source [^>]*>)*)?<img src="([^"]*)"')
            lines = [line for line in text.split("\n") if line.strip()]
            lines_by_key = {match[1]: line for line in lines if (match := begin.match(line))}
            if not lines or len(lines_by_key) < len(lines):
                raise ValueError("not lines of <img>")
            return lines_by_key
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            needed = f"a file of placeholders in {self._form}, or none yet"
            got = f"{self._output}, which has something else or is damaged"
            raise refusal("--output", needed, got, "another name, or remove it") from error


def _format_of(output: str, form: Any) -> Any:
    """Return the format of an output: `form`, or the one for which its name stands if it is None.

    Raise InputError if the name stands for another format.
    """
    is_folder = os.path.isdir(output) or output.endswith(("/", os.sep))
    ending = ".svg" if is_folder else os.path.splitext(output)[1].lower()
    formats = {".json": "json", ".html": "html", ".htm": "html", ".svg": "svg"}
    named = formats.get(ending, "another" if ending in files.FILE_ENDINGS else "")
    form = form or {"another": "svg", "": "json"}.get(named, named)
    like = {"object": "json", "picture": "html"}.get(form, form)  # the same endings
    if named not in ("", like):
        needed, stem = f"a name for the format {form}", os.path.splitext(output)[0]
        raise refusal("--output", needed, quoted(output), brief(f"{stem}.{like}"))
    return form


def _sources(photo: ListedPhoto) -> dict[Path, str]:
    """Return {file: media type} of existing files that browsers should prefer to the photo."""
    own, sources = Path(photo.path), {}
    # The best format comes first, because a browser takes the first file whose type it supports.
    for kind in ("avif", "webp"):
        file = own.with_suffix(f".{kind}")
        if photo.digest is None or file.suffix == own.suffix.lower():
            break
        if file.is_file():
            sources[file] = f"image/{kind}"
    return sources


def _url(path: str) -> str:
    """Return a path as a URL, with its bytes percent-encoded."""
    return quote(os.fsencode(path))
