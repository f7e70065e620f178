"""The addresses of the service, by what they are about.

Here is what they depend on: the queue, the samples, a job by its id, a job that has an SVG, and
JSON that is bounded.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Request, UploadFile
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ConfigDict, Field, ValidationError, WithJsonSchema
from starlette.exceptions import HTTPException

from gauss2svg.errors import InputError, brief
from gauss2svg.studio.jobs import Job, Jobs
from gauss2svg.studio.uploads import Sample


class PhotoForm(BaseModel):
    """A photo, given in one of three ways, and the options of its run."""

    photo: Annotated[UploadFile | None, WithJsonSchema({"type": "string", "format": "binary"})] = (
        Field(None, description="the file of a photo")
    )
    sample: str = Field("", description="or a name of /api/samples")
    of: str = Field("", description="or the id of a job, whose photo is taken again")
    options: str = Field("{}", description="JSON of options of /api/options")
    keep: bool = Field(False, description="run on when nobody reads its events any more")


class JobState(BaseModel):
    """A job; lines are the command and the Python that make the same file."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    state: str  # queued, running, done, stopped, failed or canceled
    place: int
    progress: dict[str, Any] | None
    report: dict[str, Any] | None
    error: str | None
    name: str
    width: int | None
    height: int | None
    options: dict[str, Any]
    lines: dict[str, str]


class Error(BaseModel):
    """Why a request was refused, in one line."""

    error: str


_STATUSES = {
    400: "a body that is no form with a file",
    401: "no token",
    403: "a page of another site",
    404: "no such job, or forgotten",
    408: "an upload that came too slowly",
    409: "a job without an SVG",
    413: "too many bytes",
    421: "another name of the machine",
    422: "a photo or options that cannot be used",
    429: "the line is full; Retry-After has the seconds",
    507: "no room on the disk",
}
ERRORS: dict[int | str, dict[str, Any]] = {
    status: {"model": Error, "description": why} for status, why in _STATUSES.items()
}


_Model = TypeVar("_Model", bound=BaseModel)


async def _jobs(request: Request) -> Jobs:
    return request.app.state.jobs


async def _samples(request: Request) -> dict[str, Sample]:
    return request.app.state.samples


AllJobs = Annotated[Jobs, Depends(_jobs)]
Samples = Annotated[dict[str, Sample], Depends(_samples)]


async def job_named(name: str, jobs: AllJobs) -> Job:
    """The job of that id; HTTPException where there is none."""
    job = jobs.known.get(name)
    if job is None:
        raise HTTPException(404, f"no job {name[:40]}; it may have been forgotten for newer ones")
    return job


KnownJob = Annotated[Job, Depends(job_named)]


async def finished(job: KnownJob) -> Job:
    """The job once its SVG is written; HTTPException where there will be none."""
    await job.when()
    if job.report is None:
        raise HTTPException(409, job.error or f"the job was {job.state}; it has no SVG")
    return job


FinishedJob = Annotated[Job, Depends(finished)]


async def sample_named(name: str, samples: Samples) -> Sample:
    """The sample of that name; HTTPException where there is none."""
    if name not in samples:
        raise HTTPException(404, f"no sample {name[:100]}")
    return samples[name]


KnownSample = Annotated[Sample, Depends(sample_named)]


def parsed(what: str, text: str, most: int) -> Any:
    """The value of JSON of at most so many characters; raises InputError."""
    if len(text) > most:
        raise InputError(f"{what} must be at most {most} characters; got more")
    try:
        return json.loads(text)
    except ValueError as error:
        raise InputError(f"{what} must be JSON; got {brief(error)}") from error
    except RecursionError as error:
        raise InputError(f"{what} must be JSON; got one too deep") from error


def validated(model: type[_Model], given: dict[str, Any]) -> _Model:
    """The model of given fields; raises RequestValidationError."""
    try:
        return model.model_validate(given)
    except ValidationError as error:
        raise RequestValidationError(error.errors()) from error
