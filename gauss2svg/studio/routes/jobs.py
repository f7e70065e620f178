"""Routes that make jobs and follow them."""

from __future__ import annotations

import asyncio
import errno
import json
import shutil
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Depends, Request
from fastapi.responses import Response, StreamingResponse
from starlette.datastructures import FormData
from starlette.exceptions import HTTPException

from gauss2svg.errors import InputError
from gauss2svg.studio import uploads
from gauss2svg.studio.jobs import CANCELED, FAILED, Job, Jobs
from gauss2svg.studio.options import lines_of, options_of
from gauss2svg.studio.routes import (
    AllJobs,
    JobState,
    KnownJob,
    PhotoForm,
    Samples,
    job_named,
    parsed,
    sample_named,
    validated,
)
from gauss2svg.studio.routes.results import picture
from gauss2svg.studio.uploads import Sample

_MOST_OPTIONS = 64_000  # characters of their JSON
_ALIVE_S = 15.0  # between two lines of an event stream that has nothing to tell
_FIXED = {"name", "width", "height", "options", "lines"}  # told once of a job
_FIGURES = ("gaussians", "psnr_svg", "ssim_svg", "svg_bytes", "total_s", "stop_reason")
_FORM = {
    "requestBody": {
        "required": True,
        "content": {"multipart/form-data": {"schema": PhotoForm.model_json_schema()}},
    }
}

router = APIRouter(prefix="/api")


async def _submitted(request: Request, jobs: AllJobs, samples: Samples) -> Job:
    """The job of a form, queued.

    FastAPI reads a form before it resolves any dependency: here a full queue refuses the upload
    unread, and a full disk has its own status.
    """
    jobs.check_room()
    with _disk_errors():
        async with request.form(max_files=1, max_fields=len(PhotoForm.model_fields)) as given:
            return await _queued(_checked(given), jobs, samples)


def _checked(given: FormData) -> PhotoForm:
    """The fields of a form; one that is left empty is none, and so is a photo that is text."""
    fields = {name: value for name, value in given.items() if value}
    if isinstance(fields.get("photo"), str):
        del fields["photo"]
    return validated(PhotoForm, fields)


async def _queued(form: PhotoForm, jobs: Jobs, samples: dict[str, Sample]) -> Job:
    given = parsed("options", form.options, _MOST_OPTIONS)
    options = options_of(given)
    folder = jobs.new_folder()
    path = folder / "photo"
    try:
        name = await _keep_photo(form, path, jobs, samples)
        size = await asyncio.to_thread(uploads.size_of, path, name)
        lines = lines_of(name, options)
        job = Job(folder, name, given, *size, keep=form.keep, lines=lines)
        jobs.submit(job)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return job


async def _keep_photo(form: PhotoForm, path: Path, jobs: Jobs, samples: dict[str, Sample]) -> str:
    """Write the photo to a path, and return its name."""
    if form.photo is not None:
        await uploads.save(form.photo, path)
        return uploads.display_name(form.photo.filename)
    if form.of:
        other = await job_named(form.of, jobs)
        await asyncio.to_thread(uploads.link, other.photo, path)
        return other.name
    if form.sample:
        sample = await sample_named(form.sample, samples)
        await asyncio.to_thread(uploads.link, sample.path, path)
        return sample.name
    raise InputError(
        "the photo must be given: a file as photo, a sample, or the job that it is of; got none"
    )


@contextmanager
def _disk_errors() -> Iterator[None]:
    """Errors of the disk as answers, without a path, which is private."""
    try:
        yield
    except OSError as error:
        status = 507 if error.errno in (errno.ENOSPC, errno.EDQUOT) else 500
        line = f"the photo cannot be kept: {error.strerror or 'an error of the disk'}"
        raise HTTPException(status, line) from error


SubmittedJob = Annotated[Job, Depends(_submitted)]


@router.post("/jobs", status_code=201, response_model=JobState, openapi_extra=_FORM)
async def submit(job: SubmittedJob) -> Job:
    """Queue a photo; answers with its id and its place in line."""
    return job


@router.post("/vectorize", openapi_extra=_FORM, response_class=Response)
async def vectorize(request: Request, job: SubmittedJob, jobs: AllJobs) -> Response:
    """The SVG of a photo; a client that goes away cancels it."""
    over = asyncio.ensure_future(job.when())
    gone = asyncio.ensure_future(_disconnection(request))
    await asyncio.wait({over, gone}, return_when=asyncio.FIRST_COMPLETED)
    gone.cancel()
    over.cancel()
    if not job.is_over:
        jobs.forget(job)
        raise HTTPException(499, "the client has gone")
    if job.report is None:
        status = {CANCELED: 409, FAILED: 422}.get(job.state, 500)
        raise HTTPException(status, job.error or f"the job was {job.state}")
    headers = {f"X-Gauss2svg-{name.replace('_', '-')}": str(job.report[name]) for name in _FIGURES}
    answer = await picture(job)
    answer.headers.update({**headers, "X-Gauss2svg-job": job.id})
    return answer


async def _disconnection(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


@router.get("/jobs/{name}", response_model=JobState)
async def state(job: KnownJob) -> Job:
    """State, progress, and the report once it is there."""
    return job


@router.get("/jobs/{name}/events", response_class=StreamingResponse)
async def events(job: KnownJob, jobs: AllJobs) -> StreamingResponse:
    """Server-sent events: the state, then what of it changes; a slow reader gets the newest."""
    return StreamingResponse(
        _stream(job, jobs), media_type="text/event-stream", headers={"X-Accel-Buffering": "no"}
    )


async def _stream(job: Job, jobs: Jobs) -> AsyncIterator[str]:
    with jobs.reading(job):
        told = set[str]()
        while True:
            # Of the moment that is told: it may be over before a slow reader has read this.
            seen, is_last = job.version, job.is_over
            state = JobState.model_validate(job).model_dump(exclude=told)
            yield f"event: state\ndata: {json.dumps(state)}\n\n"
            if is_last:
                return
            told = _FIXED
            while job.version == seen:
                try:
                    await asyncio.wait_for(job.news(seen), _ALIVE_S)
                except TimeoutError:
                    yield ": alive\n\n"


@router.get("/jobs/{name}/frame", response_class=Response)
async def frame(job: KnownJob) -> Response:
    """JPEG of the fit as it is; waits for the first."""
    await job.when(framed=True)
    if not job.frame:
        raise HTTPException(404, f"the job was {job.state} before its first frame")
    headers = {"X-Gauss2svg-frame": str(job.frames)}
    return Response(job.frame, media_type="image/jpeg", headers=headers)


@router.post("/jobs/{name}/stop", response_model=JobState)
async def stop(job: KnownJob, jobs: AllJobs) -> Job:
    """End a fit with the best so far."""
    jobs.stop(job)
    return job


@router.delete("/jobs/{name}", status_code=204, response_class=Response)
async def forget(job: KnownJob, jobs: AllJobs) -> None:
    """Cancel a job and forget it."""
    jobs.forget(job)
