"""The addresses of the service: the page and its data, jobs, and the files that they have made."""

from __future__ import annotations

import asyncio
import base64
import io
import itertools
import shutil
import zipfile
from collections.abc import AsyncIterator
from mimetypes import guess_type
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Depends, File, Form, Query, Request, UploadFile
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.sse import EventSourceResponse, ServerSentEvent
from pydantic import BaseModel, Field, Json
from starlette.datastructures import State
from starlette.exceptions import HTTPException

from gauss2svg.compare.chart import BESIDE, COSTS, scatter, template_environment
from gauss2svg.errors import refusal
from gauss2svg.files import as_png
from gauss2svg.measure.heatmap import MOST, legend
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.formats import SUFFIXES
from gauss2svg.raster.isolated import draw
from gauss2svg.studio import uploads
from gauss2svg.studio.jobs import LOOK_S, QUEUED, RUNNING, Job, until
from gauss2svg.studio.options import MOST_DRAWN, form, lines_of, options_of
from gauss2svg.svg.file import file_bytes
from gauss2svg.version import __version__

router = APIRouter()
_TEMPLATES = template_environment("gauss2svg.compare.pages", "gauss2svg.studio")
_AXES = {axis.key: axis for axis in SCORES}
_COSTS = {cost.key: cost for cost in COSTS}
_FIGURES = ("gaussians", "psnr_svg", "ssim_svg", "svg_bytes", "total_s", "stop_reason")
_FILES = ("photo.png", "errors.png", "outlines.svg", "report.json", "scene.npz")
Markup = Literal["editable", "minimal"] | None


class JobState(BaseModel):
    """A job; lines are the command and the Python that make the same file."""

    id: str
    state: str  # queued, running, done, stopped, failed or canceled
    place: int = 0
    progress: dict[str, Any] | None
    report: dict[str, Any] | None
    error: str
    name: str
    width: int
    height: int
    options: dict[str, Any]
    lines: dict[str, str]


def _state(request: Request) -> State:
    return request.app.state


Studio = Annotated[State, Depends(_state)]  # what `create_app` keeps: jobs, samples, ...


def _job_named(name: str, studio: Studio) -> Job:
    job = studio.jobs.known.get(name)
    if job is None:
        raise HTTPException(404, f"no job {name[:40]}; it may have been forgotten for newer ones")
    return job


KnownJob = Annotated[Job, Depends(_job_named)]


async def _finished(job: KnownJob) -> Job:
    await until(lambda: job.is_over)
    if job.report is None:
        raise HTTPException(409, job.error or f"the job was {job.state}; it has no SVG")
    return job


FinishedJob = Annotated[Job, Depends(_finished)]


def _sample_named(name: str, studio: Studio) -> uploads.Sample:
    if name not in studio.samples:
        raise HTTPException(404, f"no sample {name[:100]}")
    return studio.samples[name]


@router.get("/", include_in_schema=False)
async def page(studio: Studio) -> HTMLResponse:
    """The studio's page."""
    html = _TEMPLATES.get_template("studio.html.jinja").render(
        version=__version__,
        workers=studio.jobs.workers,
        legend=legend(),
        most_levels=MOST,
        suffixes=(*SUFFIXES, *uploads.REFUSED),
        is_local=studio.is_local,
    )
    return HTMLResponse(html)


@router.get("/api/options")
async def options() -> dict[str, Any]:
    """Options by groups, with domains, defaults and help; scores; the largest PNG."""
    return form()


@router.get("/api/samples", response_model=list[uploads.Sample])
async def samples(studio: Studio) -> list[uploads.Sample]:
    """Pictures that can be picked in place of an upload."""
    return list(studio.samples.values())


@router.get("/api/samples/{name}", response_class=FileResponse)
async def sample(sample: Annotated[uploads.Sample, Depends(_sample_named)]) -> FileResponse:
    """The file of a picture."""
    return FileResponse(sample.path)


class PointAsked(BaseModel):
    """A run: its cost, its score, None where the pictures are equal, its series and tooltip."""

    cost: Annotated[float, Field(ge=1e-9, le=1e15)]
    score: Annotated[float, Field(ge=-1e6, le=1e6)] | None
    series: Annotated[int, Field(ge=0, le=1e6)]
    text: Annotated[str, Field(max_length=1000)]


class ChartAsked(BaseModel):
    """What a chart is drawn of: the names of a report for its two axes, and runs."""

    score: Literal[tuple(_AXES)]  # pyright: ignore[reportInvalidTypeForm]
    cost: Literal[tuple(_COSTS)]  # pyright: ignore[reportInvalidTypeForm]
    points: Annotated[list[PointAsked], Field(min_length=1, max_length=10_000)]


@router.post("/api/chart", response_class=Response)
def draw_chart(asked: ChartAsked) -> Response:
    """A chart of a score over a cost as SVG, its points in their order."""
    points = [one.model_dump() | {"group": one.series} for one in asked.points]
    chart = scatter(points, _COSTS[asked.cost], _AXES[asked.score], BESIDE)
    svg = _TEMPLATES.get_template("chart.svg.jinja").render(chart=chart)
    return Response(svg, media_type="image/svg+xml")


async def _submitted(
    studio: Studio,
    photo: Annotated[UploadFile | None, File(description="the file of a photo")] = None,
    sample: Annotated[str, Form(description="or a name of /api/samples")] = "",
    of: Annotated[str, Form(description="or the id of a job, whose photo is taken again")] = "",
    options: Annotated[Json[dict[str, Any]] | None, Form(description="see /api/options")] = None,
) -> Job:
    """Return the job of a form, queued."""
    studio.jobs.check_room()
    chosen = options_of(options := options or {})
    folder: Path = studio.jobs.new_folder()
    try:
        if photo is not None:
            name, source = uploads.display_name(photo.filename), photo.file
        elif of:
            other = _job_named(of, studio)
            name, source = other.name, (other.folder / "photo").open("rb")
        elif sample:
            picked = _sample_named(sample, studio)
            name, source = picked.name, picked.path.open("rb")
        else:
            needed = "a file as photo, a sample, or the job that it is of"
            raise refusal("the photo", f"given: {needed}", "none")
        with source, (folder / "photo").open("wb") as copy:
            await asyncio.to_thread(shutil.copyfileobj, source, copy)
        size = await asyncio.to_thread(uploads.size_of, folder / "photo", name)
        job = Job(folder, name, options, *size, lines=lines_of(name, chosen))
        studio.jobs.submit(job)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return job


SubmittedJob = Annotated[Job, Depends(_submitted)]


def _told(job: Job, studio: State) -> JobState:
    """Return what is told of a job now."""
    told, line = JobState.model_validate(job, from_attributes=True), studio.jobs.line()
    told.place = line.index(job) + 1 if job in line else 0
    return told


@router.post("/api/jobs", status_code=201)
async def submit(job: SubmittedJob, studio: Studio) -> JobState:
    """Queue a photo; answers with its id and its place in line."""
    return _told(job, studio)


@router.post("/api/vectorize", response_class=Response)
async def vectorize(request: Request, job: SubmittedJob, studio: Studio) -> Response:
    """The SVG of a photo; a client that goes away cancels it."""
    while not job.is_over:
        if await request.is_disconnected():
            studio.jobs.forget(job)
            raise HTTPException(499, "the client has gone")
        await asyncio.sleep(LOOK_S)
    answer, report = await picture(await _finished(job)), job.report or {}
    for name in _FIGURES:
        answer.headers[f"X-Gauss2svg-{name.replace('_', '-')}"] = str(report[name])
    answer.headers["X-Gauss2svg-job"] = job.id
    return answer


@router.get("/api/jobs/{name}")
async def state(job: KnownJob, studio: Studio) -> JobState:
    """State, progress, and the report once it is there."""
    return _told(job, studio)


@router.get("/api/jobs/{name}/events", response_class=EventSourceResponse)
async def events(job: KnownJob, studio: Studio) -> AsyncIterator[ServerSentEvent]:
    """Server-sent events: the state whenever it changes; a slow reader gets the newest."""
    with studio.jobs.reading(job):
        last = None
        while last is None or last.state in (QUEUED, RUNNING):
            if (now := _told(job, studio)) != last:
                yield ServerSentEvent(data=now, event="state")
                last = now
            await asyncio.sleep(LOOK_S)


@router.get("/api/jobs/{name}/frame", response_class=Response)
async def frame(job: KnownJob) -> Response:
    """JPEG of the fit as it is; waits for the first."""
    path = job.folder / "frame.jpg"
    await until(lambda: path.exists() or job.is_over)
    if not path.exists():
        raise HTTPException(404, f"the job was {job.state} before its first frame")
    return Response(path.read_bytes(), media_type="image/jpeg")


@router.post("/api/jobs/{name}/stop")
async def stop(job: KnownJob, studio: Studio) -> JobState:
    """End a fit with the best so far."""
    studio.jobs.stop(job)
    return _told(job, studio)


@router.delete("/api/jobs/{name}", status_code=204, response_class=Response)
async def forget(job: KnownJob, studio: Studio) -> None:
    """Cancel a job and forget it."""
    studio.jobs.forget(job)


@router.get("/api/jobs/{name}/picture.svg", response_class=Response)
async def picture(
    job: FinishedJob, markup: Markup = None, gzip: bool = False, download: bool = False
) -> Response:
    """The SVG: as it was written, or in another markup, or as SVGZ."""
    svg, zipped = await _svg(job, markup), gzip or _is_zipped(job)
    headers = dict[str, str]()
    if download:
        which = f"-{markup}" if markup else ""
        headers = _attachment(job, f"{which}.svgz" if zipped else f"{which}.svg")
    elif zipped:
        headers["Content-Encoding"] = "gzip"
    data = await asyncio.to_thread(file_bytes, svg, zipped)
    return Response(data, media_type="image/svg+xml", headers=headers)


@router.get("/api/jobs/{name}/picture.png", response_class=Response)
async def png(
    job: FinishedJob,
    studio: Studio,
    width: Annotated[int | None, Query(ge=1)] = None,
    download: bool = False,
) -> Response:
    """The SVG rasterised at a width in px; the height follows."""
    svg, report = await _svg(job, None), job.report or {}
    wide = width or report["width"]
    high = max(1, round(wide * report["height"] / report["width"]))
    if wide * high > MOST_DRAWN:
        raise refusal("the PNG", f"at most {MOST_DRAWN} px", f"{wide}x{high} px", "a lower width")
    channels = 4 if report["transparent"] else 3
    async with studio.drawing:
        pixels = await asyncio.to_thread(draw, svg, wide, high, "resvg", 60.0, channels)
        data = await asyncio.to_thread(as_png, pixels)
    headers = _attachment(job, f"-{wide}.png") if download else {}
    return Response(data, media_type="image/png", headers=headers)


@router.get("/api/jobs/{name}/data-uri.txt", response_class=Response)
async def data_uri(job: FinishedJob, markup: Markup = None) -> Response:
    """The SVG as a data URI."""
    svg = await _svg(job, markup)
    text = f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"
    return Response(text, media_type="text/plain")


@router.get("/api/jobs/{name}/{file}", response_class=FileResponse)
async def file(
    job: FinishedJob,
    file: Literal[tuple(_FILES)],  # pyright: ignore[reportInvalidTypeForm]
    download: bool = False,
) -> FileResponse:
    """The photo as it was compared, the error map, the outlines, the report, the scene."""
    path = await _written(job, file)
    headers = _attachment(job, f"-{file}") if download else {}
    kind = guess_type(file)[0] or "application/octet-stream"
    return FileResponse(path, media_type=kind, headers=headers)


@router.get("/api/zip", response_class=Response)
async def archive(ids: str, studio: Studio, markup: Markup = None, gzip: bool = False) -> Response:
    """SVGs of several jobs, ids separated by commas, as one ZIP."""
    stream, taken = io.BytesIO(), set[str]()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name in dict.fromkeys(ids.split(",")):
            job = await _finished(_job_named(name, studio))
            suffix = ".svgz" if gzip or _is_zipped(job) else ".svg"
            data = await asyncio.to_thread(file_bytes, await _svg(job, markup), suffix == ".svgz")
            await asyncio.to_thread(zipped.writestr, _free(job, suffix, taken), data)
    headers = {"Content-Disposition": 'attachment; filename="gauss2svg.zip"'}
    return Response(stream.getvalue(), media_type="application/zip", headers=headers)


async def _written(job: Job, name: str) -> Path:
    """Return the path of a file of a finished job once it is written; raise HTTPException."""
    path = job.folder / name
    await until(lambda: path.is_file() or job.call.done())
    if not path.is_file():
        raise HTTPException(404, f"this job has no {name}" + (job.error and f": {job.error}"))
    return path


async def _svg(job: Job, markup: Markup) -> str:
    is_other = markup not in (None, (job.report or {})["markup"])
    path = await _written(job, f"picture-{markup}.svg" if is_other else "picture.svg")
    return await asyncio.to_thread(path.read_text, "utf-8")


def _is_zipped(job: Job) -> bool:
    """Return whether the command would write the SVG gzipped."""
    return bool(job.report and job.report["gzip"])


def _free(job: Job, suffix: str, taken: set[str]) -> str:
    """Return a name that no other of an archive has, on any system."""
    stem = uploads.stem_of(job.name)
    names = itertools.chain([stem], (f"{stem}-{number}" for number in itertools.count(2)))
    name = next(one for one in names if f"{one}{suffix}".casefold() not in taken)
    taken.add(f"{name}{suffix}".casefold())
    return f"{name}{suffix}"


def _attachment(job: Job, suffix: str) -> dict[str, str]:
    name = quote(f"{uploads.stem_of(job.name)}{suffix}", safe="")
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{name}"}
