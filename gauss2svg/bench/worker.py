"""One run in a process of its own: `python -m gauss2svg.bench.worker`.

The job comes as JSON on standard input and its row goes as JSON to standard output, so
that CPU seconds and peak memory are of this run alone. Nothing heavy is imported at the
top: a peer's memory is to be the peer's.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

from gauss2svg.bench.machine import Stopwatch, peak_bytes
from gauss2svg.bench.rows import TOOL, finite, one_line

_WARM_UP_SIDE = 32  # px
_WARM_UP: dict[str, Any] = {"iterations": 2}
_FROM_REPORT = (
    "width", "height", "fit_width", "fit_height", "gaussians", "iterations", "rounds",
    "stop_reason", "threads", "renderer", "psnr_model", "psnr_svg", "ssim_svg",
    "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs",
)  # fmt: skip


def run_job(job: dict[str, Any]) -> dict[str, Any]:
    """The measured part of a row; a failure is a row with error, one line."""
    try:
        return _run_own(job) if job["tool"] == TOOL else _run_peer(job)
    except MemoryError as error:
        return {"error": f"out of memory ({error}); try fewer gaussians or a smaller max_size"}
    except Exception as error:  # a peer raises what it likes, and the other runs go on
        return {"error": one_line(f"{type(error).__name__}: {error}")}


def _run_own(job: dict[str, Any]) -> dict[str, Any]:
    import numpy as np

    from gauss2svg.bench.grid import AXES
    from gauss2svg.pipeline.kernels import compile_kernels
    from gauss2svg.pipeline.options import Options
    from gauss2svg.pipeline.vectorize import vectorize_by

    given = {**job["settings"], "seed": job["seed"], "threads": job["threads"]}
    options = Options.from_flat(given)
    warming = time.perf_counter()
    compile_kernels()
    # With the same options, so that no import and no code path is new to the clock.
    noise = np.random.default_rng(0).random((_WARM_UP_SIDE, _WARM_UP_SIDE, 3))
    vectorize_by(Options.from_flat(given | _WARM_UP), noise)
    warmup_s = time.perf_counter() - warming
    watch = Stopwatch()
    report = vectorize_by(options, job["image"]).report
    clocks = watch.read()
    return {
        "used": job["settings"] | {name: report[name] for name in AXES if name in report},
        **{name: report[name] for name in _FROM_REPORT},
        **clocks,
        "warmup_s": warmup_s,
        "peak_bytes": peak_bytes(),
        "bytes_raw": report["svg_bytes"],
        "bytes_gzipped": report["svgz_bytes"],
        "versions": report["versions"],
    }


def _run_peer(job: dict[str, Any]) -> dict[str, Any]:
    from gauss2svg.bench.peers import PEERS

    peer = PEERS[job["tool"]]
    drawn = Path(job["folder"]) / f"drawn{peer.suffix}"
    work = peer.prepare(Path(job["png"]), drawn, **job["settings"])
    watch = Stopwatch()
    work()
    clocks = watch.read()
    peak = peak_bytes()  # now, before what scores is loaded

    row = {"used": job["settings"], "peak_bytes": peak, **clocks}
    if not job.get("scored", True):
        return row
    from gauss2svg.bench.score import score

    return row | score(drawn, job["image"])


def main() -> None:
    """Read the job, do it, write the row."""
    job = json.load(sys.stdin)
    answer = os.dup(1)
    os.dup2(2, 1)  # a peer may chat; the row is all that goes to standard output
    row = json.dumps(finite(run_job(job)), allow_nan=False)
    with os.fdopen(answer, "w") as stream:
        stream.write(row + "\n")


if __name__ == "__main__":
    main()
