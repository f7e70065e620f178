"""Jobs: the queue of fits for the pool of worker processes, and the files of each fit.

The process of a job writes these files into the job's folder:

    progress.json, frame.jpg     during the fit
    picture.svg, report.json     when the fit is done
    photo.png, outline.svg, ..   after that, for the page and to be saved

The server reads these files, so the two processes do not need to exchange messages. To end the fit
with its best picture, the server writes a file named stop.
"""

from __future__ import annotations

import asyncio
import atexit
import io
import json
import os
import secrets
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from gauss2svg.compare.records import json_safe
from gauss2svg.compare.run import outlines_with_nodes
from gauss2svg.errors import Gauss2SvgError, error_line
from gauss2svg.files import as_json, as_png, replace, saved
from gauss2svg.measure.heatmap import heatmap
from gauss2svg.photo.pixels import over
from gauss2svg.pipeline.options import Options, Progress
from gauss2svg.pipeline.placeholder import Placeholder
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, USUAL_BYTES, Plan
from gauss2svg.pipeline.progress_display import FrameMaker
from gauss2svg.pipeline.run import memory_limit
from gauss2svg.pipeline.vectorize import Result, vectorize_by
from gauss2svg.pool import Pool
from gauss2svg.svg import EDITABLE, MINIMAL
from gauss2svg.svg.write import write_svg

MASK = "focus.png"  # name of the mask's file in the folder of a job
MOST_KEPT = 200  # largest number of finished jobs that are kept. The oldest are removed first


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and its results.

    folder   folder of the photo, and of the files that the job's process writes
    command  command line that makes the same SVG
    call     future of the job, which the pool returns when the job is submitted. Until then, this
             is another future, which stays pending.
    """

    folder: Path
    name: str
    options: dict[str, Any]
    width: int
    height: int
    command: str
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    call: Future[None] = field(default_factory=Future)

    def described(self) -> dict[str, Any]:
        """Return the state of the job, its progress, and its report once there is an SVG."""
        names = ("id", "state", "report", "error", "name", "width", "height", "options", "command")
        progress = {"progress": self._read("progress.json")}  # None if there is none yet
        return progress | {name: getattr(self, name) for name in names}

    @property
    def report(self) -> dict[str, Any] | None:
        """The report on the SVG, or None if there is no SVG yet."""
        return self._read("report.json")

    def _read(self, name: str) -> dict[str, Any] | None:
        with suppress(OSError):  # the process may not have written the file yet
            return json.loads((self.folder / name).read_bytes())
        return None

    @property
    def state(self) -> str:
        """State: queued, running, done or failed. A done job may still write further files."""
        # `has_ended` must be read before the report. If the report were read first, the job could
        # write its report and end between the two. The job would then seem to have ended without a
        # report, and so to have failed.
        has_ended = self.call.done()
        if self.report is not None:
            return "done"
        if has_ended:
            return "failed"
        return "running" if self.call.running() else "queued"

    @property
    def is_over(self) -> bool:
        """Whether the job is neither queued nor running."""
        return self.state in ("done", "failed")

    @property
    def error(self) -> str:
        """The reason why the job failed or why some of its files are missing, or "".

        It is one line, which does not show where the job's folder is.
        """
        if self.call.cancelled() or not self.call.done():
            return ""
        if not isinstance(error := self.call.exception(), Exception):
            return ""
        line = error_line(error, "smaller photos or fewer Gaussians")
        line = line.replace(str(self.folder / "photo"), self.name)
        return line.replace(f"{self.folder}{os.sep}", "")


async def wait_until(condition: Callable[[], object]) -> None:
    """Wait until `condition` returns a true value. It is called 20 times a second."""
    while not condition():
        await asyncio.sleep(0.05)


class Jobs:
    """All jobs of a server, and the pool that runs them.

    workers  number of fits that run at the same time
    threads  number of CPU threads of each fit
    """

    def __init__(self, workers: int, threads: int) -> None:
        self.workers, self.threads = workers, threads
        self.by_id: dict[str, Job] = {}
        self.folder = Path(tempfile.mkdtemp(prefix="gauss2svg-studio-"))  # private to this user
        atexit.register(shutil.rmtree, self.folder, ignore_errors=True)

    @cached_property
    def _pool(self) -> Pool:
        pool = Pool(self.workers).__enter__()
        # A studio that is mounted in another application is not told when the server ends. But when
        # the event loop ends, it cancels its tasks. So this task does nothing but wait, and when it
        # is canceled, the pool is ended.
        self._task = asyncio.get_running_loop().create_task(asyncio.Event().wait())
        self._task.add_done_callback(pool.__exit__)
        return pool

    def submit(self, job: Job) -> None:
        """Queue a job, whose photo must already be in its folder. Forget the oldest results."""
        finished = [old for old in self.by_id.values() if old.call.done()]
        for old in finished[:-MOST_KEPT]:
            self.forget(old)
        self.by_id[job.id] = job
        own = job.folder, job.name, job.options
        job.call = self._pool.submit(fit, *own, self.workers, self.threads)

    def forget(self, job: Job) -> None:
        """End a job, and remove its files as soon as no worker writes them any more.

        If its fit runs, its process is killed, so that its cores become free at once.
        """
        self.by_id.pop(job.id, None)
        job.call.cancel()
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))


def fit(folder: Path, name: str, given: dict[str, Any], workers: int, threads: int) -> None:
    """Fit a photo, and write the files of the job.

    name     file name of the photo, as the user knows it
    given    options by name
    workers  number of fits that share the memory
    """
    options = Options.from_flat(given)
    share = memory_limit(None) // workers
    result = _result(folder, options.changed(max_memory=share, threads=threads))
    for file, data in _files(result, name, options):
        _write(folder / file, data)


def _write(path: Path, data: bytes) -> None:
    part = path.with_name("part")
    part.write_bytes(data)
    replace(part, path)


def _result(folder: Path, options: Options) -> Result:
    maker, frames = FrameMaker(), 0

    def progress(now: Progress) -> None:
        nonlocal frames
        figures: dict[str, Any] = {"phase": now.phase}
        if now.fit is not None:
            frame = maker.frame(now.fit.scene)
            # During a fit, progress is written only together with a new frame. After most steps,
            # no new frame is due yet.
            if not frame:
                return
            frames += 1
            _write(folder / "frame.jpg", frame)
            figures |= {name: v for name, v in vars(now.fit).items() if name != "scene"}
            if not now.fit.areas:
                figures["bytes_estimate"] = USUAL_BYTES * now.fit.gaussians
        _write(folder / "progress.json", as_json(json_safe({**figures, "frame": frames})))

    return vectorize_by(
        options,
        folder / "photo",
        focus=folder / MASK if (folder / MASK).exists() else None,
        progress=progress,
        # A request to stop has to wait for the first frame, because until then the fit has no
        # picture that could be kept.
        stop=lambda: frames > 0 and (folder / "stop").exists(),
    )


def _files(result: Result, name: str, options: Options) -> Iterator[tuple[str, bytes]]:
    """Yield (name, bytes) of the files of a finished fit of the photo `name`.

    As soon as report.json is written, the job counts as done. So the SVG comes before it, and the
    files that users only look at or save come after it.
    """
    svg, report = result.svg, result.report
    yield "picture.svg", svg.encode()
    yield "report.json", as_json(report)
    yield "photo.png", as_png(result.photo)
    yield "errors.png", heatmap(over(result.raster), over(result.photo))
    # For an additive picture, which has no outlines, this raises an error, and no file is written.
    with suppress(Gauss2SvgError):
        yield "outlines.svg", outlines_with_nodes(result)
        yield "outline.svg", result.outline().encode()
    # The page also offers the SVG in the markup that was not asked for. Some options do not allow
    # that markup. The block then raises an error, and no file is written.
    with suppress(Gauss2SvgError):
        other = MINIMAL if report["markup"] == EDITABLE else EDITABLE
        changed = {"precision": report["precision"]} if result.scene.areas else {}
        form = Plan(options.changed(markup=other, focus_strength=None, **changed)).format
        yield f"picture-{other}.svg", write_svg(result.scene, form, result.document).encode()
    yield "scene.npz", saved(result.scene.save)
    if inks := report["inks"]:
        plates, stream, stem = result.plates(), io.BytesIO(), PurePath(name).stem
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
            for number, ink in enumerate(inks.split(","), start=1):
                if ink in plates:
                    zipped.writestr(f"{stem}-plate-{number}.svg", plates[ink])
        yield "plates.zip", stream.getvalue()
    if report["markup"] == MINIMAL and report["svg_bytes"] <= MINIMAL_UP_TO:
        size = report["width"], report["height"]
        one = Placeholder.of(svg, result.scene, size, result.photo)
        yield "placeholder.html", f"{one.snippet(quote(name))}\n".encode()
