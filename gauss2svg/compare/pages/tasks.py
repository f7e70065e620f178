"""The tasks of a gallery: requests to its workers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.compare.pages.options import GalleryOptions
from gauss2svg.compare.run import Task
from gauss2svg.compare.variants import Variant
from gauss2svg.photo.listing import ListedPhoto

PHOTOS = "photos"  # the folder of the photos' folders


@dataclass(frozen=True)
class GallerySetup:
    """What all tasks share: the folder, the options, threads and memory (bytes) of a process."""

    root: Path
    options: GalleryOptions
    threads: int
    max_memory: int


def folder_of(photo: ListedPhoto, variant: Variant | None = None) -> str:
    """The folder of a photo, or of an SVG of it, relative to the gallery."""
    return f"{PHOTOS}/{photo.slug}" + (f"/{variant.slug}" if variant else "")


def photo_task(photo: ListedPhoto, setup: GallerySetup) -> Task:
    """The task to prepare a photo for the pages."""
    request = _request("photo", photo, None, setup) | {"digest": photo.digest}
    return Task(photo, None, request, (setup.options.photo_size,))


def variant_task(
    photo: ListedPhoto, variant: Variant, setup: GallerySetup, record: Mapping[str, Any]
) -> Task:
    """The task to make an SVG of a photo; record: of the photo's own task."""
    options = setup.options
    request = _request("variant", photo, variant, setup) | {
        "shown": str(setup.root / folder_of(photo) / record["photo"]),
        "tool": variant.tool,
        "settings": dict(variant.settings),
        "seed": options.seed,
        "jobs": options.jobs,
        "threads": setup.threads,
        "max_memory": setup.max_memory,
        "peer_timeout": options.peer_timeout,
    }
    # Processes, threads, memory and time limits change no image.
    return Task(photo, variant, request, (options.photo_size, options.seed))


def _request(
    kind: str, photo: ListedPhoto, variant: Variant | None, setup: GallerySetup
) -> dict[str, Any]:
    return {
        "kind": kind,
        "path": photo.path,
        "folder": str(setup.root / folder_of(photo, variant)),
        "photo_size": setup.options.photo_size,
        "max_pixels": setup.options.max_pixels,
    }
