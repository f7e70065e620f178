"""The command `gauss2svg placeholder`, imported only where it is run."""

import json
import os
import re
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import quote

from cyclopts import Parameter

from gauss2svg.cli.parameters import STATUS_SOME_FAILED, Photos, Quiet, photos_given
from gauss2svg.cli.streams import counting_bar, say, write_output
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, quoted
from gauss2svg.files import (
    STANDARD_STREAM,
    check_outputs,
    reading,
    refuse_option_like,
    write_all_atomically,
)
from gauss2svg.options import OptionGroup
from gauss2svg.photo.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.placeholder import (
    DEFAULT_BYTES,
    Counted,
    Placeholder,
    check_bytes,
    placeholder,
)
from gauss2svg.version import __version__

# With which a line of HTML begins, and the address in it.
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


_DEFAULTS = PlaceholderOptions()


def placeholder_command(
    photos: Photos,
    *,
    output: Annotated[
        str,
        Parameter(
            name=["--output", "-o"],
            allow_leading_hyphen=True,
            help="File to write, with svg the folder for them; - is standard output. What a list "
            "has of unchanged photos is kept, of photos that are not given it goes.",
        ),
    ] = "-",
    options: Annotated[PlaceholderOptions, Parameter(name="*", group="Placeholders")] = _DEFAULTS,
    quiet: Quiet = False,
) -> int:
    """Write placeholders of about a kilobyte, which a page shows until its photos have come."""
    refuse_option_like(output)
    given = photos_given(photos, ["output", "quiet", *vars(options)])
    once = listed_photos(given)
    copies = len(given) - len(once)
    if options.format == "picture":
        sources = {
            source for photo in once if photo.problem is None for source in _sources(photo.path)
        }
        once = [photo for photo in once if Path(photo.path) not in sources]
    targets = _targets(output, options.format, [photo.slug for photo in once])
    _check({photo.path: "a photo" for photo in once}, targets)
    book = _Book(output, options)
    made: dict[ListedPhoto, Placeholder] = {}
    failures, unchanged = [], 0
    with counting_bar(quiet) as update:
        for at, photo in enumerate(once):
            try:
                update(photo.name, at, len(once))
                if photo.problem is not None:
                    failures.append(f"failed: {photo.problem}")
                elif book.has(photo):
                    unchanged += 1
                else:
                    made[photo] = placeholder(
                        photo.path, options.max_bytes, bytes_of=options.bytes_of
                    )
            except Gauss2SvgError as error:
                line = str(error).replace("max_bytes must", "--max-bytes must")
                failures.append(f"failed: {photo.name}: {line}")
            except BaseException:  # a signal, which arrives from a kernel in another exception
                for line in failures:
                    say(line)
                try:
                    if made and output != STANDARD_STREAM:
                        book.write(once, made)
                        say(f"wrote what was made so far: {len(made)} of {len(once)} placeholders")
                except Gauss2SvgError as error:
                    say(str(error))
                raise
    count = len(made) + unchanged
    kept = book.write(once, made) - count if count else 0
    if copies:
        say(f"{copies} of {len(given)} photos given more than once")
    for photo, one in made.items():
        if not one.gaussians:
            say(f"without Gaussians, for which it has no room or no need: {photo.name}")
    for line in failures:
        say(line)
    if not quiet:
        where = f" in {'standard output' if output == STANDARD_STREAM else output}"
        same = f", {unchanged} of them unchanged" if unchanged else ""
        say(
            f"{count} placeholder{'s' * (count != 1)}{where if count else ''}{same}; "
            f"{len(failures)} failed{'' if count else ', and nothing was written'}"
            + (f"; {kept} of them kept from before" if kept else "")
        )
    return STATUS_SOME_FAILED if failures else 0


def _sources(path: str) -> list[Path]:
    """The files beside a photo that a browser should rather take, the best first."""
    own = Path(path)
    better = takewhile(lambda suffix: suffix != own.suffix.lower(), _SOURCES)
    return [one for suffix in better if (one := own.with_suffix(suffix)).is_file()]


def _targets(output: str, form: str, slugs: list[str]) -> list[Path]:
    """The files that are written; none for standard output."""
    if output != STANDARD_STREAM:
        if form == "svg" and Path(output).suffix.lower() == ".svg":
            raise InputError(
                f"--output must be a folder with --format svg; got {quoted(output)}. Try "
                f"{Path(output).with_suffix('')!s}"
            )
        return [Path(output) / f"{slug}.svg" for slug in slugs] if form == "svg" else [Path(output)]
    if form == "svg" and len(slugs) > 1:
        raise InputError("--output must be given for several SVGs. Try -o folder")
    return []


def _check(photos: dict[str, str], targets: list[Path]) -> None:
    """Refuse outputs that would overwrite a photo, or could not be written."""
    for folder in {target.parent for target in targets}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot write {folder}: {error.strerror or error}. Try another folder"
            ) from error
    check_outputs(photos, targets)


class _Book:
    """What is written, and what an earlier run has written there, by the paths of the photos.

    Raises InputError for a file that cannot be read as such: to replace it would lose what it has.
    """

    def __init__(self, output: str, options: PlaceholderOptions) -> None:
        self._output, self._options = output, options
        folder = "" if output == STANDARD_STREAM else os.path.dirname(output)
        self._root = os.fspath(options.root or folder or ".")
        # Of another version or of other options nothing is kept.
        self._made_by = f"gauss2svg {__version__}, {options.max_bytes} bytes of {options.bytes_of}"
        is_file = options.format != "svg" and output != STANDARD_STREAM and Path(output).is_file()
        self._data = b""  # of that file
        self._before = self._entries() if is_file else {}

    def has(self, photo: ListedPhoto) -> bool:
        """Whether an entry of the same bytes by the same options is there; HTML does not say."""
        if self._options.format not in ("json", "object"):
            return False
        found = self._before.get(self._key(photo), {"metadata": {}})["metadata"]
        return (found.get("sha256"), found.get("madeBy")) == (photo.digest, self._made_by)

    def write(self, photos: list[ListedPhoto], made: dict[ListedPhoto, Placeholder]) -> int:
        """Write what was made and what is kept of the other given photos; returns how many.

        Entries of photos that are not given go.

        A file that would be the same is not touched, which would make servers reload pages.
        """
        form, output = self._options.format, self._output
        if form == "svg" and output != STANDARD_STREAM:
            files = {Path(output) / f"{photo.slug}.svg": one.svg for photo, one in made.items()}
            write_all_atomically({path: svg.encode() for path, svg in files.items()})
            return len(made)
        keys = {photo: self._key(photo) for photo in photos}
        listed = {
            key: self._entry(photo, made[photo]) if photo in made else self._before[key]
            for photo, key in keys.items()
            if photo in made or key in self._before
        }
        if form in ("json", "object"):
            for photo, key in keys.items():  # which depends on what else is given
                if key in listed:
                    listed[key]["metadata"]["filename"] = photo.file
            text = json.dumps(listed if form == "object" else [*listed.values()], indent=2) + "\n"
        else:
            end = "" if form == "svg" else "\n"
            text = "".join(f"{line}{end}" for line in listed.values())
        if output == STANDARD_STREAM:
            write_output(text.encode())
        elif text.encode() != self._data or not Path(output).is_file():
            write_all_atomically({output: text.encode()})
        return len(listed)

    def _key(self, photo: ListedPhoto) -> str:
        """The path of a photo from the root; in HTML its address."""
        try:
            path = Path(os.path.relpath(photo.path, self._root)).as_posix()
        except ValueError as error:  # Windows knows no way from one drive to another
            raise InputError(
                f"--root must be on the drive of the photos; got {quoted(str(self._root))}. Try a "
                "folder above them"
            ) from error
        return path if self._options.format in ("json", "object") else _url(path)

    def _entry(self, photo: ListedPhoto, one: Placeholder) -> Any:
        form, key = self._options.format, self._key(photo)
        if form == "svg":
            return one.svg
        if form == "html":
            return one.snippet(key)
        if form == "picture":
            folder = key.rpartition("/")[0]
            sources = {
                f"{folder}/{_url(path.name)}".lstrip("/"): _SOURCES[path.suffix]
                for path in _sources(photo.path)
            }
            return one.picture(key, sources)
        record = one.record(photo.file)
        record["metadata"] |= {"path": key, "sha256": photo.digest, "madeBy": self._made_by}
        return record

    def _entries(self) -> dict[str, Any]:
        """The entries of the file, by the keys of their photos."""
        form, output = self._options.format, self._output
        with reading(output, "another name for --output") as file:
            data = self._data = file.read()
        try:
            text = data.decode()
            if form in ("html", "picture"):
                lines = [line for line in text.split("\n") if line.strip()]
                found = {match[1]: line for line in lines if (match := _LINE.match(line))}
                if not lines or len(found) < len(lines):
                    raise ValueError("not lines of <img>")
                return found
            records = json.loads(text)
            if not isinstance(records, dict if form == "object" else list):
                raise TypeError("of another form")
            entries = [*records.values()] if isinstance(records, dict) else records
            return {entry["metadata"]["path"]: entry for entry in entries}
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise InputError(
                f"--output must be a file of placeholders in {form}, or none yet; got {output}, "
                "which has something else or is damaged. Try another name, or remove it"
            ) from error


def _url(path: str) -> str:
    """The address of a path; any bytes of a name are escaped."""
    return quote(os.fsencode(path))
