"""The inputs of all commands that take many photos: folders, patterns, lists and URLs."""

from __future__ import annotations

import codecs
import glob
import os
import posixpath
import sys
from collections.abc import Iterable, Iterator
from typing import Any

from gauss2svg.batch.stores import PATH_SEPARATOR, file_system_of, is_url
from gauss2svg.errors import refusal
from gauss2svg.files import PATTERN, STANDARD_STREAM, is_pattern, standard_stream
from gauss2svg.photo import SUFFIXES

MANIFESTS = (".txt", ".lst")


def photos_of(sources: Iterable[str], must_exist: bool = True) -> Iterator[tuple[str, str]]:
    """Yield (path or URL, name of the output without a suffix) for each photo of the sources.

    A folder stands for the files in and under it that have the suffix of a photo and are not
    hidden. Outputs are named by paths relative to that folder, or for a glob relative to its last
    folder before a wildcard. A list (.txt, .lst, or - for standard input) has a path or URL on each
    line, and an output is named by that whole path. Any other source is one photo, and its output
    is named by the last part of its path. Raise InputError for a source without photos, and if
    `must_exist` also for a local file that does not exist.
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

    URLs and missing files are in the result too. Reading them will raise the error.
    """
    paths: list[str] = []
    for source in sources:
        paths += [source] if is_url(source) else [path for path, _ in photos_of([source], False)]
    return paths


def is_picture(name: str) -> bool:
    """Return whether a file in a folder counts as a photo: by its suffix, and not hidden."""
    return name.lower().endswith(SUFFIXES) and not name.startswith(".")


def _photos(source: str, must_exist: bool) -> Iterator[tuple[str, str]]:
    """Yield (path or URL, output name with the photo's suffix) for each photo of a source."""
    if source == STANDARD_STREAM:
        yield from _photos_of_list(standard_stream(sys.stdin, "input"))
        return
    with file_system_of(source) as (fs, path):
        if source.lower().endswith(MANIFESTS):
            with fs.open(path, "rb") as lines:
                yield from _photos_of_list(lines)
        elif is_url(source):
            yield from _photos_at_url(fs, path, source)
        elif os.path.isdir(source):
            for path in _pictures(source):
                yield path, os.path.relpath(path, source)
        elif is_pattern(source):
            for path in sorted(glob.glob(source, recursive=True)):
                if not os.path.isdir(path):
                    yield path, os.path.relpath(path, _folder_of_pattern(source) or ".")
        else:
            if must_exist:
                os.lstat(source)  # raises OSError if it does not exist
            yield source, os.path.basename(source)


def _folder_of_pattern(pattern: str) -> str:
    """Return the folder that a pattern names before its first wildcard."""
    return os.path.dirname(PATTERN.split(pattern)[0])


def _photos_of_list(lines: Iterable[bytes]) -> Iterator[tuple[str, str]]:
    for number, line in enumerate(lines):
        line = line.removeprefix(codecs.BOM_UTF8) if number == 0 else line
        path = os.fsdecode(line.rstrip(b"\r\n"))
        if path.strip() and not path.lstrip().startswith("#"):
            # The output's name is the path without its root, its protocol and any "." and "..".
            rest = path.partition("://")[2] if is_url(path) else os.path.splitdrive(path)[1]
            parts = [part for part in PATH_SEPARATOR.split(rest) if part not in ("", ".", "..")]
            yield path, "/".join(parts) or path


def _pictures(root: str) -> Iterator[str]:
    """Yield the pictures in and under a folder. Links to folders are not followed."""

    def failed(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError):  # the folder was just removed
            raise error

    for folder, folders, files in os.walk(root, onerror=failed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (os.path.join(folder, name) for name in sorted(files) if is_picture(name))


def _photos_at_url(fs: Any, path: str, url: str) -> Iterator[tuple[str, str]]:
    """Yield (URL, output name with suffix) of each photo at, under or matching a URL."""
    host, has_path, _ = url.partition(path.rstrip("/"))  # fsspec's names lack the host
    is_pattern = PATTERN.search(url) is not None
    names = [path] if url.startswith("http") else (fs.glob if is_pattern else fs.find)(path)
    base = (_folder_of_pattern(path) if is_pattern else path).rstrip("/")
    for name in names:
        inside = name.removeprefix(base).lstrip("/") or os.path.basename(name)
        # As in shells, hidden files are left out unless the pattern has a "/.".
        is_hidden = "/." in f"/{inside}" and "/." not in path.removeprefix(base)
        # A photo that is named or matches a pattern may have any suffix.
        if name == path or (not is_hidden and (is_pattern or is_picture(inside))):
            yield host + name if has_path else fs.unstrip_protocol(name), inside
