"""The tasks of a gallery: requests to its workers, and the keys of finished work."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.bench.grid import code_digest
from gauss2svg.gallery.options import GalleryOptions
from gauss2svg.gallery.variants import Variant
from gauss2svg.photo.listing import ListedPhoto
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version

PHOTOS = "photos"  # the folder of the photos' folders


@dataclass(frozen=True)
class GallerySetup:
    """What all tasks share: the options, and the threads and memory (bytes) of a process."""

    options: GalleryOptions
    threads: int
    max_memory: int


@dataclass(frozen=True)
class Task:
    """A photo to prepare, or an SVG to make of it.

    variant  None for the photo itself
    folder   relative to the gallery, with /
    request  what the worker gets, as JSON
    """

    photo: ListedPhoto
    variant: Variant | None
    folder: str
    request: dict[str, Any]

    @property
    def label(self) -> str:
        """The task's name in a progress bar."""
        return self.photo.name + (f", {self.variant.name}" if self.variant else "")

    @property
    def key(self) -> str:
        """A hash of all that the result depends on, the package's code among it."""
        return self.request["key"]


def photo_folder(photo: ListedPhoto) -> str:
    """The folder of a photo and its SVGs."""
    return f"{PHOTOS}/{photo.slug}"


def photo_task(root: Path, photo: ListedPhoto, setup: GallerySetup) -> Task:
    """The task to prepare a photo for the pages."""
    folder = photo_folder(photo)
    request = _request("photo", root / folder, photo, setup, [])
    return Task(photo, None, folder, request | {"digest": photo.digest})


def variant_task(
    root: Path,
    photo: ListedPhoto,
    variant: Variant,
    setup: GallerySetup,
    record: Mapping[str, Any],
) -> Task:
    """The task to make an SVG of a photo; record: of the photo's own task."""
    parent = photo_folder(photo)
    folder = f"{parent}/{variant.slug}"
    parts = [variant.tool, variant.version, variant.settings, setup.options.seed]
    request = _request("variant", root / folder, photo, setup, parts)
    request |= {
        "shown": str(root / parent / record["photo"]),
        "tool": variant.tool,
        "settings": dict(variant.settings),
        "seed": setup.options.seed,
        "jobs": setup.options.jobs,
        "threads": setup.threads,
        "max_memory": setup.max_memory,
        "peer_timeout": setup.options.peer_timeout,
    }
    return Task(photo, variant, folder, request)


def _request(
    kind: str, folder: Path, photo: ListedPhoto, setup: GallerySetup, parts: list[Any]
) -> dict[str, Any]:
    # Processes, threads, memory and time limits are not part of the key: they change no image.
    measured_by = [code_digest(), renderer_version(DEFAULT_RENDERER)]
    whole = [kind, photo.digest, setup.options.photo_size, *measured_by, *parts]
    return {
        "kind": kind,
        "key": hashlib.sha256(json.dumps(whole).encode()).hexdigest(),
        "path": photo.path,
        "folder": str(folder),
        "photo_size": setup.options.photo_size,
        "max_pixels": setup.options.max_pixels,
    }
