"""The benchmark: plan the runs, do those that are missing one at a time, write the tables."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numba.core import config
from PIL import Image

from gauss2svg.bench import plots
from gauss2svg.bench.grid import BenchRun, settings_of
from gauss2svg.bench.machine import machine
from gauss2svg.bench.peers import PEERS, check_peers
from gauss2svg.bench.rows import TOOL, Row, RowStore, csv_text, json_text, one_line
from gauss2svg.bench.summary import markdown, summarise
from gauss2svg.errors import InputError, OutputError, whole_number
from gauss2svg.files import check_writable, write_all_atomically
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.version import __version__

DEFAULT_PEER_TIMEOUT = 300.0  # s
_LONGEST_TIMEOUT = 1e6  # s; the system's calls take no more than 24 days
_OUTPUTS = ("rows.jsonl", "bench.json", "bench.csv", "summary.md")


@dataclass(frozen=True)
class BenchProgress:
    """Where a benchmark stands: runs done of all, those kept from before, what runs now."""

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
    """Vectorise every photo by all settings, each in its own process; returns the rows.

    images     paths of photos; directory: where the tables and plots go, made if missing
    axes       values by keyword of `vectorize`, of which every combination is run, the
               rest at its default; None: gauss2svg.bench.DEFAULT_GRID
    peers      of gauss2svg.bench.peers.PEERS; those not installed are left out
    threads    of gauss2svg, None: one a core; peer_timeout: seconds for a peer's run
    progress   called with a BenchProgress before every run and at the end

    Writes rows.jsonl, bench.json, bench.csv and summary.md after every run, so that an
    interrupted benchmark goes on where it was: rows of the same picture, settings and
    version without error are kept. Plots come at the end, if matplotlib is installed. A run
    that fails is a row with "error". Raises InputError for bad arguments and pictures and
    OutputError for a directory that cannot be written, both before the first run.
    """
    whole_number("seed", seed, 0, 2**63 - 1)
    if threads is not None:
        # As many as numba has started; the attribute is made when its settings are read.
        most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
        whole_number("threads", threads, 1, most)
    if not 0 < peer_timeout <= _LONGEST_TIMEOUT:
        raise InputError(
            f"peer_timeout is {peer_timeout}; needed are seconds > 0, at most {_LONGEST_TIMEOUT:g}"
        )
    present, absent = check_peers(peers)
    all_settings = settings_of(axes)
    pictures = _pictures(images)
    plan = [
        BenchRun(path, name, digest, settings, seed=seed, threads=threads)
        for settings in all_settings
        for path, name, digest in pictures
    ]
    plan += _peer_runs(present, pictures)
    names = [name for _, name, _ in pictures]
    folder = _folder(directory)
    store = RowStore(folder / "rows.jsonl")
    rows = {run.key: row for run in plan if (row := store.finished(run.key)) is not None}
    kept = len(rows)
    tell = progress or (lambda _: None)
    for run in plan:
        if run.key not in rows:
            tell(BenchProgress(len(rows), len(plan), kept, f"{run.label}, {run.name}"))
            rows[run.key] = _do(run, peer_timeout)
            store.append(rows[run.key])
            _write_tables(folder, _in_order(plan, rows), names, absent)
    finished = _in_order(plan, rows)
    summary = _write_tables(folder, finished, names, absent)
    if plots.available():
        plots.draw_plots(summary, folder)
    tell(BenchProgress(len(plan), len(plan), kept))
    return finished


def _pictures(images: Sequence[str | os.PathLike[str]]) -> list[tuple[str, str, str]]:
    """Path, name and digest of each; names are as much of the path as tells them apart."""
    if not images:
        raise InputError("got no picture; give the paths of some photos")
    paths = [Path(image) for image in images]
    digests: dict[str, Path] = {}
    for path in paths:
        load_image(path)  # a bad one is told now, not hours later
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if digest in digests:
            raise InputError(f"{digests[digest]} and {path} are one picture; give it once")
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


def _peer_runs(names: Iterable[str], pictures: Sequence[tuple[str, str, str]]) -> list[BenchRun]:
    return [
        BenchRun(
            path, name, digest, tuple(sorted(settings.items())), peer, PEERS[peer].version() or ""
        )
        for peer in names
        for settings in PEERS[peer].settings
        for path, name, digest in pictures
    ]


def _folder(directory: str | os.PathLike[str]) -> Path:
    folder = Path(directory)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"cannot make {folder}: {reason}; choose another folder") from error
    for name in _OUTPUTS:
        check_writable(folder / name)
    return folder


def _in_order(plan: Iterable[BenchRun], rows: Mapping[str, Row]) -> list[Row]:
    # A row kept from before may know its picture by the name that it had then.
    return [rows[run.key] | {"image": run.name} for run in plan if run.key in rows]


def _write_tables(
    folder: Path, rows: Sequence[Row], names: Sequence[str], absent: Sequence[str]
) -> list[Row]:
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
    }
    write_all_atomically({folder / name: text.encode() for name, text in texts.items()})
    return summary


def _do(run: BenchRun, peer_timeout: float) -> Row:
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
    job = {
        "image": run.image,
        "tool": run.tool,
        "settings": settings,
        "seed": run.seed,
        "threads": run.threads,
    }
    if run.tool == TOOL:
        return row | in_own_process(job, None)
    row["versions"][run.tool] = run.version
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png = Path(folder) / "photo.png"
        pixels = np.round(load_image(run.image, matte=WHITE).pixels * 255).astype(np.uint8)
        Image.fromarray(pixels).save(png)
        return row | in_own_process(job | {"folder": folder, "png": str(png)}, peer_timeout)


def in_own_process(job: Mapping[str, Any], timeout: float | None) -> Row:
    """What the worker says of a job; an error row if it dies or takes more than timeout s."""
    # -P: no module of the folder that it is started in.
    command = [sys.executable, "-P", "-m", "gauss2svg.bench.worker"]
    with ExitStack() as stack:
        chatter = stack.enter_context(tempfile.TemporaryFile())
        process = stack.enter_context(
            # A session of its own, so that what a peer starts ends with it.
            subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=chatter,
                start_new_session=True,
            )
        )
        try:
            answer, _ = process.communicate(json.dumps(job).encode(), timeout)
        except subprocess.TimeoutExpired:
            _kill(process)
            return {"error": f"timed out after {timeout:g} s; give a longer --peer-timeout"}
        except BaseException:
            _kill(process)
            raise
        if process.returncode == 0:
            return json.loads(answer)
        return {"error": one_line(f"{end_of(process.returncode)}: {last_line(chatter)}")}


def _kill(process: subprocess.Popen[bytes]) -> None:
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except (AttributeError, ProcessLookupError):  # Windows; or gone already
        process.kill()


def end_of(status: int) -> str:
    """How a process ended, by its status."""
    if status < 0:
        return f"killed by {signal.Signals(-status).name}; was there enough memory?"
    return f"ended with status {status}"


def last_line(stream: IO[bytes]) -> str:
    """What a process said last, of all that it said into this file."""
    stream.seek(0)
    lines = stream.read()[-4000:].decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "it said nothing"
