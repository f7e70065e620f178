"""Routes that make jobs and follow them."""

from __future__ import annotations

import asyncio
import errno
import json
import shutil
from collections.abc import AsyncIterator, Mapping
from typing import Any

from fastapi import FastAPI, Request
from fastapi.responses import Response, StreamingResponse
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException

from gauss2svg.errors import InputError, brief
from gauss2svg.studio import photos
from gauss2svg.studio.answers import Estimate, State
from gauss2svg.studio.estimate import Estimator
from gauss2svg.studio.form import options_of
from gauss2svg.studio.guard import PICTURE_POLICY
from gauss2svg.studio.jobs import CANCELED, FAILED, Job, Jobs, QueueFullError
from gauss2svg.studio.lines import lines_of
from gauss2svg.svg.file import file_bytes

_MOST_JSON = 64_000  # characters of what is given as JSON
_ALIVE_S = 15.0  # between two lines of an event stream that has nothing to tell
_FIXED = ("name", "width", "height", "options", "lines")  # told once of a job
_ENDS = ("true", "1", "yes", "on")
_TEXT = {"type": "string"}
_FIELDS = {
    "photo": {"type": "string", "format": "binary", "description": "the file of a photo"},
    "sample": {**_TEXT, "description": "or a name of /api/samples"},
    "of": {**_TEXT, "description": "or the id of a job, whose photo is taken again"},
    "options": {**_TEXT, "default": "{}", "description": "JSON of options of /api/options"},
    "keep": {"type": "boolean", "description": "run on when nobody reads its events any more"},
}
_FORM = {
    "requestBody": {
        "required": True,
        "content": {"multipart/form-data": {"schema": {"type": "object", "properties": _FIELDS}}},
    }
}


def state_of(job: Job) -> State:
    """What is reported of a job; the report once it is over."""
    return {
        "id": job.id,
        "state": job.state,
        "place": job.place,
        "progress": job.progress,
        "report": job.report,
        "error": job.error,
        "name": job.name,
        "width": job.width,
        "height": job.height,
        "options": job.options,
        "lines": job.lines,
    }


def is_zipped(job: Job) -> bool:
    """Whether the command would write its SVG gzipped."""
    return bool(job.report and job.report["gzip"])


def _news_of(job: Job) -> dict[str, Any]:
    return {name: value for name, value in state_of(job).items() if name not in _FIXED}


def job_named(queue: Jobs, name: str) -> Job:
    """The job of that id; HTTPException where there is none."""
    job = queue.known.get(name)
    if job is None:
        raise HTTPException(404, f"no job {name[:40]}; it may have been forgotten for newer ones")
    return job


def add_fits(app: FastAPI, queue: Jobs, samples: Mapping[str, photos.Sample]) -> None:
    """Add the routes."""
    estimator = Estimator(queue)

    @app.post("/api/jobs", status_code=201, openapi_extra=_FORM)
    async def _submit(request: Request) -> State:
        """Queue a photo; answers with its id and its place in line."""
        return state_of(await _submitted(request))

    @app.post("/api/vectorize", openapi_extra=_FORM, response_class=Response)
    async def _vectorize(request: Request) -> Response:
        """The SVG of a photo; a client that goes away cancels it."""
        job = await _submitted(request)
        over = asyncio.ensure_future(job.when())
        gone = asyncio.ensure_future(_disconnection(request))
        await asyncio.wait({over, gone}, return_when=asyncio.FIRST_COMPLETED)
        gone.cancel()
        over.cancel()
        if not job.is_over:
            queue.forget(job)
            raise HTTPException(499, "the client has gone")
        if job.report is None:
            status = {CANCELED: 409, FAILED: 422}.get(job.state, 500)
            raise HTTPException(status, job.error or f"the job was {job.state}")
        figures = ("gaussians", "psnr_svg", "ssim_svg", "svg_bytes", "total_s", "stop_reason")
        headers = {
            f"X-Gauss2svg-{name.replace('_', '-')}": str(job.report[name]) for name in figures
        }
        headers |= {"X-Gauss2svg-job": job.id, "Content-Security-Policy": PICTURE_POLICY}
        svg = await asyncio.to_thread((job.folder / "picture.svg").read_text, "utf-8")
        data = await asyncio.to_thread(file_bytes, svg, is_zipped(job))
        if is_zipped(job):
            headers["Content-Encoding"] = "gzip"
        return Response(data, media_type="image/svg+xml", headers=headers)

    async def _submitted(request: Request) -> Job:
        try:
            queue.check_room()  # before an upload is read in vain
            async with request.form(max_files=1, max_fields=len(_FIELDS)) as given:
                job = await _new_job(given)
            try:
                queue.submit(job)
            except QueueFullError:
                shutil.rmtree(job.folder, ignore_errors=True)
                raise
        except QueueFullError as error:
            raise HTTPException(429, str(error), {"Retry-After": str(queue.wait_s)}) from error
        except InputError:
            raise
        except OSError as error:  # without its path, which is private
            status = 507 if error.errno in (errno.ENOSPC, errno.EDQUOT) else 500
            line = f"the photo cannot be kept: {error.strerror or 'an error of the disk'}"
            raise HTTPException(status, line) from error
        return job

    async def _new_job(given: Mapping[str, Any]) -> Job:
        options = _parsed("options", given.get("options") or "{}")
        checked = options_of(options)
        upload = given.get("photo")
        folder = queue.new_folder()
        path = folder / "photo"
        try:
            if isinstance(upload, UploadFile):
                name = photos.display_name(upload.filename)
                digest = await photos.save(upload, path)
            elif given.get("of"):
                other = job_named(queue, str(given["of"]))
                name, digest = other.name, other.digest
                await asyncio.to_thread(photos.link, other.photo, path)
            elif given.get("sample"):
                sample = samples.get(str(given["sample"]))
                if sample is None:
                    raise HTTPException(404, f"no sample {str(given['sample'])[:100]}")
                name, digest = sample.name, await asyncio.to_thread(photos.digest_of, sample.path)
                await asyncio.to_thread(photos.link, sample.path, path)
            else:
                raise InputError(
                    "the photo must be given: a file as photo, a sample, or the job that it is "
                    "of; got none"
                )
            width, height = await asyncio.to_thread(photos.size_of, path, name)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        keep = str(given.get("keep", "")).lower() in _ENDS
        lines = lines_of(name, checked)
        return Job(folder, name, options, width, height, keep=keep, digest=digest, lines=lines)

    @app.post("/api/estimate")
    async def _estimate(request: Request) -> Estimate:
        """What a run will give: JSON {width, height, options, of?} in, figures out."""
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > _MOST_JSON:
                break
        given = _parsed("the body", body.decode(errors="replace"))
        if not isinstance(given, dict):
            raise InputError(f"the body must be an object; got {type(given).__name__}")
        of = queue.known.get(str(given.get("of")))
        sides = given.get("width"), given.get("height")
        if of is not None and of.width and of.height:
            sides = of.width, of.height
        return estimator.estimate(*sides, options_of(given.get("options", {})), of)

    @app.get("/api/jobs/{name}")
    async def _state(name: str) -> State:
        """State, progress, and the report once it is there."""
        return state_of(job_named(queue, name))

    @app.get("/api/jobs/{name}/events", response_class=StreamingResponse)
    async def _events(name: str) -> Response:
        """Server-sent events: the state, then what of it changes; a slow reader gets the newest."""
        job = job_named(queue, name)
        return StreamingResponse(
            _stream(queue, job), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"}
        )

    @app.get("/api/jobs/{name}/frame", response_class=Response)
    async def _frame(name: str) -> Response:
        """JPEG of the fit as it is; waits for the first."""
        job = job_named(queue, name)
        await job.when(framed=True)
        if not job.frame:
            raise HTTPException(404, f"the job was {job.state} before its first frame")
        headers = {"X-Gauss2svg-frame": str(job.frames)}
        return Response(job.frame, media_type="image/jpeg", headers=headers)

    @app.post("/api/jobs/{name}/stop")
    async def _stop(name: str) -> State:
        """End a fit with the best so far."""
        job = job_named(queue, name)
        queue.stop(job)
        return state_of(job)

    @app.delete("/api/jobs/{name}", status_code=204, response_class=Response)
    async def _forget(name: str) -> None:
        """Cancel a job and forget it."""
        queue.forget(job_named(queue, name))


async def _stream(queue: Jobs, job: Job) -> AsyncIterator[str]:
    with queue.reading(job):
        told = state_of(job)
        while True:
            seen = job.version
            yield f"event: state\ndata: {json.dumps(told)}\n\n"
            if job.is_over:
                return
            while job.version == seen:
                try:
                    await asyncio.wait_for(job.news(seen), _ALIVE_S)
                except TimeoutError:
                    yield ": alive\n\n"
            told = _news_of(job)


async def _disconnection(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _parsed(what: str, text: Any) -> Any:
    if not isinstance(text, str):
        raise InputError(f"{what} must be JSON; got a file")
    if len(text) > _MOST_JSON:
        raise InputError(f"{what} must be at most {_MOST_JSON} characters; got more")
    try:
        return json.loads(text)
    except ValueError as error:
        raise InputError(f"{what} must be JSON; got {brief(error)}") from error
    except RecursionError as error:
        raise InputError(f"{what} must be JSON; got one too deep") from error
