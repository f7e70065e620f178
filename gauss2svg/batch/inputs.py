"""The one rule of inputs for all commands that take many photos: folders, patterns, lists, URLs."""

from __future__ import annotations

import codecs
import glob
import os
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from gauss2svg.batch.stores import PARTS_OF, filesystem, is_url, lines_of, reason_of
from gauss2svg.errors import InputError
from gauss2svg.files import STANDARD_STREAM
from gauss2svg.photo.formats import SUFFIXES

MANIFESTS = (".txt", ".lst")
PATTERN = re.compile(r"[*?\[]")  # what makes a name that of many files


class Source(NamedTuple):
    """A photo: its path or URL, name of its output without suffix, bytes if known."""

    path: str
    name: str
    size: int | None


def photos_of(sources: Iterable[str]) -> Iterator[Source]:
    """All photos of folders, globs, lists and names, as they are found.

    A folder gives all pictures in and under it, except hidden ones, by their suffix; their outputs
    keep the names relative to it. So does a glob, relative to its part without wildcards. A list
    (.txt, .lst, or - for standard input) has a path or a URL on each line, whose outputs keep the
    whole name. Anything else is a photo, whose output keeps its last part.
    Raises InputError for what does not exist or gives no photo.
    """
    for source in sources:
        is_empty = True
        for photo in _photos(source):
            is_empty = False
            yield photo
        if is_empty:
            raise InputError(
                f"photos must be one or more; got none in {source}. Try a folder of photos"
            )


def expanded(names: Iterable[str]) -> list[str]:
    """Return names of files, with those that match in place of a pattern such as *.jpg.

    Shells of Windows leave that to programs. A name that exists is no pattern; a pattern that
    matches nothing stays, as in other shells.
    """
    found: list[str] = []
    for name in names:
        is_pattern = PATTERN.search(name) is not None and not os.path.lexists(name)
        found += (is_pattern and sorted(glob.glob(name, recursive=True))) or [name]
    return found


def local_photos(sources: Iterable[str]) -> list[str]:
    """The paths of `photos_of` for commands that read files alone, those of a source sorted.

    What reading reports stays: URLs, names of no file, and patterns that match nothing.
    """
    found: list[str] = []
    for source in sources:
        is_list = source == STANDARD_STREAM or source.lower().endswith(MANIFESTS)
        if is_list:
            found += [photo.path for photo in photos_of([source])]
        elif os.path.isdir(source):
            found += sorted(photo.path for photo in photos_of([source]))
        elif PATTERN.search(source) and not (is_url(source) or os.path.lexists(source)):
            found += sorted(photo.path for photo in _matching(source)) or [source]
        else:
            found.append(source)
    return found


def check_apart(sources: Iterable[str], output: str) -> None:
    """Raise InputError for an output, a path or a URL, in a folder that is searched for photos."""
    for source in sources:
        folder = folder_of(source)
        if folder is None or is_url(folder) != is_url(output):
            continue
        if is_url(output):
            inside, outside = output.rstrip("/"), folder.rstrip("/")
        else:
            inside, outside = os.path.realpath(output), os.path.realpath(folder or ".")
        if (inside + "/").startswith(outside.rstrip("/") + "/"):
            raise InputError(
                f"output must be outside of the inputs; got {output}, which is in "
                f"{folder or '.'}. Try another folder"
            )


def _photos(source: str) -> Iterator[Source]:
    if source == STANDARD_STREAM:
        if sys.stdin is None:
            raise InputError(
                "standard input must be open; got a closed stream. Try the name of a list"
            )
        yield from _listed(sys.stdin.buffer)
    elif source.lower().endswith(MANIFESTS):
        with lines_of(source) as lines:
            yield from _listed(lines)
    elif is_url(source):
        yield from _remote(source)
    elif os.path.isdir(source):
        yield from _folder(source, "")
    elif PATTERN.search(source) and not os.path.lexists(source):
        yield from _matching(source)
    else:
        yield Source(source, _stem(os.path.basename(source)), _size(source))


def folder_of(source: str) -> str | None:
    """The folder that is searched for photos, in and under it; None where only names are read."""
    if is_url(source):
        return source.partition("*")[0] if "**" in source or not PATTERN.search(source) else None
    if os.path.isdir(source):
        return source
    return _base(source) if "**" in source and not os.path.lexists(source) else None


def _size(path: str, found: bool = False) -> int | None:
    """Bytes; None for a broken link, or what was found and is gone: it fails in its turn."""
    try:
        return os.stat(path).st_size
    except (OSError, ValueError) as error:
        if found or os.path.lexists(path):
            return None
        advice = "the path of a photo, a folder, a glob or a list"
        raise InputError(f"cannot read {path}: {reason_of(error)}. Try {advice}") from error


def _is_file(path: str) -> bool:
    """Whether what was found is a file, a broken link, or gone."""
    return os.path.isfile(path) or not os.path.exists(path)


def _stem(name: str) -> str:
    """A name without its suffix, as files of any system take it."""
    parts = [part for part in name.split("/") if part not in ("", ".")] or [name]
    dot = parts[-1].rfind(".")
    if 0 < dot < len(parts[-1]) - 1:  # neither hidden nor at the end
        parts[-1] = parts[-1][:dot]
    return "/".join(parts)


def _listed(lines: Iterable[bytes]) -> Iterator[Source]:
    for number, line in enumerate(lines):
        line = line.removeprefix(codecs.BOM_UTF8) if number == 0 else line
        path = os.fsdecode(line.rstrip(b"\r\n"))
        if path.strip() and not path.lstrip().startswith("#"):
            yield Source(path, _stem(_whole_name(path)), None)


def _whole_name(path: str) -> str:
    """The name of a line of a list: all of it but the root, the protocol and steps upwards."""
    plain = path.partition("://")[2] if is_url(path) else os.path.splitdrive(path)[1]
    parts = [part for part in PARTS_OF.split(plain) if part not in ("", ".", "..")]
    return "/".join(parts) or path


def is_picture(name: str) -> bool:
    """Whether a file of this name is taken for a photo where a folder is given."""
    return name.lower().endswith(SUFFIXES) and not name.startswith(".")


def _folder(root: str, under: str) -> Iterator[Source]:
    """Pictures under a folder, each folder's own first; links to folders are not followed."""
    here = os.path.join(root, under) if under else root
    folders = []
    try:
        with os.scandir(here) as entries:
            for entry in entries:
                name = f"{under}/{entry.name}" if under else entry.name
                if entry.is_dir(follow_symlinks=False):
                    if not entry.name.startswith("."):
                        folders.append(name)
                elif is_picture(entry.name) and _is_file(entry.path):
                    yield Source(entry.path, _stem(name), _size(entry.path, found=True))
    except OSError as error:
        # One that vanished since it was listed has no photos.
        if not (under and isinstance(error, (FileNotFoundError, NotADirectoryError))):
            message = f"cannot read {here}: {reason_of(error)}. Try another folder"
            raise InputError(message) from error
    for name in folders:
        yield from _folder(root, name)


def _base(pattern: str) -> str:
    """The folder of a glob: its part before the first wildcard."""
    return os.path.dirname(pattern[: PATTERN.search(pattern).start()])  # pyright: ignore[reportOptionalMemberAccess]


def _matching(pattern: str) -> Iterator[Source]:
    import glob

    base = _base(pattern)
    for path in glob.iglob(pattern, recursive=True):
        if _is_file(path):
            name = os.path.relpath(path, base or ".").replace(os.sep, "/")
            yield Source(path, _stem(name), _size(path, found=True))


def _remote(url: str) -> Iterator[Source]:
    """A URL's photo, or all that are under it or match it."""
    fs, path = filesystem(url)
    protocol = url.partition("://")[0]
    try:
        if PATTERN.search(url):
            base = path[: PATTERN.search(path).start()].rpartition("/")[0]  # pyright: ignore[reportOptionalMemberAccess]
            found = fs.glob(path, detail=True)
            files = ((name, info) for name, info in found.items() if info["type"] == "file")
            every = True
        elif protocol in ("http", "https") or fs.isfile(path):
            yield Source(url, _stem(path.rpartition("/")[2]), None)
            return
        else:
            base, every, files = path.rstrip("/"), False, _walked(fs, path)
        for name, info in files:
            relative = name.removeprefix(base).lstrip("/")
            parts = relative.split("/")
            hidden = any(part.startswith(".") for part in parts)
            if every or (is_picture(parts[-1]) and not hidden):
                yield Source(_url_of(fs, name, url, path), _stem(relative), info.get("size"))
    except InputError:
        raise
    except Exception as error:  # each store raises its own
        raise InputError(
            f"cannot read {url}: {reason_of(error)}. Try the URL of a photo or of a folder"
        ) from error


def _url_of(fs: Any, name: str, url: str, path: str) -> str:
    """The URL of a file found by another URL, with its host, which fsspec leaves out."""
    url, path = url.rstrip("/"), path.rstrip("/")
    return url.removesuffix(path) + name if url.endswith(path) else fs.unstrip_protocol(name)


def _walked(fs: Any, path: str, is_found: bool = False) -> Iterator[tuple[str, dict[str, Any]]]:
    """(path, what is known of it) of all files under a folder of a store.

    Unlike fsspec's own walk it leaves out no folder that cannot be read.
    """
    folders = []
    try:
        listing = fs.ls(path, detail=True)
    except FileNotFoundError:
        if not is_found:
            raise
        return  # it vanished since it was listed
    for info in listing:
        name = info["name"].rstrip("/")
        if name == path.rstrip("/"):  # stores may list a folder in itself
            continue
        if info["type"] == "directory":
            folders.append(name)
        else:
            yield name, info
    for folder in folders:
        yield from _walked(fs, folder, is_found=True)
