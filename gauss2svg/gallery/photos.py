"""The photos of a gallery: what they are called on its pages, and in which folders they live."""

from __future__ import annotations

import hashlib
import json
import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gauss2svg.errors import InputError, on_one_line
from gauss2svg.gallery.work import RECORD

_LONGEST_SLUG = 48
_NAMELESS = "photo"
# Windows opens a device for these, whatever follows a dot.
_DEVICES = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])$")


@dataclass(frozen=True)
class GalleryPhoto:
    """A photo to be shown.

    path    of the file; name: its own, as text that is safe to print, after its folder's where
            another photo has the same
    slug    its folder's name: a-z, 0-9 and -, the only one of its gallery
    digest  SHA-256 of the file's bytes; None where it cannot be read, of which trouble tells
    """

    path: str
    name: str
    slug: str
    digest: str | None
    trouble: str | None = None


def gallery_photos(paths: Sequence[str | os.PathLike[str]]) -> list[GalleryPhoto]:
    """Each photo once, where it is named first; raises InputError for none at all."""
    if isinstance(paths, (str, bytes, os.PathLike)):
        raise InputError(f"photos is {paths!r}; needed is a sequence of paths: [{paths!r}]")
    try:
        named = [os.fsdecode(path) for path in paths or ()]
    except TypeError as error:
        raise InputError(f"photos are {paths!r}; needed is a sequence of paths") from error
    if not named:
        raise InputError("got no photo; give the paths of some")
    once: dict[str, str] = {}
    for path in named:
        once.setdefault(_target(path), path)
    texts = list(once.values())
    read = [_digest(path) for path in texts]
    slugs = unique_slugs(
        (Path(path).stem, digest) for path, (digest, _) in zip(texts, read, strict=True)
    )
    return [
        GalleryPhoto(path, name, slug, digest, trouble)
        for path, name, slug, (digest, trouble) in zip(
            texts, _names(texts), slugs, read, strict=True
        )
    ]


def _names(paths: Sequence[str]) -> list[str]:
    """Of each path its last part, on one line; with its folder where another has the same."""
    parts = [Path(path).absolute().parts for path in paths]
    shared = Counter(own[-1] for own in parts)
    return [on_one_line("/".join(own[-2:] if shared[own[-1]] > 1 else own[-1:])) for own in parts]


def unique_slugs(photos: Iterable[tuple[str, str | None]]) -> list[str]:
    """Folders of photos by their names and digests, in their order, no two alike.

    Of one name they are told apart by what is in them, so that neither their order nor one that
    cannot be read, of which there is no digest, moves another.
    """
    known = [(slug_of(name), digest) for name, digest in photos]
    shared = Counter(slug for slug, digest in known if digest)
    # Those that have their name to themselves first, those without a folder last.
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


def with_kept_slugs(photos: Iterable[GalleryPhoto], folder: Path) -> list[GalleryPhoto]:
    """The photos in the folders, of all in `folder`, in which what is made of them lies already.

    One of the same name that has come or gone would give them others, and all be made again.
    """
    listed = list(photos)
    taken = {photo.slug for photo in listed}
    found = []
    for photo in listed:
        plain = slug_of(Path(photo.path).stem)
        others = [plain, f"{plain}-{photo.digest[:8]}"] if photo.digest else []
        slugs = [photo.slug, *(slug for slug in others if slug not in taken)]
        slug = next((s for s in slugs if _holds(folder / s, photo.digest)), photo.slug)
        taken.add(slug)
        found.append(replace(photo, slug=slug))
    return found


def _holds(folder: Path, digest: str | None) -> bool:
    """Whether a folder is that of the photo of a digest."""
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and digest is not None and record.get("digest") == digest


def slug_of(name: str) -> str:
    """A name as that of a folder on any system, in 1 to 48 characters of a-z, 0-9 and -."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    slug = re.sub(r"[^a-z0-9]+", "-", plain).strip("-")[:_LONGEST_SLUG].rstrip("-") or _NAMELESS
    return f"{_NAMELESS}-{slug}" if _DEVICES.match(slug) else slug


def _target(path: str) -> str:
    """What a path leads to through links; the path itself where it is none."""
    try:
        return os.path.realpath(path)
    except ValueError:  # a NUL inside, of which reading tells
        return path


def _digest(path: str) -> tuple[str | None, str | None]:
    """SHA-256 of a file, or why it cannot be read."""
    if os.path.exists(path) and not os.path.isfile(path):
        kind = "a folder" if os.path.isdir(path) else "no file"
        return None, f"{on_one_line(path)} is {kind}; give the path of a photo"
    try:
        with open(path, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest(), None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return None, f"cannot read {on_one_line(path)}: {reason}; give the path of a photo"
