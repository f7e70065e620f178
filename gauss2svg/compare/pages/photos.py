"""The folders of a gallery's photos, which stay when photos are added or removed."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from gauss2svg.compare.pages.artifacts import RECORD
from gauss2svg.photo.listing import ListedPhoto, slug_of


def with_kept_slugs(photos: Iterable[ListedPhoto], folder: Path) -> list[ListedPhoto]:
    """The photos with the slugs of folders that already hold their results.

    Without this, adding or removing a photo of the same name would change the folder of another,
    and all its SVGs would be made again.
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
    """Whether a folder holds the photo with this digest."""
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and digest is not None and record.get("digest") == digest
