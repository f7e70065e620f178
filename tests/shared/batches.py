"""Photos, clusters and folders that the tests of batches share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from PIL import Image

from gauss2svg.batch.records import RECORDS, BatchSpec
from gauss2svg.batch.stores import PARTS, STATE, Store
from gauss2svg.pipeline.options import Options

# The least work that still gives a file of its own for each photo.
TINY = {"quality": "draft", "gaussians": 4, "iterations": 3}
TINY_COMMAND = [part for name, value in TINY.items() for part in (f"--{name}", str(value))]


def tiny(**given) -> Options:
    """Options of the least work."""
    return Options.from_flat(TINY | given)


def spec_of(folder: Path) -> BatchSpec:
    """What the photos of a batch into a folder share."""
    return BatchSpec(tiny(), Store(str(folder)), {}, "")


def save_photo(path: Path, seed: int, side: int = 12) -> Path:
    """A photo of its own for every seed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (side, side, 3), np.uint8)
    Image.fromarray(pixels).save(path)
    return path


def save_photos(folder: Path, names: list[str]) -> Path:
    """A folder of photos of these names."""
    for seed, name in enumerate(names):
        save_photo(folder / name, seed)
    return folder


def outputs(folder: Path) -> dict[str, bytes]:
    """The files of an output folder by their names, without its records."""
    return {
        os.fspath(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and STATE not in path.parts
    }


def lines(folder: Path) -> list[str]:
    """All lines of all records."""
    paths = sorted((folder / RECORDS).iterdir())
    return [line for path in paths for line in path.read_text().splitlines()]


def left_parts(folder: Path) -> list[str]:
    """Unfinished files."""
    return os.listdir(folder / PARTS)
