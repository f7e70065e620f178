"""The benchmark: each run in a process of its own, one at a time; tables and plots after each."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gauss2svg.batch import raise_pending
from gauss2svg.compare import plots
from gauss2svg.compare.axes import settings_of
from gauss2svg.compare.columns import markdown, summarise
from gauss2svg.compare.grid import Grid, Progress, Task
from gauss2svg.compare.machine import machine
from gauss2svg.compare.peer_run import peer_record
from gauss2svg.compare.peers import PEERS, check_peers
from gauss2svg.compare.records import Row, add_row, answered, csv_text, rows_in
from gauss2svg.compare.variants import Variant, of_peer
from gauss2svg.compare.worker import in_own_process
from gauss2svg.errors import InputError, number_within, whole_number
from gauss2svg.files import as_json, check_writable, make_folder, write_all_atomically
from gauss2svg.options import file_name
from gauss2svg.photo.listing import ListedPhoto, listed_photos
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.run import thread_count
from gauss2svg.version import __version__

_ROWS = "rows.jsonl"
_OUTPUTS = (_ROWS, "bench.json", "bench.csv", "summary.md", *plots.NAMES)


def run_bench(
    images: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    axes: Mapping[str, Sequence[Any]] | None = None,
    peers: Iterable[str] = (),
    seed: int = 0,
    threads: int | None = None,
    peer_timeout: float = 300.0,
    references: str | os.PathLike[str] | None = None,
    reference_scale: float = 4.0,
    progress: Callable[[Progress], None] | None = None,
) -> list[Row]:
    """Vectorise every photo with all settings, each in its own process; returns the rows.

    images        paths of photos
    directory     folder of the tables and plots, created if missing
    axes          values by option of `vectorize`: every combination is run, with the other
                  options at their defaults; None: gauss2svg.compare.axes.DEFAULT_GRID
    peers         names from gauss2svg.compare.peers.PEERS; those not installed are skipped
    threads       CPU threads of gauss2svg; None: one per core
    peer_timeout  time limit (s) of a peer's run
    references    folder with the SVG that each photo was made from, by the photo's name; SVGs are
                  compared with it at reference_scale times the photo's size
    progress      called with a Progress whenever a run begins or ends

    After every run rows.jsonl, bench.json, bench.csv, summary.md and the plots are written, so an
    interrupted benchmark continues: rows without error of the same photo, settings and version
    are kept. A run that fails is a row with "error". Raises InputError for bad arguments and
    photos and OutputError for a folder that cannot be written, both before the first run.
    """
    whole_number("seed", seed, 0, 2**63 - 1)
    thread_count(threads)
    # The system's calls take no more than 24 days.
    number_within("peer_timeout", peer_timeout, 1e-3, 1e6)
    present, absent = check_peers(peers)
    variants = [Variant(settings) for settings in settings_of(axes)]
    variants += [of_peer(peer, settings) for peer in present for settings in PEERS[peer].settings]
    number_within("reference_scale", reference_scale, 1e-3, 1000.0)
    photos = _photos(images)
    sources = {} if references is None else _sources(photos, references)
    given = {"seed": seed, "threads": threads, "peer_timeout": peer_timeout}
    given |= {"reference_scale": reference_scale}
    plan = [
        _task(photo, variant, {**given, "reference": sources.get(photo)})
        for variant in variants
        for photo in photos
    ]
    folder = Path(file_name("directory", directory, "the name of a folder"))
    make_folder(folder)
    for name in _OUTPUTS:
        check_writable(folder / name)
    known = rows_in(folder / _ROWS)  # those of other settings and versions are kept as well

    def finished(task: Task) -> Row | None:
        row = known.get(task.key, {"error": "not run yet"})
        return None if "error" in row else row

    grid = Grid(finished, len(plan), progress)

    def write() -> list[Row]:
        # A kept row may have the name that its photo had then.
        found = [task for task in plan if task.place in grid.records]
        rows = [grid.records[task.place] | {"image": task.photo.name} for task in found]
        files = _tables(rows, [photo.name for photo in photos], absent)
        write_all_atomically({folder / name: data for name, data in files.items()})
        for name in set(plots.NAMES) - files.keys():  # of an earlier benchmark that had this score
            (folder / name).unlink(missing_ok=True)
        return rows

    for task, answer in grid.answers(_one_by_one, grid.missing(plan)):
        row = grid.records[task.place] = _row(task, seed) | answer
        # Appended, so that a second benchmark into the folder and later versions keep theirs.
        add_row(folder / _ROWS, row)
        write()
    return write()


def _photos(images: Sequence[str | os.PathLike[str]]) -> list[ListedPhoto]:
    """The photos; raises InputError for one that cannot be read and for copies."""
    photos = listed_photos(images, "images")
    known: dict[str | None, str] = {}
    for photo in photos:
        load_image(photo.path)  # a bad photo is reported now, not after hours of runs
        if photo.digest in known:
            raise InputError(
                f"{photo.path} must not be the same photo as {known[photo.digest]}. "
                "Try giving it once"
            )
        known[photo.digest] = photo.path
    return photos


def _sources(
    photos: Sequence[ListedPhoto], folder: str | os.PathLike[str]
) -> dict[ListedPhoto, str]:
    """The SVG of each photo in a folder; raises InputError where one is missing."""
    sources = {}
    for photo in photos:
        source = Path(folder) / f"{Path(photo.path).stem}.svg"
        if not source.is_file():
            raise InputError(
                f"references must have an SVG for each photo; got no {source}. Try another folder"
            )
        sources[photo] = str(source)
    return sources


def _task(photo: ListedPhoto, variant: Variant, given: Mapping[str, Any]) -> Task:
    request = {
        "image": photo.path,
        "tool": variant.tool,
        "settings": dict(variant.settings),
        **given,
    }
    # Other tools are given neither.
    others: tuple[Any, ...] = (given["seed"], given["threads"]) if variant.is_own else ()
    if given["reference"] is not None:
        digest = hashlib.sha256(Path(given["reference"]).read_bytes()).hexdigest()
        others += digest, given["reference_scale"]
    return Task(photo, variant, request, others)


def _one_by_one(
    requests: Sequence[Mapping[str, Any]], begun: Callable[[int], None]
) -> Iterator[tuple[int, Row]]:
    for index, request in enumerate(requests):
        raise_pending()
        begun(index)
        is_peer = request["tool"] in PEERS
        yield index, answered(peer_record, request) if is_peer else in_own_process(request, None)


def _tables(rows: Sequence[Row], names: Sequence[str], absent: Sequence[str]) -> dict[str, bytes]:
    summary = summarise(rows, len(names))
    document = {
        "gauss2svg": __version__,
        "images": names,
        "peers_absent": absent,
        "summary": summary,
        "rows": rows,
    }
    texts = {
        "bench.csv": csv_text(rows),
        "summary.md": markdown(summary, rows, names),
        **plots.plots_of(summary),
    }
    return {"bench.json": as_json(document)} | {name: t.encode() for name, t in texts.items()}


def _row(task: Task, seed: int) -> Row:
    """What is known of a run beside what its worker answers."""
    variant = task.variant
    assert variant is not None
    versions = {"gauss2svg": __version__, "python": platform.python_version()}
    return {
        "key": task.key,
        "label": variant.label,
        "preset": variant.preset,
        "tool": variant.tool,
        "tool_version": variant.version,
        "image": task.photo.name,
        "image_sha256": task.photo.digest,
        "settings": dict(variant.settings),
        "seed": seed,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": versions if variant.is_own else {**versions, variant.tool: variant.version},
    }
