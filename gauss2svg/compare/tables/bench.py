"""The benchmark: list the runs, do the missing ones one at a time, write tables and plots."""

from __future__ import annotations

import hashlib
import os
import platform
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from numba.core import config

from gauss2svg.bench import plots
from gauss2svg.bench.grid import BenchRun, settings_of
from gauss2svg.bench.machine import machine
from gauss2svg.bench.peers import PEERS, check_peers
from gauss2svg.bench.process import in_own_process
from gauss2svg.bench.rows import TOOL, Row, RowStore, csv_text, json_text
from gauss2svg.bench.summary import markdown, summarise
from gauss2svg.errors import InputError, OutputError, number_within, quoted, whole_number
from gauss2svg.files import as_png, check_writable, write_all_atomically
from gauss2svg.options import file_name
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.version import __version__

DEFAULT_PEER_TIMEOUT = 300.0  # s
_LONGEST_TIMEOUT = 1e6  # s; the system's calls take no more than 24 days
_OUTPUTS = ("rows.jsonl", "bench.json", "bench.csv", "summary.md", *plots.NAMES)


@dataclass(frozen=True)
class BenchProgress:
    """Progress of a benchmark: finished and total runs, how many were kept, the current one."""

    done: int
    total: int
    kept: int
    now: str = ""


def run_bench(
    images: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    axes: Mapping[str, Sequence[Any]] | None = None,
    peers: Iterable[str] = (),
    seed: int = 0,
    threads: int | None = None,
    peer_timeout: float = DEFAULT_PEER_TIMEOUT,
    progress: Callable[[BenchProgress], None] | None = None,
) -> list[Row]:
    """Vectorise every photo with all settings, each in its own process; returns the rows.

    images        paths of photos
    directory     folder of the tables and plots, created if missing
    axes          values by option of `vectorize`: every combination is run, with the other
                  options at their defaults; None: gauss2svg.bench.grid.DEFAULT_GRID
    peers         names from gauss2svg.bench.peers.PEERS; those not installed are skipped
    threads       CPU threads of gauss2svg; None: one per core
    peer_timeout  time limit (s) of a peer's run
    progress      called with a BenchProgress before every run and at the end

    After every run rows.jsonl, bench.json, bench.csv, summary.md and the plots are written, so an
    interrupted benchmark continues: rows without error of the same photo, settings and version
    are kept. A run that fails is a row with "error". Raises InputError for bad arguments and
    photos and OutputError for a folder that cannot be written, both before the first run.
    """
    whole_number("seed", seed, 0, 2**63 - 1)
    if threads is not None:
        # The number of threads that numba has started; numba creates the attribute dynamically.
        most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
        whole_number("threads", threads, 1, most)
    number_within("peer_timeout", peer_timeout, 1e-3, _LONGEST_TIMEOUT)
    present, absent = check_peers(peers)
    settings_list = settings_of(axes)
    photos = _photos(images)
    plan = [
        BenchRun(path, name, digest, settings, seed=seed, threads=threads)
        for settings in settings_list
        for path, name, digest in photos
    ]
    plan += _peer_runs(present, photos)
    names = [name for _, name, _ in photos]
    folder = Path(file_name("directory", directory, "the name of a folder"))
    make_folder(folder)
    for name in _OUTPUTS:
        check_writable(folder / name)
    store = RowStore(folder / "rows.jsonl")
    rows = {run.key: row for run in plan if (row := store.finished(run.key)) is not None}
    kept = len(rows)
    report = progress or (lambda _: None)
    for run in plan:
        if run.key not in rows:
            report(BenchProgress(len(rows), len(plan), kept, f"{run.label}, {run.name}"))
            rows[run.key] = _row(run, peer_timeout)
            store.append(rows[run.key])
            _write_tables(folder, _in_order(plan, rows), names, absent)
    _write_tables(folder, _in_order(plan, rows), names, absent)
    report(BenchProgress(len(plan), len(plan), kept))
    return _in_order(plan, rows)


def _photos(images: Sequence[str | os.PathLike[str]]) -> list[tuple[str, str, str]]:
    """(path, name, digest) of each; a name is the shortest end of the path that is unique."""
    if not images:
        raise InputError(f"images must be the paths of one or more photos; got {quoted([])}")
    paths = [Path(file_name("images", image)) for image in images]
    digests: dict[str, Path] = {}
    for path in paths:
        load_image(path)  # a bad photo is reported now, not after hours of runs
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if digest in digests:
            raise InputError(
                f"{path} must not be the same photo as {digests[digest]}. Try giving it once"
            )
        digests[digest] = path
    parts = [path.resolve().parts for path in paths]
    names = [
        next(
            "/".join(own[-length:])
            for length in range(1, len(own) + 1)
            if sum(own[-length:] == other[-length:] for other in parts) == 1
        )
        for own in parts
    ]
    return [(str(p), n, d) for p, n, d in zip(paths, names, digests, strict=True)]


def _peer_runs(names: Iterable[str], photos: Sequence[tuple[str, str, str]]) -> list[BenchRun]:
    return [
        BenchRun(
            path, name, digest, tuple(sorted(settings.items())), peer, PEERS[peer].version() or ""
        )
        for peer in names
        for settings in PEERS[peer].settings
        for path, name, digest in photos
    ]


def make_folder(folder: Path) -> None:
    """Create a folder and those above it; raises OutputError where that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"cannot create {folder}: {reason}. Try another folder") from error


def _in_order(plan: Iterable[BenchRun], rows: Mapping[str, Row]) -> list[Row]:
    # A kept row may have the name that its photo had then.
    return [rows[run.key] | {"image": run.name} for run in plan if run.key in rows]


def _write_tables(
    folder: Path, rows: Sequence[Row], names: Sequence[str], absent: Sequence[str]
) -> None:
    summary = summarise(rows, len(names))
    document = {
        "gauss2svg": __version__,
        "images": names,
        "peers_absent": absent,
        "summary": summary,
        "rows": rows,
    }
    texts = {
        "bench.json": json_text(document),
        "bench.csv": csv_text(rows),
        "summary.md": markdown(summary, rows, names),
        **plots.plots_of(summary),
    }
    write_all_atomically({folder / name: text.encode() for name, text in texts.items()})


def _row(run: BenchRun, peer_timeout: float) -> Row:
    settings = dict(run.settings)
    row: Row = {
        "key": run.key,
        "label": run.label,
        "preset": settings.get("quality") if len(settings) == 1 else None,
        "tool": run.tool,
        "tool_version": run.version,
        "image": run.name,
        "image_sha256": run.digest,
        "settings": settings,
        "seed": run.seed,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": {"gauss2svg": __version__, "python": platform.python_version()},
    }
    request = {
        "image": run.image,
        "tool": run.tool,
        "settings": settings,
        "seed": run.seed,
        "threads": run.threads,
    }
    if run.tool == TOOL:
        return row | in_own_process(request, None)
    row["versions"][run.tool] = run.version
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png = Path(folder) / "photo.png"
        png.write_bytes(as_png(load_image(run.image, matte=WHITE).pixels))
        return row | in_own_process(request | {"folder": folder, "png": str(png)}, peer_timeout)
