"""One run in a process of its own: `python -m gauss2svg.bench.worker`.

It reads a request as a line of JSON from standard input and writes the row as JSON to standard
output, so that CPU time and peak memory are those of this run alone. Where its input ends, its
parent is gone, and it ends with what a peer has started. It imports heavy modules only where
needed, or they would count as a peer's memory.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

from gauss2svg.bench.machine import Stopwatch, peak_bytes
from gauss2svg.bench.rows import TOOL, finite, one_line
from gauss2svg.measure.scores import SCORES

_WARM_UP_SIDE = 32  # px
_WARM_UP: dict[str, Any] = {"iterations": 2}
_FROM_REPORT = (
    "width", "height", "fit_width", "fit_height", "gaussians", "iterations", "rounds",
    "stop_reason", "threads", "renderer", "psnr_model",
    *(score.key for score in SCORES), "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs",
)  # fmt: skip


def answer_to(request: dict[str, Any]) -> dict[str, Any]:
    """The measured part of a row; of a run that fails it is "error", one line."""
    try:
        return _run_own(request) if request["tool"] == TOOL else _run_peer(request)
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try fewer gaussians or a smaller max_size"}
    except Exception as error:  # a peer may raise anything, and the other runs continue
        return {"error": one_line(f"{type(error).__name__}: {error}")}


def _run_own(request: dict[str, Any]) -> dict[str, Any]:
    import numpy as np

    from gauss2svg.bench.grid import AXES
    from gauss2svg.bench.tuning import apply_constants, options_in
    from gauss2svg.measure.perceptual import perceptual_scores
    from gauss2svg.pipeline.kernels import compile_kernels
    from gauss2svg.pipeline.options import Options
    from gauss2svg.pipeline.vectorize import vectorize_by

    apply_constants(request["settings"])
    given = options_in(request["settings"])
    # At the size of the photo, at which the files of peers are measured.
    given |= {"seed": request["seed"], "threads": request["threads"], "full_size": True}
    options = Options.from_flat(given)
    warming = time.perf_counter()
    compile_kernels()
    # With the same options, so that no import or code path runs for the first time.
    noise = np.random.default_rng(0).random((_WARM_UP_SIDE, _WARM_UP_SIDE, 3))
    vectorize_by(Options.from_flat(given | _WARM_UP), noise)
    warmup_s = time.perf_counter() - warming
    watch = Stopwatch()
    result = vectorize_by(options, request["image"])
    clocks, peak = watch.read(), peak_bytes()  # without what the scores take
    report = result.report | perceptual_scores(result.raster, result.photo).report
    return {
        "used": request["settings"] | {name: report[name] for name in AXES if name in report},
        **{name: report[name] for name in _FROM_REPORT},
        **clocks,
        "warmup_s": warmup_s,
        "peak_bytes": peak,
        "bytes_raw": report["svg_bytes"],
        "bytes_gzipped": report["svgz_bytes"],
        "versions": report["versions"],
    }


def _run_peer(request: dict[str, Any]) -> dict[str, Any]:
    from gauss2svg.bench.peers import PEERS

    peer = PEERS[request["tool"]]
    output = Path(request["folder"]) / f"output{peer.suffix}"
    convert = peer.prepare(Path(request["png"]), output, **request["settings"])
    watch = Stopwatch()
    convert()
    clocks = watch.read()
    peak = peak_bytes()  # before the modules that score are imported

    row = {"used": request["settings"], "peak_bytes": peak, **clocks}
    if not request.get("scored", True):
        return row
    from gauss2svg.bench.score import score

    return row | score(output, request["image"])


def main() -> None:
    """Read the request, run it, write the row."""
    request = json.loads(sys.stdin.buffer.readline())
    # Of its own, as what a peer starts gets the null device.
    parent, null = os.dup(0), os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    answer = os.dup(1)
    os.dup2(2, 1)  # output of a peer goes to standard error
    row = json.dumps(finite(answer_to(request)), allow_nan=False)
    with os.fdopen(answer, "w", encoding="utf-8") as stream:
        stream.write(row + "\n")


def _end_with_parent(parent: int) -> None:
    """End this process and what a peer has started once its input has ended."""
    while os.read(parent, 1):
        pass
    from gauss2svg.processes import end_tree  # psutil, which would count as a peer's memory

    end_tree(os.getpid())
    os._exit(1)


if __name__ == "__main__":
    main()
