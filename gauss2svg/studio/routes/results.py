"""Routes that give what a job has made."""

from __future__ import annotations

import asyncio
import base64
import io
import zipfile
from typing import Annotated, Any, Literal
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from fastapi.responses import FileResponse, Response
from starlette.exceptions import HTTPException

from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.measure.isolated import draw
from gauss2svg.studio import uploads
from gauss2svg.studio.jobs import Job
from gauss2svg.studio.options import MOST_DRAWN
from gauss2svg.studio.routes import AllJobs, FinishedJob, finished, job_named
from gauss2svg.svg.file import file_bytes

Markup = Literal["editable", "minimal"] | None
_FILES = {
    "photo.png": "image/png",
    "errors.png": "image/png",
    "outlines.svg": "image/svg+xml",
    "report.json": "application/json",
    "scene.npz": "application/octet-stream",
}

router = APIRouter(prefix="/api")


@router.get("/jobs/{name}/picture.svg", response_class=Response)
async def picture(
    job: FinishedJob, markup: Markup = None, gzip: bool = False, download: bool = False
) -> Response:
    """The SVG: as it was written, or in another markup, or as SVGZ."""
    svg = await _svg(job, markup)
    zipped = gzip or job.is_zipped
    headers = dict[str, str]()
    if download:
        which = f"-{markup}" if markup else ""
        headers = _attachment(job, f"{which}.svgz" if zipped else f"{which}.svg")
    elif zipped:
        headers["Content-Encoding"] = "gzip"
    data = await asyncio.to_thread(file_bytes, svg, zipped)
    return Response(data, media_type="image/svg+xml", headers=headers)


@router.get("/jobs/{name}/picture.png", response_class=Response)
async def png(
    request: Request,
    job: FinishedJob,
    width: Annotated[int | None, Query(ge=1)] = None,
    download: bool = False,
) -> Response:
    """The SVG rasterised at a width in px; the height follows."""
    svg, report = await _svg(job, None), job.report or {}
    wide = width or report["width"]
    high = max(1, round(wide * report["height"] / report["width"]))
    if wide * high > MOST_DRAWN:
        raise InputError(
            f"the PNG must be at most {MOST_DRAWN} px; got {wide}x{high} px. Try a lower width"
        )
    channels = 4 if report["transparent"] else 3
    async with request.app.state.drawing:
        pixels = await asyncio.to_thread(draw, svg, wide, high, "resvg", 60.0, channels)
        data = await asyncio.to_thread(as_png, pixels)
    headers = _attachment(job, f"-{wide}.png") if download else {}
    return Response(data, media_type="image/png", headers=headers)


@router.get("/jobs/{name}/data-uri.txt", response_class=Response)
async def data_uri(job: FinishedJob, markup: Markup = None) -> Response:
    """The SVG as a data URI."""
    svg = await _svg(job, markup)
    text = f"data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"
    return Response(text, media_type="text/plain")


@router.get("/jobs/{name}/{file}", response_class=FileResponse)
async def file(
    job: FinishedJob,
    file: Literal[tuple(_FILES)],  # pyright: ignore[reportInvalidTypeForm]
    download: bool = False,
) -> FileResponse:
    """The photo as it was compared, the error map, the outlines, the report, the scene."""
    if file != "report.json":
        await job.when(ready=True)
    path = job.folder / file
    if not path.is_file():
        raise HTTPException(404, f"this job has no {file}" + (job.flaw and f": {job.flaw}"))
    headers = _attachment(job, f"-{file}") if download else {}
    return FileResponse(path, media_type=_FILES[file], headers=headers)


@router.get("/zip", name="zip", response_class=Response)
async def archive(ids: str, jobs: AllJobs, markup: Markup = None, gzip: bool = False) -> Response:
    """SVGs of several jobs, ids separated by commas, as one ZIP; it says which are missing."""
    stream, taken, missing = io.BytesIO(), set[str](), list[HTTPException]()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as zipped:
        for name in dict.fromkeys(filter(None, ids.split(","))):
            try:
                job = await finished(await job_named(name, jobs))
                svg = await _svg(job, markup)
            except HTTPException as error:
                missing.append(error)
                continue
            suffix = ".svgz" if gzip or job.is_zipped else ".svg"
            data = await asyncio.to_thread(file_bytes, svg, suffix == ".svgz")
            await asyncio.to_thread(zipped.writestr, _free(job, suffix, taken), data)
        if not taken:
            none = HTTPException(422, "ids must name jobs; got none. Try A,B")
            raise missing[0] if missing else none
        if missing:
            zipped.writestr("missing.txt", "".join(f"{one.detail}\n" for one in missing))
    headers = {"Content-Disposition": 'attachment; filename="gauss2svg.zip"'}
    return Response(stream.getvalue(), media_type="application/zip", headers=headers)


async def _svg(job: Job, markup: str | None) -> str:
    report: dict[str, Any] = job.report or {}
    name = "picture.svg"
    if markup not in (None, report["markup"]):
        await job.when(ready=True)
        name = f"picture-{markup}.svg"
    path = job.folder / name
    if not path.is_file() and (job.flaw or name == "picture.svg"):
        raise HTTPException(404, f"this job has no {name}: {job.flaw or 'it was lost'}")
    if not path.is_file():
        raise HTTPException(422, f"these options cannot be written with {markup} markup")
    return await asyncio.to_thread(path.read_text, "utf-8")


def _free(job: Job, suffix: str, taken: set[str]) -> str:
    """A name that no other of an archive has, on any system."""
    stem = name = uploads.stem_of(job.name)
    number = 1
    while f"{name}{suffix}".casefold() in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(f"{name}{suffix}".casefold())
    return f"{name}{suffix}"


def _attachment(job: Job, suffix: str) -> dict[str, str]:
    name = quote(f"{uploads.stem_of(job.name)}{suffix}", safe="")
    return {"Content-Disposition": f"attachment; filename*=UTF-8''{name}"}
