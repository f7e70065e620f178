"""Photos, workers and folders that the tests of batches share."""

from __future__ import annotations

import csv
import json
from concurrent.futures import Future
from pathlib import Path

import numpy as np
from PIL import Image

from gauss2svg.batch.many import MARKS, STATE, TABLE
from gauss2svg.pipeline.options import Options

# The least work that still gives a file of its own for each photo.
TINY = {"quality": "draft", "gaussians": 4, "iterations": 3}
TINY_COMMAND = [part for name, value in TINY.items() for part in (f"--{name}", str(value))]


def tiny(**given) -> Options:
    """Options of the least work."""
    return Options.from_flat(TINY | given)


class PoolHere:
    """Stands in for a pool: its jobs run in this process, where tests can change what they do."""

    def __init__(self, workers: int, **_: object) -> None:
        self.workers = workers

    def __enter__(self) -> PoolHere:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def submit(self, function, *args) -> Future:
        job = Future()
        try:
            job.set_result(function(*args))
        except Exception as error:
            job.set_exception(error)
        return job


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
    """The SVGs of an output folder by their names."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and STATE not in path.parts and path.name[0] != "."  # unfinished
    }


def rows(folder: Path) -> dict[str, dict[str, str]]:
    """The table of an output folder, by its outputs."""
    with (folder / TABLE).open(newline="", encoding="utf-8") as stream:
        return {row["output"]: row for row in csv.DictReader(stream)}


def marks(folder: Path) -> dict[str, dict]:
    """What the marks of an output folder say, by their outputs."""
    found = [json.loads(path.read_bytes()) for path in (folder / MARKS).rglob("*.json")]
    return {one["output"]: one for one in found}
