"""HTTP routes of the service: the page, its data, uploads, jobs, and the files of jobs."""

from __future__ import annotations

import asyncio
import io
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import AsyncIterator
from mimetypes import guess_type
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, UploadFile
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import BaseModel, Field, FiniteFloat, Json
from starlette.datastructures import State
from starlette.exceptions import HTTPException

from gauss2svg.batch.inputs import is_picture
from gauss2svg.compare.chart import COSTS, NARROW, scatter, template_environment
from gauss2svg.errors import brief, refusal
from gauss2svg.files import as_png, reading
from gauss2svg.measure import SCORES
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.photo import DEFAULT_MAX_PIXELS, SUFFIXES
from gauss2svg.photo.load import opened
from gauss2svg.raster.isolated import draw
from gauss2svg.scene import Scene
from gauss2svg.studio.jobs import MASK, Job, wait_until
from gauss2svg.studio.options import MOST_DRAWN, USES, command_of, form, options_of
from gauss2svg.svg import Document, Markup, Plotter
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

router = APIRouter()
_TEMPLATES = template_environment("gauss2svg.studio")
_AXES = {axis.key: axis for axis in SCORES}
_COSTS = {cost.key: cost for cost in COSTS}
_FILES = (
    MASK, "photo.png", "errors.png", "outlines.svg", "report.json", "scene.npz", "outline.svg",
    "plates.zip", "placeholder.html",
)  # fmt: skip


def _app_state(request: Request) -> State:
    return request.app.state


# The values that `create_app` stores in the application: jobs, samples and others.
Studio = Annotated[State, Depends(_app_state)]


def _job_named(name: str, studio: Studio) -> Job:
    job = studio.jobs.by_id.get(name)
    if job is None:
        raise HTTPException(404, f"no job {name[:40]}; it may have been forgotten for newer ones")
    return job


KnownJob = Annotated[Job, Depends(_job_named)]


async def _finished(job: KnownJob) -> Job:
    await wait_until(lambda: job.is_over)
    if job.report is None:
        raise HTTPException(409, job.error or "the job was canceled; it has no SVG")
    return job


FinishedJob = Annotated[Job, Depends(_finished)]


def _sample_named(name: str, studio: Studio) -> Path:
    if name not in studio.samples:
        raise HTTPException(404, f"no sample {name[:100]}")
    return studio.samples[name]


@router.get("/", include_in_schema=False)
async def page(studio: Studio) -> HTMLResponse:
    """Return the page of the studio."""
    html = _TEMPLATES.get_template("studio.html.jinja").render(
        version=__version__,
        workers=studio.jobs.workers,
        legend=legend(),
        most_levels=MOST,
        suffixes=(*SUFFIXES, ".jxl"),  # the page says why a JPEG XL cannot be read
        is_local=studio.is_local,
        uses=USES,
    )
    return HTMLResponse(html)


router.add_api_route("/api/options", form)


@router.get("/api/samples")
async def samples(studio: Studio) -> list[dict[str, str]]:
    """Return the pictures that can be picked instead of an upload, with addresses of their files.

    The addresses are relative to the page.
    """
    return [{"name": n, "url": f"api/samples/{quote(n, safe='')}"} for n in studio.samples]


@router.get("/api/samples/{name}", response_class=FileResponse)
async def sample(path: Annotated[Path, Depends(_sample_named)]) -> FileResponse:
    """Return the file of a sample picture."""
    return FileResponse(path)


class PointAsked(BaseModel):
    """A point of a chart. `score` is None if the SVG equals the photo. `text` is a tooltip."""

    cost: FiniteFloat
    score: FiniteFloat | None
    series: int
    text: str


class ChartAsked(BaseModel):
    """A chart to draw. Its axes show the values of two keys of a report: `score` and `cost`."""

    score: Literal[tuple(_AXES)]  # pyright: ignore[reportInvalidTypeForm]
    cost: Literal[tuple(_COSTS)]  # pyright: ignore[reportInvalidTypeForm]
    points: Annotated[list[PointAsked], Field(min_length=1)]


@router.post("/api/chart", response_class=Response)
def draw_chart(asked: ChartAsked) -> Response:
    """Return a chart of a score over a cost, as SVG. Its points are in the order of the request."""
    points = [point.model_dump() | {"group": point.series} for point in asked.points]
    chart = scatter(points, _COSTS[asked.cost], _AXES[asked.score], NARROW)
    svg = _TEMPLATES.get_template("chart.svg.jinja").render(chart=chart)
    return Response(svg, media_type="image/svg+xml")


async def _submitted(
    studio: Studio,
    photo: Annotated[UploadFile | None, File(description="File of a photo.")] = None,
    sample: Annotated[
        str, Form(description="Name of a picture of /api/samples, instead of a file.")
    ] = "",
    of: Annotated[
        str, Form(description="Id of a job whose photo is used again, instead of a file.")
    ] = "",
    focus: Annotated[
        UploadFile | None, File(description="Mask of the photo, white where detail matters.")
    ] = None,
    options: Annotated[
        Json[dict[str, Any]] | None, Form(description="Options by name. See /api/options.")
    ] = None,
) -> Job:
    """Queue the job that a form describes, and return the job."""
    chosen = options_of(options := options or {}, focus is not None)
    folder = Path(tempfile.mkdtemp(dir=studio.jobs.folder))
    try:
        if photo is not None:
            name, source = display_name(photo.filename), photo.file
        elif of:
            earlier = _job_named(of, studio)
            name, source = earlier.name, (earlier.folder / "photo").open("rb")
        elif sample:
            name, source = sample, _sample_named(sample, studio).open("rb")
        else:
            needed = "a file as photo, a sample, or the job that it is of"
            raise refusal("the photo", f"given: {needed}", "none")
        for upload, kept in ((source, "photo"), (focus and focus.file, MASK)):
            if upload is not None:
                with upload, (folder / kept).open("wb") as copy:
                    await asyncio.to_thread(shutil.copyfileobj, upload, copy)
        size = await asyncio.to_thread(size_of, folder / "photo", name)
        job = Job(folder, name, options, *size, command=command_of(name, chosen, focus is not None))
        studio.jobs.submit(job)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return job


SubmittedJob = Annotated[Job, Depends(_submitted)]


@router.post("/api/jobs", status_code=201)
async def submit(job: SubmittedJob) -> dict[str, Any]:
    """Queue a photo, and return the state of its job with its id."""
    return job.described()


@router.post("/api/vectorize", response_class=Response)
async def vectorize(request: Request, job: SubmittedJob, studio: Studio) -> Response:
    """Return the SVG of a photo. The job is canceled if the client disconnects."""
    while not job.is_over:
        if await request.is_disconnected():
            studio.jobs.forget(job)
            raise HTTPException(499, "the client has gone")
        await asyncio.sleep(0.05)
    answer, report = await picture(await _finished(job)), job.report or {}
    for name in (
        "area_count", "line_count", "gaussians", "psnr_svg", "ssim_svg", "svg_bytes", "total_s",
        "stop_reason",
    ):  # fmt: skip
        answer.headers[f"X-Gauss2svg-{name.replace('_', '-')}"] = str(report[name])
    answer.headers["X-Gauss2svg-job"] = job.id
    return answer


@router.get("/api/jobs/{name}")
async def state(job: KnownJob) -> dict[str, Any]:
    """Return the state of a job, with its progress, and with its report once there is an SVG."""
    return job.described()


@router.get("/api/jobs/{name}/events", response_class=EventSourceResponse)
async def events(job: KnownJob, studio: Studio) -> AsyncIterator[ServerSentEvent]:
    """Send the state of a job as a server-sent event whenever it changes.

    A slow reader misses states, but gets the newest. If the reader leaves before the job is over,
    the job is canceled and forgotten.
    """
    last = None
    try:
        while last is None or last["state"] in ("queued", "running"):
            if (now := job.described()) != last:
                yield ServerSentEvent(data=now, event="state")
                last = now
            await asyncio.sleep(0.05)
    finally:
        if not job.is_over:
            studio.jobs.forget(job)


@router.get("/api/jobs/{name}/frame", response_class=Response)
async def frame(job: KnownJob) -> Response:
    """Return a JPEG of the fit as it is now. Wait if there is no frame yet."""
    path = await _written(job, "frame.jpg")
    return Response(path.read_bytes(), media_type="image/jpeg")


@router.post("/api/jobs/{name}/stop")
async def stop(job: KnownJob) -> dict[str, Any]:
    """End a fit, and keep the best result so far."""
    (job.folder / "stop").touch()
    return job.described()


@router.delete("/api/jobs/{name}", status_code=204, response_class=Response)
async def forget(name: str, studio: Studio) -> None:
    """Cancel a job and forget it, unless the end of its events has already done so."""
    if job := studio.jobs.by_id.get(name):
        studio.jobs.forget(job)


@router.get("/api/jobs/{name}/picture.svg", response_class=Response)
async def picture(
    job: FinishedJob, markup: Markup | None = None, gzip: bool = False, download: bool = False
) -> Response:
    """Return the SVG of a job.

    It has the markup in which it was written, unless `markup` names another one. With `gzip`, it is
    an SVGZ.
    """
    svg, zipped = await _svg(job, markup), gzip or _is_zipped(job)
    headers = dict[str, str]()
    if download:
        ending = f"-{markup}" if markup else ""
        headers = _attachment(job, f"{ending}.svgz" if zipped else f"{ending}.svg")
    elif zipped:
        headers["Content-Encoding"] = "gzip"
    data = await asyncio.to_thread(file_bytes, svg, zipped)
    return Response(data, media_type="image/svg+xml", headers=headers)


@router.get("/api/jobs/{name}/picture.png", response_class=Response)
async def png(
    job: FinishedJob,
    width: Annotated[int | None, Query(ge=1)] = None,
    download: bool = False,
) -> Response:
    """Return the SVG as a PNG that is `width` px wide, by default as wide as the photo."""
    svg, report = await _svg(job, None), job.report or {}
    wide = width or report["width"]
    high = -(-wide * report["height"] // report["width"])  # resvg rounds the height up too
    if wide * high > MOST_DRAWN:
        raise refusal("the PNG", f"at most {MOST_DRAWN} px", f"{wide}x{high} px", "a lower width")
    channels = 4 if report["transparent"] else 3
    pixels, _ = await asyncio.to_thread(draw, svg, wide, high, "resvg", 60.0, channels)
    data = await asyncio.to_thread(as_png, pixels)
    headers = _attachment(job, f"-{wide}.png") if download else {}
    return Response(data, media_type="image/png", headers=headers)


@router.get("/api/jobs/{name}/plot.svg", response_class=Response)
async def plot(job: FinishedJob) -> Response:
    """Return the strokes of a pen plotter as a file, as the option --plot writes them."""
    path, report = await _written(job, "scene.npz"), job.report or {}

    def drawn() -> str:
        from gauss2svg.pipeline.plot import plot_of  # imported here because few runs need it

        document = Document(title=report["title"], alt=report["alt"])
        return plot_of(Scene.load(path), report, Plotter(), document).svg

    svg = await asyncio.to_thread(drawn)
    return Response(svg, media_type="image/svg+xml", headers=_attachment(job, "-plot.svg"))


@router.get("/api/jobs/{name}/files")
async def files(job: FinishedJob) -> list[str]:
    """Return the names of the files of a job. Wait until its process has written all of them."""
    await wait_until(job.call.done)
    return [name for name in _FILES if (job.folder / name).is_file()]


@router.get("/api/jobs/{name}/{file}", response_class=FileResponse)
async def file(
    job: FinishedJob,
    file: Literal[tuple(_FILES)],  # pyright: ignore[reportInvalidTypeForm]
    download: bool = False,
) -> FileResponse:
    """Return one file of a job.

    `files` names those that the job has. With `download`, the browser saves the file.
    """
    path = await _written(job, file)
    headers = _attachment(job, f"-{file}") if download else {}
    kind = guess_type(file)[0] or "application/octet-stream"
    return FileResponse(path, media_type=kind, headers=headers)


@router.get("/api/zip", response_class=Response)
async def archive(ids: str, studio: Studio) -> Response:
    """Return a ZIP with the SVGs of several jobs. Their ids are separated by commas."""
    stream, taken = io.BytesIO(), set[str]()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
        for number, name in enumerate(dict.fromkeys(ids.split(",")), start=1):
            job = await _finished(_job_named(name, studio))
            is_gzipped, stem = _is_zipped(job), PurePath(job.name).stem
            if stem.casefold() in taken:
                stem += f"-{number}"
            taken.add(stem.casefold())
            data = await asyncio.to_thread(file_bytes, await _svg(job, None), is_gzipped)
            zipped.writestr(f"{stem}.svgz" if is_gzipped else f"{stem}.svg", data)
    headers = {"Content-Disposition": 'attachment; filename="gauss2svg.zip"'}
    return Response(stream.getvalue(), media_type="application/zip", headers=headers)


async def _written(job: Job, name: str) -> Path:
    """Wait until the process of a finished job has written a file, and return the file's path.

    Raise HTTPException if the process ends without writing it.
    """
    path = job.folder / name
    await wait_until(lambda: path.is_file() or job.call.done())
    if not path.is_file():
        raise HTTPException(404, f"this job has no {name}" + (job.error and f": {job.error}"))
    return path


async def _svg(job: Job, markup: Markup | None) -> str:
    is_second = markup not in (None, (job.report or {})["markup"])
    path = await _written(job, f"picture-{markup}.svg" if is_second else "picture.svg")
    return await asyncio.to_thread(path.read_text, "utf-8")


def _is_zipped(job: Job) -> bool:
    """Return whether the options of a job ask for a gzipped SVG."""
    return bool(job.report and job.report["gzip"])


def _attachment(job: Job, suffix: str) -> dict[str, str]:
    name = quote(f"{PurePath(job.name).stem}{suffix}", safe="")
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{name}"}


def display_name(path: str | None) -> str:
    """Return the last part of a path, made safe to show on a page and to name a download."""
    last = re.split(r"[/\\]", path or "")[-1]
    safe = "".join(c for c in last if c.isprintable() and c not in '<>:"|?*').strip(". ")
    return safe[-100:] or "photo"


def size_of(path: Path, name: str) -> tuple[int, int]:
    """Return the width and height (px) of a photo after it is turned upright.

    Only the header of the photo is decoded. Raise InputError, with the name in its message, if the
    file is not a photo or has too many pixels.
    """
    with reading(path, "another photo") as file:
        return opened(file.read(), name, DEFAULT_MAX_PIXELS).upright_size


def samples_in(folder: Path | None) -> dict[str, Path]:
    """Return the photos of a folder by their names, or pictures of scikit-image if it is None.

    Raise InputError if the folder has no photos.
    """
    if folder is None:
        from skimage import data

        names = ("coffee.png", "chelsea.png", "astronaut.png", "rocket.jpg")
        paths = [Path(data.__file__).with_name(name) for name in names]
    else:
        paths = [path for path in sorted(folder.glob("*")) if is_picture(path.name)][:100]
    if not paths:
        advice = "another folder, or none for pictures of scikit-image"
        raise refusal("FOLDER", "a folder with photos", brief(str(folder)), advice)
    # A page must be valid Unicode, so bytes of a name that are not valid are escaped.
    return {os.fsencode(p.name).decode(errors="backslashreplace"): p for p in paths}
