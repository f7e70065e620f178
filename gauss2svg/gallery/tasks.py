"""What there is to do, as the workers are told it, and the keys by which it is known as done."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gauss2svg.bench.grid import code_digest
from gauss2svg.gallery.options import GalleryOptions
from gauss2svg.gallery.photos import GalleryPhoto
from gauss2svg.gallery.variants import Variant
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version

PHOTOS = "photos"  # the folder of the photos' folders


@dataclass(frozen=True)
class GallerySetup:
    """What all the work of a gallery shares: its options, and threads and bytes of a process."""

    options: GalleryOptions
    threads: int
    max_memory: int


@dataclass(frozen=True)
class Task:
    """A photo, or where variant is one, an SVG of it; folder: relative to the gallery, with /."""

    photo: GalleryPhoto
    variant: Variant | None
    folder: str
    work: dict[str, Any]

    @property
    def label(self) -> str:
        """What a progress bar calls it."""
        return self.photo.name + (f", {self.variant.name}" if self.variant else "")

    @property
    def key(self) -> str:
        """The same for the same work by the same code."""
        return self.work["key"]


def photo_folder(photo: GalleryPhoto) -> str:
    """Where a photo and what is made of it lie."""
    return f"{PHOTOS}/{photo.slug}"


def photo_task(root: Path, photo: GalleryPhoto, setup: GallerySetup) -> Task:
    """To make of a photo what pages show of it."""
    folder = photo_folder(photo)
    work = _work("photo", root / folder, photo, setup, [])
    return Task(photo, None, folder, work | {"digest": photo.digest})


def variant_task(
    root: Path,
    photo: GalleryPhoto,
    variant: Variant,
    setup: GallerySetup,
    record: Mapping[str, Any],
) -> Task:
    """To make an SVG of a photo, of which pages show what the record says."""
    parent = photo_folder(photo)
    folder = f"{parent}/{variant.slug}"
    ingredients = [variant.tool, variant.version, variant.settings, setup.options.seed]
    work = _work("variant", root / folder, photo, setup, ingredients)
    work |= {
        "shown": str(root / parent / record["photo"]),
        "tool": variant.tool,
        "settings": dict(variant.settings),
        "seed": setup.options.seed,
        "jobs": setup.options.jobs,
        "threads": setup.threads,
        "max_memory": setup.max_memory,
        "peer_timeout": setup.options.peer_timeout,
    }
    return Task(photo, variant, folder, work)


def _work(
    kind: str, folder: Path, photo: GalleryPhoto, setup: GallerySetup, ingredients: list[Any]
) -> dict[str, Any]:
    # Jobs, threads, memory and timeouts are left out: they change no picture, or it is told.
    measured_by = [code_digest(), renderer_version(DEFAULT_RENDERER)]
    whole = [kind, photo.digest, setup.options.photo_size, *measured_by, *ingredients]
    return {
        "kind": kind,
        "key": hashlib.sha256(json.dumps(whole).encode()).hexdigest(),
        "path": photo.path,
        "folder": str(folder),
        "photo_size": setup.options.photo_size,
        "max_pixels": setup.options.max_pixels,
    }
