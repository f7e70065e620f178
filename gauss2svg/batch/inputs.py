"""The inputs of all commands that take many photos: folders, patterns, lists and URLs."""

from __future__ import annotations

import codecs
import glob
import os
import posixpath
import sys
from collections.abc import Iterable, Iterator
from typing import Any

from gauss2svg.batch.stores import PARTS_OF, is_url, reached
from gauss2svg.errors import refusal
from gauss2svg.files import PATTERN, STANDARD_STREAM, is_pattern, standard_stream
from gauss2svg.photo import SUFFIXES

MANIFESTS = (".txt", ".lst")


def photos_of(sources: Iterable[str], must_exist: bool = True) -> Iterator[tuple[str, str]]:
    """Yield the path or URL of each photo of the sources, and the name of its output.

    A folder has all pictures in and under it, known by their suffixes, except hidden ones. Their
    outputs are named relative to the folder. The outputs of a glob are named relative to its part
    before the first wildcard. A list (.txt, .lst, or - for standard input) has a path or URL on
    each line, and outputs keep the whole name. Any other source is one photo, and the output keeps
    the last part of its name. Names of outputs have no suffix. Raise InputError for a source
    without photos, and if `must_exist` also for a source that is no file.
    """
    for source in sources:
        photo = None
        for photo in _photos(source, must_exist):
            path, name = photo
            yield path, posixpath.splitext(name.replace(os.sep, "/"))[0]
        if photo is None:
            raise refusal("photos", "one or more", f"none in {source}", "a folder of photos")


def local_photos(sources: Iterable[str]) -> list[str]:
    """Return the paths of `photos_of`, for commands that read local files only.

    URLs and names of missing files stay, because reading them raises the error.
    """
    paths: list[str] = []
    for source in sources:
        paths += [source] if is_url(source) else [path for path, _ in photos_of([source], False)]
    return paths


def is_picture(name: str) -> bool:
    """Return whether a file of this name in a folder counts as a photo."""
    return name.lower().endswith(SUFFIXES) and not name.startswith(".")


def _photos(source: str, must_exist: bool) -> Iterator[tuple[str, str]]:
    """Yield the paths or URLs of one source, and names of outputs that still have suffixes."""
    if source == STANDARD_STREAM:
        yield from _listed(standard_stream(sys.stdin, "input"))
        return
    with reached(source) as (fs, path):
        if source.lower().endswith(MANIFESTS):
            with fs.open(path, "rb") as lines:
                yield from _listed(lines)
        elif is_url(source):
            yield from _remote(fs, path, source)
        elif os.path.isdir(source):
            for path in _pictures(source):
                yield path, os.path.relpath(path, source)
        elif is_pattern(source):
            for path in sorted(glob.glob(source, recursive=True)):
                if not os.path.isdir(path):
                    yield path, os.path.relpath(path, _base(source) or ".")
        else:
            if must_exist:
                os.lstat(source)  # raises OSError if it does not exist
            yield source, os.path.basename(source)


def _base(pattern: str) -> str:
    """Return the folder of a pattern: its part before the first wildcard."""
    return os.path.dirname(PATTERN.split(pattern)[0])


def _listed(lines: Iterable[bytes]) -> Iterator[tuple[str, str]]:
    for number, line in enumerate(lines):
        line = line.removeprefix(codecs.BOM_UTF8) if number == 0 else line
        path = os.fsdecode(line.rstrip(b"\r\n"))
        if path.strip() and not path.lstrip().startswith("#"):
            # The output's name is the path without root, protocol and steps upwards.
            rest = path.partition("://")[2] if is_url(path) else os.path.splitdrive(path)[1]
            parts = [part for part in PARTS_OF.split(rest) if part not in ("", ".", "..")]
            yield path, "/".join(parts) or path


def _pictures(root: str) -> Iterator[str]:
    """Yield the pictures in and under a folder. Links to folders are not followed."""

    def failed(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError):  # raised if the folder was just removed
            raise error

    for folder, folders, files in os.walk(root, onerror=failed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (os.path.join(folder, name) for name in sorted(files) if is_picture(name))


def _remote(fs: Any, path: str, url: str) -> Iterator[tuple[str, str]]:
    """Yield the photo at a URL, or all photos under it, or all that match it as a pattern."""
    host, is_whole, _ = url.partition(path.rstrip("/"))  # fsspec's names lack the host
    is_pattern = PATTERN.search(url) is not None
    names = [path] if url.startswith("http") else (fs.glob if is_pattern else fs.find)(path)
    base = (_base(path) if is_pattern else path).rstrip("/")
    for name in names:
        inside = name.removeprefix(base).lstrip("/") or os.path.basename(name)
        is_named = is_pattern or name == path  # a named photo may have any suffix
        if is_named or (is_picture(inside) and "/." not in f"/{inside}"):
            yield host + name if is_whole else fs.unstrip_protocol(name), inside
