"""Photos that are given by their paths: each once, with a name to show and one for files."""

from __future__ import annotations

import hashlib
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gauss2svg.errors import InputError, on_one_line, quoted
from gauss2svg.files import is_device

_NAMELESS = "photo"
_ADVICE = "Try the path of a photo"


@dataclass(frozen=True)
class ListedPhoto:
    """A photo of a list.

    path     of the file
    name     the file's name as printable text, with its folders where others have the same name
    file     the same as it is
    slug     name for a file or folder of its own: a-z, 0-9 and -, unique
    digest   SHA-256 of the file's bytes; None where it cannot be read
    problem  why it cannot be read
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
    """Each photo once, in order of its first mention; raises InputError if there is none.

    name  of the argument, in errors
    """
    if isinstance(paths, (str, bytes, os.PathLike)):
        raise InputError(
            f"{name} must be a sequence of paths; got {quoted(paths)}. Try [{paths!r}]"
        )
    try:
        named = [os.fsdecode(path) for path in paths or ()]
    except Exception as error:  # of the values' own methods
        raise InputError(f"{name} must be a sequence of paths; got {quoted(paths)}") from error
    if not named:
        raise InputError(f"{name} must be the paths of one or more photos; got {quoted(paths)}")
    once: dict[str, str] = {}
    for path in named:
        once.setdefault(_resolved(path), path)
    texts = list(once.values())
    read = [_digest(path) for path in texts]
    slugs = unique_slugs(
        (Path(path).stem, digest) for path, (digest, _) in zip(texts, read, strict=True)
    )
    return [
        ListedPhoto(path, on_one_line(file), file, slug, digest, problem)
        for path, file, slug, (digest, problem) in zip(
            texts, _names(texts), slugs, read, strict=True
        )
    ]


def _names(paths: Sequence[str]) -> list[str]:
    """The shortest end of each path that no other has: mostly the file's name."""
    parts = [Path(path).absolute().parts for path in paths]
    all_ends = [[own[-length:] for length in range(1, len(own) + 1)] for own in parts]
    shared = Counter(end for ends in all_ends for end in ends)
    return [
        Path(*next((end for end in ends if shared[end] == 1), ends[-1])).as_posix()
        for ends in all_ends
    ]


def unique_slugs(photos: Iterable[tuple[str, str | None]]) -> list[str]:
    """Unique names for the folders of photos, given their (name, digest), in the same order.

    Photos of one name are distinguished by their digest, so that neither their order nor a photo
    that cannot be read, whose digest is None, changes the folder of another.
    """
    known = [(slug_of(name), digest) for name, digest in photos]
    shared = Counter(slug for slug, digest in known if digest)
    # Unique names come first; photos that cannot be read, which need no folder, last.
    turns = sorted(range(len(known)), key=lambda at: (not known[at][1], shared[known[at][0]] > 1))
    slugs = [""] * len(known)
    taken: set[str] = set()
    for at in turns:
        slug, digest = known[at]
        first = f"{slug}-{digest[:8]}" if shared[slug] > 1 and digest else slug
        slug, copies = first, 1
        while slug in taken:
            copies += 1
            slug = f"{first}-{copies}"
        slugs[at] = slug
        taken.add(slug)
    return slugs


def slug_of(name: str) -> str:
    """A folder name that every system accepts: 1 to 48 characters of a-z, 0-9 and -."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:48].rstrip("-") or _NAMELESS
    return f"{_NAMELESS}-{slug}" if is_device(slug) else slug


def _resolved(path: str) -> str:
    """The path with links resolved; an invalid path as it is."""
    try:
        return os.path.realpath(path)
    except ValueError:  # a NUL character: reading reports it
        return path


def _digest(path: str) -> tuple[str | None, str | None]:
    """(SHA-256 of a file, None), or (None, why it cannot be read)."""
    if os.path.exists(path) and not os.path.isfile(path):
        kind = "a folder" if os.path.isdir(path) else "not a regular file"
        return None, f"{on_one_line(path)} is {kind}. {_ADVICE}"
    try:
        with open(path, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest(), None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return None, f"cannot read {on_one_line(path)}: {reason}. {_ADVICE}"
