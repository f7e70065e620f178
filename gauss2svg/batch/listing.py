"""List each photo once, with a name to show to users and a name for its output files."""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gauss2svg.errors import InputError, on_one_line, quoted, refusal
from gauss2svg.files import is_device, reading

_NAMELESS = "photo"  # slug of a file name that has neither letters nor digits
_DIGITS = 12  # number of hexadecimal digits in a slug's digest
_DIGEST_AT_END = re.compile(rf"-[0-9a-f]{{{_DIGITS}}}$")


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
        if digest is None or shared[slug] > 1 or _DIGEST_AT_END.search(slug):
            own = hashlib.sha256(file.encode(errors="backslashreplace")).hexdigest()
            slug += f"-{own[:_DIGITS]}"
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

    The result has 1 to 48 characters, which are a-z, 0-9 and -.
    """
    ascii_name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = re.sub(r"[^a-z0-9]+", "-", ascii_name).strip("-")[:48].rstrip("-") or _NAMELESS
    return f"{_NAMELESS}-{slug}" if is_device(slug) else slug


def _digest(path: str) -> tuple[str | None, str | None]:
    """Return (SHA-256 of a file, None), or (None, the reason why it cannot be read)."""
    try:
        with reading(path, "the path of a photo") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest(), None
    except (InputError, OSError) as error:
        return None, on_one_line(str(error))
