"""Find the photos that folders, patterns, lists and URLs stand for, and name each of them once."""

from __future__ import annotations

import glob
import hashlib
import os
import posixpath
import re
import sys
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import IO, Any

from gauss2svg.batch.stores import PATH_SEPARATOR, file_system_of, is_url
from gauss2svg.errors import InputError, on_one_line, quoted, refusal
from gauss2svg.files import (
    PATTERN,
    STANDARD_STREAM,
    UTF16_MARKS,
    is_device,
    is_pattern,
    reading,
    standard_stream,
    text_of,
)
from gauss2svg.photo import SUFFIXES


def photos_of(sources: Iterable[str], must_exist: bool = True) -> Iterator[tuple[str, str]]:
    """Yield (path or URL, name of the output without a suffix) for each photo of the sources.

    A source is one of these four:

    A folder stands for all files in it and in its subfolders that have the suffix of a photo and
    are not hidden. The name of an output is the photo's path relative to the folder.
    A pattern stands for the files that match it. The name of an output is the photo's path
    relative to the folder that the pattern names before its first wildcard.
    A list (a .txt or .lst file, or - for standard input) has a path or URL on each line. The name
    of an output is that whole path.
    Any other source is one photo. The name of its output is the last part of its path.

    Raise InputError for a source without photos. If `must_exist` is True, also raise it if a source
    is one local photo that does not exist.
    """
    for source in sources:
        photo = None
        for photo in _photos(source, must_exist):
            path, name = photo
            yield path, posixpath.splitext(name.replace(os.sep, "/"))[0]
        if photo is None:
            place = "standard input" if source == STANDARD_STREAM else source
            raise refusal("photos", "one or more", f"none in {place}", "a folder of photos")


def local_photos(sources: Iterable[str]) -> list[str]:
    """Return the path of each photo of the sources, for commands that read only local files.

    URLs and the names of missing files stay in the result. The command raises an error when it
    reads them.
    """
    paths: list[str] = []
    for source in sources:
        paths += [source] if is_url(source) else [path for path, _ in photos_of([source], False)]
    return paths


def is_picture(name: str) -> bool:
    """Return whether a file in a folder is a photo: it has a photo's suffix and is not hidden."""
    return name.lower().endswith(SUFFIXES) and not name.startswith(".")


def _photos(source: str, must_exist: bool) -> Iterator[tuple[str, str]]:
    """Yield (path or URL, name of the output) for each photo.

    Here the name of the output still ends in the suffix of the photo.
    """
    if source == STANDARD_STREAM:
        yield from _photos_of_list(standard_stream(sys.stdin, "input"), "standard input")
        return
    with file_system_of(source) as (fs, path):
        if source.lower().endswith((".txt", ".lst")):
            with fs.open(path, "rb") as lines:
                yield from _photos_of_list(lines, source)
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
                os.lstat(source)  # raises OSError if there is no such file
            yield source, os.path.basename(source)


def _folder_of_pattern(pattern: str) -> str:
    """Return the folder that a pattern names before its first wildcard: photos for photos/*.jpg."""
    return os.path.dirname(PATTERN.split(pattern)[0])


def _photos_of_list(stream: IO[bytes], name: str) -> Iterator[tuple[str, str]]:
    for line in _lines(stream, name):
        if line.strip() and not line.lstrip().startswith("#"):
            # A path may have blanks or quotes around it, as Windows copies it.
            path = re.sub(r"""\A\s*(["']?)(.+?)\1\s*\Z""", r"\2", line)
            if path != line and os.path.lexists(line):  # names may have blanks and quotes too
                path = line
            # os.fsdecode has made such characters of bytes that are not UTF-8.
            if re.search("[\udc80-\udcff]", path) and not os.path.lexists(path):
                text_of(os.fsencode(path), name)  # raises InputError
            # The name of the output is the path without its protocol or drive, without a slash at
            # the beginning, and without the parts "." and "..".
            rest = path.partition("://")[2] if is_url(path) else os.path.splitdrive(path)[1]
            parts = [part for part in PATH_SEPARATOR.split(rest) if part not in ("", ".", "..")]
            yield path, "/".join(parts) or path


def _lines(stream: IO[bytes], name: str) -> Iterator[str]:
    """Yield the lines of a list. Bytes that are not UTF-8 are decoded as os.fsdecode does."""
    first = stream.readline()
    if first.startswith(UTF16_MARKS):  # its lines end inside of a character of two bytes
        lines: Iterable[str] = text_of(first + stream.read(), name).split("\n")
    else:
        lines = (text_of(line, name, "surrogateescape") for line in chain([first], stream))
    yield from (line.rstrip("\r\n") for line in lines)


def _pictures(root: str) -> Iterator[str]:
    """Yield the paths of the photos in a folder and in its subfolders, except for hidden ones.

    Links to folders are not followed.
    """

    def failed(error: OSError) -> None:
        # A subfolder that was removed after it was listed is no error.
        if not isinstance(error, FileNotFoundError):
            raise error

    for folder, folders, files in os.walk(root, onerror=failed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (os.path.join(folder, name) for name in sorted(files) if is_picture(name))


def _photos_at_url(fs: Any, path: str, url: str) -> Iterator[tuple[str, str]]:
    """Yield (URL of a photo, name of the output) for each photo that a URL names.

    The URL names a photo, a folder with photos, or a pattern that photos match. The name of the
    output still ends in the suffix of the photo.
    """
    # The names that fsspec returns lack the protocol, and in some stores also the host. So the
    # beginning of the URL is put before each name again.
    host, has_path, _ = url.partition(path.rstrip("/"))
    is_pattern = PATTERN.search(url) is not None
    names = [path] if url.startswith("http") else (fs.glob if is_pattern else fs.find)(path)
    base = (_folder_of_pattern(path) if is_pattern else path).rstrip("/")
    for name in names:
        inside = name.removeprefix(base).lstrip("/") or os.path.basename(name)
        # Hidden files are left out, unless the pattern itself has a "/.". A shell does the same.
        is_hidden = "/." in f"/{inside}" and "/." not in path.removeprefix(base)
        # Files found in a folder must have the suffix of a photo. If the URL names a file or is a
        # pattern, any suffix is taken.
        if name == path or (not is_hidden and (is_pattern or is_picture(inside))):
            yield host + name if has_path else fs.unstrip_protocol(name), inside


@dataclass(frozen=True)
class ListedPhoto:
    """A photo of a list.

    path     path of the file
    name     `file` on one line, with control characters escaped
    file     the file's name. If another photo has the same name, the folders before it are added
             until no other path has the same end.
    slug     name for the output file or folder of this photo, which no other photo has. It
             consists of a-z, 0-9 and -.
    digest   SHA-256 of the file's bytes, or None if the file cannot be read
    problem  reason why the file cannot be read, or None if it can be read
    """

    path: str
    name: str
    file: str
    slug: str
    digest: str | None
    problem: str | None = None


def listed_photos(
    paths: Sequence[str | os.PathLike[str]], name: str = "photos"
) -> list[ListedPhoto]:
    """Return each photo once, in the order of the paths. Raise InputError if there is none.

    A photo's slug is made from the name of its file. To make all slugs different, a digest of the
    field `file` is appended in three cases: if several readable photos would have the same slug, if
    the photo cannot be read, and if the slug already ends like a digest. The order of the photos
    and their pixels have no influence on the slugs.

    name  name of the argument in error messages
    """
    if isinstance(paths, (str, bytes, os.PathLike)):
        raise refusal(name, "a sequence of paths", quoted(paths), f"[{paths!r}]")
    try:
        texts = [os.fsdecode(path) for path in paths or ()]
    except Exception as error:  # methods of the argument may raise any exception
        raise refusal(name, "a sequence of paths", quoted(paths)) from error
    if not texts:
        raise refusal(name, "the paths of one or more photos", quoted(paths))
    once: dict[str, str] = {}
    for path in texts:
        # realpath() fails for a path with a NUL character. Such a path is refused later, when the
        # file is read.
        once.setdefault(path if "\0" in path else os.path.realpath(path), path)
    texts = list(once.values())
    read = [(slug_of(Path(path).stem), *_digest(path)) for path in texts]
    shared = Counter(slug for slug, digest, _ in read if digest is not None)
    photos = []
    for path, file, (slug, digest, problem) in zip(texts, _unique_ends(texts), read, strict=True):
        # A slug that already ends like a digest gets a digest too. Otherwise it might equal the
        # slug of another photo to which a digest is appended.
        if digest is None or shared[slug] > 1 or re.search("-[0-9a-f]{12}$", slug):
            own = hashlib.sha256(file.encode(errors="backslashreplace")).hexdigest()
            slug += f"-{own[:12]}"
        photos.append(ListedPhoto(path, on_one_line(file), file, slug, digest, problem))
    return photos


def _unique_ends(paths: Sequence[str]) -> list[str]:
    """Return a name for each path: the last parts of the path, as few as make the name unique.

    If no other file has the same name, this is the name of the file.
    """
    parts = [Path(path).absolute().parts for path in paths]
    all_ends = [[own[-length:] for length in range(1, len(own) + 1)] for own in parts]
    shared = Counter(end for ends in all_ends for end in ends)
    return [
        Path(*next((end for end in ends if shared[end] == 1), ends[-1])).as_posix()
        for ends in all_ends
    ]


def slug_of(name: str) -> str:
    """Return a name, changed so that it is valid for a file or folder on any system.

    The result has 1 to 54 characters, which are a-z, 0-9 and -. It is "photo" if the name has
    neither letters nor digits.
    """
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = re.sub(r"[^a-z0-9]+", "-", ascii_name).strip("-")[:48].rstrip("-") or "photo"
    return f"photo-{slug}" if is_device(slug) else slug


def _digest(path: str) -> tuple[str | None, str | None]:
    """Return (SHA-256 of a file, None), or (None, the reason why it cannot be read)."""
    try:
        with reading(path, "the path of a photo") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest(), None
    except (InputError, OSError) as error:
        return None, on_one_line(str(error))
