"""The process in which fits run, one at a time: `python -m gauss2svg.studio.worker_process FOLDER`.

Reads lines of JSON from standard input:

    {"job": id, "photo": path, "name": .., "options": {..}, "folder": path}    a fit
    {"job": id, "stop": true}     keep the best so far
    {"job": id, "cancel": true}   drop it at the next step

and answers on standard output, in messages of one line of JSON with so many "bytes" after it:
"ready" once; for each fit "progress", then "done" or "failed" with a line, after "done" perhaps
"incomplete" with a line on files that could not be made, and "ended", after which the next may
come. When its input ends its server is gone: it removes FOLDER, the server's private one, and ends,
in the midst of a fit as well.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from gauss2svg.errors import Gauss2SvgError, on_one_line
from gauss2svg.files import as_json, as_png, saved, write_whole
from gauss2svg.measure.heatmap import error_map
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline import presets
from gauss2svg.pipeline.memory_budget import allowed
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Progress
from gauss2svg.pipeline.vectorize import Result, vectorize_by, warm_up
from gauss2svg.render.frame import FrameMaker, as_jpeg
from gauss2svg.svg.document import EDITABLE, MINIMAL
from gauss2svg.svg.write import write_svg

_LEAST_BETWEEN_S = 0.05  # progress messages without a frame


class _CanceledError(Exception):
    """The fit is not wanted any more."""


class _Worker:
    def __init__(self) -> None:
        self._answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
        # What libraries print goes where errors go.
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        self._requests: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self._stopped = self._canceled = ""  # jobs

    def run(self, folder: str) -> None:
        threading.Thread(target=self._listen, args=(folder,), daemon=True).start()
        as_jpeg(warm_up({"quality": "draft"}).scene)
        self._send("", "ready")
        while True:
            request = self._requests.get()
            self._answer(request)
            self._send(request["job"], "ended")

    def _listen(self, folder: str) -> None:
        for line in sys.stdin.buffer:
            message = json.loads(line)
            if "stop" in message:
                self._stopped = message["job"]
            elif "cancel" in message:
                self._canceled = message["job"]
            else:
                self._requests.put(message)
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)

    def _send(self, job: str, kind: str, data: bytes = b"", **more: Any) -> None:
        head = {"job": job, "kind": kind, "bytes": len(data), **more}
        with contextlib.suppress(BrokenPipeError):  # _listen ends the process
            self._answers.write(json.dumps(head).encode() + b"\n" + data)
            self._answers.flush()

    def _answer(self, request: dict[str, Any]) -> None:
        job, name = request["job"], request["name"]
        try:
            options = Options.from_flat(request["options"])
            result = self._fit(request, options)
            folder = Path(request["folder"])
            # The SVG first, which is waited for; then what is looked at afterwards.
            (folder / "picture.svg").write_bytes(result.svg.encode())
            (folder / "report.json").write_bytes(as_json(result.report))
            self._send(job, "done")
            self._write_rest(request, result, options)
        except _CanceledError:
            pass
        except Gauss2SvgError as error:
            self._fail(job, str(error).replace(request["photo"], name))
        except MemoryError as error:
            self._fail(job, f"out of memory ({error}). Try a smaller photo, or fewer Gaussians")
        except Exception as error:  # a bug of ours: the page shows it with its type
            self._fail(job, f"{type(error).__name__}: {error}")

    def _write_rest(self, request: dict[str, Any], result: Result, options: Options) -> None:
        """The other files, each whole or not at all; what fails here costs no finished fit."""
        job, folder = request["job"], Path(request["folder"])
        try:
            for name, data in _rest(result, options):
                if self._canceled == job:
                    return
                write_whole(folder / name, data, folder / "part")
        except Exception as error:
            line = on_one_line(f"{type(error).__name__}: {error}")
            self._send(job, "incomplete", error=line.replace(f"{folder}{os.sep}", ""))

    def _fail(self, job: str, line: str) -> None:
        self._send(job, "failed", error=on_one_line(line))

    def _fit(self, request: dict[str, Any], options: Options) -> Result:
        job, frames, began, last = request["job"], FrameMaker(), False, 0.0

        def progress(now: Progress) -> None:
            nonlocal began, last
            if self._canceled == job:
                raise _CanceledError
            fit = now.fit
            if fit is None:
                self._send(job, "progress", progress={"phase": now.phase})
                return
            began = True
            frame = frames.frame(fit.scene)
            if not frame and time.perf_counter() - last < _LEAST_BETWEEN_S:
                return
            last = time.perf_counter()
            figures = {
                "phase": now.phase,
                "round": fit.round,
                "iteration": fit.iteration,
                "done": fit.done,
                "gaussians": fit.gaussians,
                "psnr": fit.psnr if np.isfinite(fit.psnr) else None,
                "elapsed_s": fit.elapsed_s,
                "remaining_s": fit.remaining_s,
                "bytes_estimate": presets.USUAL_BYTES * fit.gaussians,
            }
            self._send(job, "progress", frame, progress=figures)

        share = allowed(None) // request["workers"]
        return vectorize_by(
            options.changed(max_memory=share, threads=request["threads"]),
            request["photo"],
            progress=progress,
            # Before its first step a fit has nothing to keep.
            stop=lambda: began and self._stopped == job,
        )


def _rest(result: Result, options: Options) -> Iterator[tuple[str, bytes]]:
    """Names and bytes of what is looked at afterwards."""
    yield "photo.png", as_png(result.photo)
    errors = error_map(over(result.raster), over(result.photo))
    yield "errors.png", saved(lambda stream: errors.save(stream, "PNG"))
    with contextlib.suppress(Gauss2SvgError):  # an additive picture has none
        yield "outlines.svg", result.outline().encode()
    other = MINIMAL if result.report["markup"] == EDITABLE else EDITABLE
    with contextlib.suppress(Gauss2SvgError):  # options that only one of them has
        form = Plan(options.changed(markup=other)).svg_format
        yield f"picture-{other}.svg", write_svg(result.scene, form, result.document).encode()
    yield "scene.npz", saved(result.scene.save)


if __name__ == "__main__":
    _Worker().run(sys.argv[1])
