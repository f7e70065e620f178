"""Find the photos that folders, patterns, lists and URLs stand for, and name each of them once.

Files are on this machine, or in stores that fsspec can access, such as S3.
"""

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
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from gauss2svg import errors, files
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, on_one_line, quoted, refusal
from gauss2svg.options import file_name
from gauss2svg.photo import SUFFIXES

STATE = "gauss2svg-batch"  # folder in the output folder, for the table, the options and the marks


class _Local:
    """Access to local files, by functions with the same names as in a file system of fsspec."""

    open = staticmethod(open)
    exists = staticmethod(os.path.exists)
    size = staticmethod(os.path.getsize)

    def cat_file(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def ukey(self, path: str) -> str:
        """Return text that changes with the file: its size and the time of its last change."""
        status = os.stat(path)
        return f"{status.st_size} {status.st_mtime_ns}"


def is_url(path: str) -> bool:
    """Return whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


@contextmanager
def file_system_of(
    name: str, verb: str = "read", kind: type[Gauss2SvgError] = InputError
) -> Iterator[tuple[Any, str]]:
    """Yield the file system of a path or URL, and the path in that file system.

    An error of the with block is turned into an error of the class `kind`, whose message begins
    with "cannot `verb`". Only a Gauss2SvgError and a MemoryError stay as they are.
    """
    advice = "the path or the URL of a photo, a folder, a glob or a list"
    try:
        if is_url(name):
            advice = 'pip install "gauss2svg[s3]", or the package of another store'
            from fsspec.core import url_to_fs

            advice = "another URL, or the same command again"
            fs, path = url_to_fs(name)
            # Without this, files that are written after a listing would seem to be missing.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _Local(), name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # stores raise exceptions of their own classes
        raise kind(f"cannot {verb} {name}: {files.reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes) -> None:
    """Write the file `name` in the folder `root`, either the whole file or nothing.

    Folders are created. Raise OutputError if the file cannot be written.
    """
    target = f"{root}/{name}"
    if is_url(target):
        with file_system_of(target, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
    else:
        files.make_folder(Path(target).parent)
        files.write_atomically(target, data)


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
            place = "standard input" if source == files.STANDARD_STREAM else source
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
    if source == files.STANDARD_STREAM:
        data = files.standard_stream(sys.stdin, "input").read()
        yield from _photos_of_list(data, "standard input")
        return
    with file_system_of(source) as (fs, path):
        if source.lower().endswith((".txt", ".lst")):
            yield from _photos_of_list(fs.cat_file(path), source)
        elif is_url(source):
            yield from _photos_at_url(fs, path, source)
        elif os.path.isdir(source):
            for path in _files(source):
                if path.lower().endswith(SUFFIXES):
                    yield path, os.path.relpath(path, source)
        elif files.is_pattern(source):
            for path in sorted(glob.glob(source, recursive=True)):
                if not os.path.isdir(path):
                    yield path, os.path.relpath(path, _folder_of_pattern(source) or ".")
        else:
            if must_exist:
                os.lstat(source)  # raises OSError if there is no such file
            yield source, os.path.basename(source)


def _folder_of_pattern(pattern: str) -> str:
    """Return the folder that a pattern names before its first wildcard: photos for photos/*.jpg."""
    return os.path.dirname(files.PATTERN.split(pattern)[0])


def _photos_of_list(data: bytes, name: str) -> Iterator[tuple[str, str]]:
    for line in files.text_of(data, name).split("\n"):
        # A path may have blanks or quotes around it, as Windows copies it.
        path = line.strip().strip("\"'")
        if path and not path.startswith("#"):
            # The name of the output is the path without its protocol or drive, without a slash at
            # the beginning, and without the parts "." and "..".
            rest = PurePath(path.partition("://")[2] if is_url(path) else path)
            parts = [part for part in rest.parts if part not in (rest.anchor, "..")]
            yield path, "/".join(parts) or path


def passed_over(sources: Iterable[str]) -> str:
    """Return a line on the files in folders that do not have the suffix of a photo, or ""."""
    folders = [source for source in sources if os.path.isdir(source)]
    # The files of a batch may be in the same folder as its photos.
    known = (*SUFFIXES, *files.SVG_ENDINGS)
    paths = [
        path for folder in folders for path in _files(folder)
        if not path.lower().endswith(known) and STATE not in Path(path).parts
    ]  # fmt: skip
    endings = ", ".join(sorted({os.path.splitext(path)[1].lower() or "none" for path in paths}))
    return f"{errors.several(len(paths), 'file')} passed over: {endings}" * bool(paths)


def _files(root: str) -> Iterator[str]:
    """Yield the paths of the files in a folder and in its subfolders, except for hidden ones.

    Links to folders are not followed.
    """

    def failed(error: OSError) -> None:
        raise error

    for folder, folders, names in os.walk(root, onerror=failed):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        visible = (name for name in sorted(names) if not name.startswith("."))
        yield from (os.path.join(folder, name) for name in visible)


def _photos_at_url(fs: Any, path: str, url: str) -> Iterator[tuple[str, str]]:
    """Yield (URL of a photo, name of the output) for each photo that a URL names.

    The URL names a photo, a folder with photos, or a pattern that photos match. The name of the
    output still ends in the suffix of the photo.
    """
    is_glob = files.PATTERN.search(url) is not None
    names = [path] if url.startswith("http") else (fs.glob if is_glob else fs.find)(path)
    base = (_folder_of_pattern(path) if is_glob else path).rstrip("/")
    for name in names:
        inside = name.removeprefix(base).lstrip("/") or os.path.basename(name)
        # Files found in a folder must have the suffix of a photo. If the URL names a file or is a
        # pattern, any suffix is taken.
        if name == path or is_glob or (is_picture(inside) and "/." not in f"/{inside}"):
            yield fs.unstrip_protocol(name), inside


@dataclass(frozen=True)
class ListedPhoto:
    """A photo of a list.

    path     path of the file
    name     the file's name, or the whole path if another photo has the same name. It is on one
             line, with control characters escaped
    slug     name for the output file or folder of this photo, which no other photo has. It
             consists of a-z, 0-9 and -.
    digest   SHA-256 of the file's bytes, or None if the file cannot be read
    """

    path: str
    name: str
    slug: str
    digest: str | None


def listed_photos(
    paths: Sequence[str | os.PathLike[str]], name: str = "photos"
) -> list[ListedPhoto]:
    """Return each photo once, in the order of the paths. Raise InputError if there is none.

    A photo's slug is made from the name of its file. If several photos would have the same slug, a
    digest of its name is appended. The order of the photos has no influence on the slugs.

    name  name of the argument in error messages
    """
    if isinstance(paths, (str, bytes, os.PathLike)):
        raise refusal(name, "a sequence of paths", quoted(paths), f"[{paths!r}]")
    once: dict[str, str] = {}
    for path in (file_name(name, path) for path in paths):
        once.setdefault(os.path.realpath(path), path)
    if not once:
        raise refusal(name, "the paths of one or more photos", quoted(paths))
    names = Counter(Path(path).name for path in once.values())
    slugs = Counter(slug_of(Path(path).stem) for path in once.values())
    photos = []
    for path in once.values():
        file, slug = Path(path).name, slug_of(Path(path).stem)
        if names[file] > 1:
            file = Path(path).as_posix()
        if slugs[slug] > 1:
            slug += f"-{hashlib.sha256(file.encode(errors='surrogatepass')).hexdigest()[:12]}"
        photos.append(ListedPhoto(path, on_one_line(file), slug, _digest(path)))
    return photos


def slug_of(name: str) -> str:
    """Return a name, changed so that it is valid for a file or folder on any system.

    The result has 1 to 48 characters, which are a-z, 0-9 and -. It is "photo" if the name has
    neither letters nor digits.
    """
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", ascii_name).strip("-")[:48].rstrip("-") or "photo"


def _digest(path: str) -> str | None:
    """Return the SHA-256 of a file, or None if it cannot be read."""
    with suppress(InputError, OSError), files.reading(path, "another photo") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
    return None
