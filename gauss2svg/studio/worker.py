"""Make the fit of a job in a worker process, which writes these files into the folder of the job.

    progress.json, frame.jpg     during the fit
    picture.svg, report.json     when the fit is done
    photo.png, outline.svg, ..   after that, for the page and to be saved

To end the fit with its best picture, the server writes a file named stop.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

from gauss2svg.compare.records import json_safe, record_or_error
from gauss2svg.compare.run import outlines_with_nodes
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.files import as_json, as_png, replace, saved
from gauss2svg.measure.heatmap import error_map
from gauss2svg.photo.pixels import over
from gauss2svg.pipeline.options import Options, Progress
from gauss2svg.pipeline.placeholder import Placeholder
from gauss2svg.pipeline.plan import MINIMAL_UP_TO, USUAL_BYTES, Plan
from gauss2svg.pipeline.progress_display import FrameMaker
from gauss2svg.pipeline.run import memory_limit
from gauss2svg.pipeline.vectorize import Result, vectorize_by
from gauss2svg.svg import EDITABLE, MINIMAL
from gauss2svg.svg.write import write_svg

MASK = "focus.png"  # name of the mask's file in the folder of a job


def load() -> None:
    """Do nothing. The process that is asked to has then loaded this module, and so can fit."""


def fit(request: Mapping[str, Any]) -> dict[str, str]:
    """Fit a photo, and write the files of the job.

    Return {}, or {"error": line} if this fails. The line does not show where the job's folder is.

    request  has the keys name (of the photo), folder (of the job), options, workers and threads
    """
    answer = record_or_error(_fit, request)
    if "error" in answer:
        line = answer["error"].replace(str(request["folder"] / "photo"), request["name"])
        answer["error"] = line.replace(f"{request['folder']}{os.sep}", "")
    return answer


def _fit(request: Mapping[str, Any]) -> dict[str, str]:
    result = _result(request)
    for name, data in _files(result, request):
        _write(request["folder"] / name, data)
    return {}


def _write(path: Path, data: bytes) -> None:
    part = path.with_name("part")
    part.write_bytes(data)
    replace(part, path)


def _result(request: Mapping[str, Any]) -> Result:
    folder: Path = request["folder"]
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
            for name in (
                "round", "iteration", "done", "gaussians", "areas", "psnr", "elapsed_s",
                "remaining_s",
            ):  # fmt: skip
                figures[name] = getattr(now.fit, name)
            if not now.fit.areas:
                figures["bytes_estimate"] = USUAL_BYTES * now.fit.gaussians
        _write(folder / "progress.json", as_json(json_safe({**figures, "frame": frames})))

    share = memory_limit(None) // request["workers"]
    options = Options.from_flat(request["options"])
    return vectorize_by(
        options.changed(max_memory=share, threads=request["threads"]),
        folder / "photo",
        focus=folder / MASK if (folder / MASK).exists() else None,
        progress=progress,
        # A request to stop has to wait for the first frame, because until then the fit has no
        # picture that could be kept.
        stop=lambda: frames > 0 and (folder / "stop").exists(),
    )


def _files(result: Result, request: Mapping[str, Any]) -> Iterator[tuple[str, bytes]]:
    """Yield (name, bytes) of the files of a finished fit.

    As soon as report.json is written, the job counts as done. So the SVG comes before it, and the
    files that users only look at or save come after it.
    """
    svg, report = result.svg, result.report
    yield "picture.svg", svg.encode()
    yield "report.json", as_json(report)
    yield "photo.png", as_png(result.photo)
    errors = error_map(over(result.raster), over(result.photo))
    yield "errors.png", saved(lambda stream: errors.save(stream, "PNG"))
    # For an additive picture, which has no outlines, this raises an error, and no file is written.
    with suppress(Gauss2SvgError):
        yield "outlines.svg", outlines_with_nodes(result)
        yield "outline.svg", result.outline().encode()
    other = MINIMAL if report["markup"] == EDITABLE else EDITABLE
    # The page also offers the SVG in the markup that was not asked for. Some options do not allow
    # that markup. The block then raises an error, and no file is written.
    with suppress(Gauss2SvgError):
        changed = {"precision": result.report["precision"]} if result.scene.areas else {}
        options = Options.from_flat(request["options"])
        form = Plan(options.changed(markup=other, focus_strength=None, **changed)).format
        yield f"picture-{other}.svg", write_svg(result.scene, form, result.document).encode()
    yield "scene.npz", saved(result.scene.save)
    if inks := report["inks"]:
        plates, stream, stem = result.plates(), io.BytesIO(), PurePath(request["name"]).stem
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
            for number, ink in enumerate(inks.split(","), start=1):
                if ink in plates:
                    zipped.writestr(f"{stem}-plate-{number}.svg", plates[ink])
        yield "plates.zip", stream.getvalue()
    if report["markup"] == MINIMAL and report["svg_bytes"] <= MINIMAL_UP_TO:
        size = report["width"], report["height"]
        one = Placeholder.of(svg, result.scene, size, result.photo)
        yield "placeholder.html", f"{one.snippet(quote(request['name']))}\n".encode()
