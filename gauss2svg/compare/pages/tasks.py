"""The tasks of a gallery, and the folders of what they make, which stay when photos change."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gauss2svg.compare.grid import Task
from gauss2svg.compare.pages.artifacts import RECORD
from gauss2svg.compare.pages.options import GalleryOptions
from gauss2svg.compare.variants import Variant
from gauss2svg.photo.listing import ListedPhoto, slug_of

PHOTOS = "photos"  # the folder of the photos' folders


def folder_of(photo: ListedPhoto, variant: Variant | None = None) -> str:
    """The folder of a photo, or of an SVG of it, relative to the gallery, with /."""
    return f"{PHOTOS}/{photo.slug}" + (f"/{variant.slug}" if variant else "")


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


@dataclass(frozen=True)
class Tasks:
    """The tasks of a gallery in the folder root; threads and max_memory (bytes): of a process."""

    root: Path
    options: GalleryOptions
    threads: int
    max_memory: int

    def prepare(self, photo: ListedPhoto) -> Task:
        """The task of preparing a photo for the pages."""
        request = self._request(photo, None) | {"kind": "photo", "digest": photo.digest}
        return Task(photo, None, request, (self.options.photo_size,))

    def make(self, photo: ListedPhoto, variant: Variant, prepared: Mapping[str, Any]) -> Task:
        """The task of making an SVG of a photo; prepared: the record of the photo."""
        options = self.options
        request = self._request(photo, variant) | {
            "kind": "variant",
            "shown": str(self.root / folder_of(photo) / prepared["photo"]),
            "tool": variant.tool,
            "settings": dict(variant.settings),
            "seed": options.seed,
            "jobs": options.jobs,
            "threads": self.threads,
            "max_memory": self.max_memory,
            "peer_timeout": options.peer_timeout,
        }
        # Processes, threads, memory and time limits change no image.
        seed = options.seed if variant.is_own else None  # which other tools are not given
        return Task(photo, variant, request, (options.photo_size, seed))

    def _request(self, photo: ListedPhoto, variant: Variant | None) -> dict[str, Any]:
        return {
            "path": photo.path,
            "folder": str(self.root / folder_of(photo, variant)),
            "photo_size": self.options.photo_size,
            "max_pixels": self.options.max_pixels,
        }
