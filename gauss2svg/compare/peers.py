"""Peers: other tools that turn a photo into a small file, for the benchmark and galleries.

The package of a peer is imported only in the process that runs the peer. The files of any other
method are in a folder, with a CSV of what they cost. A CSV alone has numbers without files.
"""

from __future__ import annotations

import csv
import hashlib
import io
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.batch.inputs import local_photos
from gauss2svg.batch.table import TABLE
from gauss2svg.compare.records import start_watch
from gauss2svg.errors import refusal
from gauss2svg.files import reading, text_of
from gauss2svg.photo import SUFFIXES

Conversion = Callable[[], object]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


class Peer(NamedTuple):
    """A tool other than gauss2svg.

    prepare   function that imports the tool, reads the PNG, and returns a second function, which
              writes the file. Only the time of the second function is measured.
    suffix    suffix of the file
    settings  each item has keyword arguments of `prepare`. By default the benchmark runs the tool
              with every item, and a gallery runs it with the first.
    version   function that returns the installed version, or None if the tool is not installed
    """

    prepare: Callable[..., Conversion]
    suffix: str
    settings: tuple[dict[str, Any], ...]
    version: Callable[[], str | None] = partial(_version, "Pillow")


def _vtracer(png: Path, output: Path, style: str, **changes: Any) -> Conversion:
    import vtracer  # pyright: ignore[reportMissingImports]

    paths = str(png), str(output)
    return lambda: vtracer.convert_image_to_svg_py(*paths, **_VTRACER[style] | changes)


_VTRACER: dict[str, dict[str, Any]] = {
    "default": {},
    "polygon": {
        "mode": "polygon", "path_precision": 0, "filter_speckle": 4, "layer_difference": 16,
    },
    "detailed": {"filter_speckle": 1, "color_precision": 8, "layer_difference": 4},
}  # fmt: skip


def _pillow(format_name: str, png: Path, output: Path, quality: int) -> Conversion:
    from PIL import Image

    with Image.open(png) as image:
        pixels = image.convert("RGB")
    # The first save loads the codec, which must not be part of the measured time.
    pixels.save(io.BytesIO(), format_name, quality=quality)
    return lambda: pixels.save(output, format_name, quality=quality)


def _avif_version() -> str | None:
    """Return the version of the AVIF codec, or None if Pillow was built without it."""
    from PIL import features

    return features.version("avif")


def _settings(name: str, values: Iterable[Any]) -> tuple[dict[str, Any], ...]:
    return tuple({name: value} for value in values)


_QUALITIES = _settings("quality", (10, 30, 60, 90))


PEERS: dict[str, Peer] = {
    "vtracer": Peer(_vtracer, ".svg", _settings("style", _VTRACER), partial(_version, "vtracer")),
    "jpeg": Peer(partial(_pillow, "JPEG"), ".jpg", _QUALITIES),
    "webp": Peer(partial(_pillow, "WEBP"), ".webp", _QUALITIES),
    "avif": Peer(partial(_pillow, "AVIF"), ".avif", _QUALITIES, _avif_version),
}


def convert_by(tool: str, settings: dict[str, Any], png: Path, output: Path) -> dict[str, Any]:
    """Write the file of a peer, and return its cost.

    Call this in a process of its own, because it silences standard output and standard error.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(null, stream)
    convert = PEERS[tool].prepare(png, output, **settings)
    cost = start_watch()
    convert()
    return cost()


BATCH = "batch"  # label of the files that a batch has made


def rows_of(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV. Raise InputError if it cannot be read."""
    with reading(path, "a CSV file") as file:
        text = text_of(file.read(), str(path))
    return list(csv.DictReader(io.StringIO(text)))


def photos_and_peers(
    sources: Sequence[str], batch: Path | None, command: str
) -> tuple[list[str], list[str]]:
    """Return the photos of a comparison, and the peers that a batch adds.

    sources  photos, folders, patterns and lists. If there are none, the photos are those of `batch`
    batch    output folder of gauss2svg batch, or None
    command  name of the command, for the error if there are no photos
    """
    if batch is None:
        if not sources:
            raise refusal("PHOTOS", "given", "none", f"gauss2svg {command} --help")
        return local_photos(sources), []
    if not (batch / TABLE).is_file():
        raise refusal("--from", "the output folder of gauss2svg batch", f"no {batch / TABLE}")
    photos = [row["input"] for row in rows_of(batch / TABLE) if not row["error"]]
    return local_photos(sources) if sources else photos, [f"{BATCH}={batch}"]


def entries_of(files: str, photos: Iterable[str]) -> Iterator[dict[str, Any]]:
    """Yield what a method has of each photo: its file, the SHA-256 of that, and its numbers.

    files  folder of SVGs and pictures with the names of the photos, or a CSV. The folder may have a
           table.csv, or that of a batch. The column `photo` or `input` of a CSV has the name of the
           photo, and `output` that of the file. If there is neither, the only row holds for all.

    The file is None if the folder has none, and "" for a CSV. Numbers are those of a report, by its
    names.
    """
    folder, is_table = Path(files), Path(files).is_file()
    tables = [folder] if is_table else [folder / "table.csv", folder / TABLE]
    rows = [row for path in tables if path.is_file() for row in rows_of(path)]
    named = {row.get("photo") or row.get("input") or "": row for row in rows}
    by_stem = {Path(name).stem: row for name, row in named.items()}
    pictures = {} if is_table else {
        path.stem: path for path in sorted(folder.iterdir())
        if path.name.lower().endswith((*SUFFIXES, ".svg", ".svgz"))
    }  # fmt: skip
    for photo in photos:
        stem = Path(photo).stem
        row = named.get(photo) or by_stem.get(stem) or named.get("") or {}
        path = folder / row["output"] if row.get("output") else pictures.get(stem)
        data = path.read_bytes() if path and path.is_file() else None
        yield {
            "file": "" if is_table and row else data and str(path),
            "digest": data and hashlib.sha256(data).hexdigest(),
            "numbers": numbers_of(row),
        }


def numbers_of(row: Mapping[str, str]) -> dict[str, float]:
    """Return the cells of a row that are numbers."""
    numbers = {}
    for name, cell in row.items():
        with suppress(ValueError, TypeError):
            numbers[name] = int(cell) if cell.isdecimal() else float(cell)
    return numbers
