"""One run in a process of its own: `python -m gauss2svg.compare.worker REQUEST`, and its start.

Its argument is a request in JSON, and it writes the record as JSON to standard output, so that CPU
time and peak memory are those of this run alone: in a worker of `batch` they would be Dask's as
well (docs/decisions/batch.md). Where its standard input ends, its parent is gone, and it ends with
what a peer has started. It imports heavy modules only where needed, or they would count as a
peer's memory.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gauss2svg.compare.machine import Stopwatch, peak_bytes
from gauss2svg.compare.records import TOOL, Row, answered, finite
from gauss2svg.errors import error_line
from gauss2svg.measure.scores import SCORES

_FROM_REPORT = (
    "width", "height", "fit_width", "fit_height", "gaussians", "iterations", "rounds",
    "stop_reason", "threads", "renderer", "psnr_model",
    *(score.key for score in SCORES), "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs",
)  # fmt: skip


def in_own_process(request: Mapping[str, Any], timeout: float | None) -> Row:
    """The worker's row; one with "error" if it dies or takes more than timeout seconds."""
    from gauss2svg.processes import end_of, module_command, module_path, run

    command = module_command("gauss2svg.compare.worker", json.dumps(request))
    try:
        # What a peer starts is killed with it; where its input ends, its parent is gone.
        ended = run(command, timeout_s=timeout, environment=module_path(), tied=True)
    except TimeoutError:
        return {"error": f"timed out after {timeout:g} s. Try a longer --peer-timeout"}
    if ended.status == 0:
        return json.loads(ended.output)
    return {"error": error_line(f"{end_of(ended.status)}: {ended.complaint or 'no message'}")}


def _run(request: Mapping[str, Any]) -> dict[str, Any]:
    return _run_own(request) if request["tool"] == TOOL else _run_peer(request)


def _run_own(request: Mapping[str, Any]) -> dict[str, Any]:
    from gauss2svg.compare.variants import AXES, apply_constants, options_in
    from gauss2svg.measure.check import enlarged
    from gauss2svg.measure.perceptual import perceptual_scores
    from gauss2svg.pipeline.options import Options
    from gauss2svg.pipeline.vectorize import vectorize_by, warm_up

    apply_constants(request["settings"])
    given = options_in(request["settings"])
    # At the size of the photo, at which the files of peers are measured.
    given |= {"seed": request["seed"], "threads": request["threads"], "full_size": True}
    options = Options.from_flat(given)
    warming = time.perf_counter()
    warm_up(given)
    warmup_s = time.perf_counter() - warming
    watch = Stopwatch()
    result = vectorize_by(options, request["image"])
    clocks, peak = watch.read(), peak_bytes()  # without what the scores take
    report = result.report | perceptual_scores(result.raster, result.photo).report
    larger, source = None, request.get("reference")
    if source is not None:
        size = report["width"], report["height"]
        larger = enlarged(result.svg, source, size, request["reference_scale"]).psnr
    return {
        "used": request["settings"] | {name: report[name] for name in AXES if name in report},
        **{name: report[name] for name in _FROM_REPORT},
        "psnr_svg_enlarged": larger,
        **clocks,
        "warmup_s": warmup_s,
        "peak_bytes": peak,
        "svg_bytes": report["svg_bytes"],
        "svgz_bytes": report["svgz_bytes"],
        "versions": report["versions"],
    }


def _run_peer(request: Mapping[str, Any]) -> dict[str, Any]:
    from gauss2svg.compare.peers import PEERS

    prepare = PEERS[request["tool"]].prepare
    convert = prepare(Path(request["png"]), Path(request["output"]), **request["settings"])
    watch = Stopwatch()
    convert()
    clocks = watch.read()
    return {"used": request["settings"], "peak_bytes": peak_bytes(), **clocks}


def main() -> None:
    """Run the request, write the record."""
    request = json.loads(sys.argv[1])
    # Of its own, as what a peer starts gets the null device.
    parent, null = os.dup(0), os.open(os.devnull, os.O_RDWR)
    os.dup2(null, 0)
    threading.Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    answer = os.dup(1)
    os.dup2(2, 1)  # output of a peer goes to standard error
    record = json.dumps(finite(answered(_run, request)), allow_nan=False)
    with os.fdopen(answer, "w", encoding="utf-8") as stream:
        stream.write(record + "\n")


def _end_with_parent(parent: int) -> None:
    """End this process and what a peer has started once its input has ended."""
    while os.read(parent, 1):
        pass
    from gauss2svg.processes import end_tree  # psutil, which would count as a peer's memory

    end_tree(os.getpid())
    os._exit(1)


if __name__ == "__main__":
    main()
