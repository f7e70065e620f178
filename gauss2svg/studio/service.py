"""The service as an ASGI application: photos in, progress and SVGs out."""

from __future__ import annotations

import asyncio
import contextlib
import re
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException

from gauss2svg.compare.machine import machine
from gauss2svg.errors import Gauss2SvgError, on_one_line, quoted, whole_number
from gauss2svg.studio.guard import Bounded
from gauss2svg.studio.jobs import Jobs, QueueFullError
from gauss2svg.studio.routes import ERRORS, pages, results
from gauss2svg.studio.routes import jobs as job_routes
from gauss2svg.studio.uploads import samples_in
from gauss2svg.version import __version__


class Studio(Bounded):
    """The ASGI application, and its jobs."""

    def __init__(self, app: FastAPI, jobs: Jobs) -> None:
        super().__init__(app)
        self.jobs = jobs


def create_app(
    jobs: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    *,
    is_local: bool = False,
) -> Studio:
    """The ASGI application.

    jobs     fits that run at once; None: by the cores
    threads  of each; None: the cores, shared out
    folder   whose photos can be picked; None: pictures of scikit-image
    is_local  whether it is served to its own machine only, which the page then says
    Raises InputError for more than the machine has, and for a folder without photos.
    """
    queue = Jobs(*workers_and_threads(jobs, threads))

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        queue.start()
        try:
            yield
        finally:
            await queue.close()

    app = FastAPI(
        title="gauss2svg studio",
        version=__version__,
        description="Photos in, SVGs of Gaussians out. Errors are {'error': one line}.",
        lifespan=lifespan,
        openapi_url="/api/openapi.json",
        responses=ERRORS,
        exception_handlers=dict.fromkeys(_ERRORS, _refusal),
        generate_unique_id_function=lambda route: route.name,
        # These pages load scripts from other sites.
        docs_url=None,
        redoc_url=None,
    )
    app.state.jobs = queue
    app.state.samples = {sample.name: sample for sample in samples_in(folder)}
    app.state.is_local = is_local
    app.state.drawing = asyncio.Semaphore(1)  # a PNG takes the time and the memory of a fit
    for routes in (pages, job_routes, results):
        for route in routes.router.routes:
            if isinstance(route, APIRoute):  # its summary is the function's name otherwise
                route.summary = route.description.partition(".")[0]
        app.include_router(routes.router)
    return Studio(app, queue)


def _line(status: int, text: str, headers: Any = None) -> JSONResponse:
    return JSONResponse({"error": on_one_line(text)}, status, headers)


async def _refusal(request: Request, error: Exception) -> JSONResponse:
    """The answer to a request that raised an error."""
    match error:
        case HTTPException():
            return _line(error.status_code, error.detail, error.headers)
        case QueueFullError():
            return _line(429, str(error), {"Retry-After": str(request.app.state.jobs.wait_s)})
        case Gauss2SvgError():
            return _line(422, str(error))
        case RequestValidationError():
            return _line(422, _invalid(error.errors()[0]))
        case _:
            # Without the path of a file, which is private.
            what = error.strerror if isinstance(error, OSError) else error
            return _line(500, f"{type(error).__name__}: {what}")


def _invalid(error: dict[str, Any]) -> str:
    """Pydantic's first error in the words of the others."""
    field = ".".join(map(str, error["loc"]))
    if error["type"] == "missing":
        return f"{field} must be given; got none"
    # "Input should be a valid number, unable to parse string as a number"
    must, found = _SHOULD.subn("must", _ASIDE.sub("", error["msg"]), 1)
    given = error["input"]
    got = "a file" if isinstance(given, UploadFile) else quoted(given)
    return f"{field} {must if found else f'must be valid: {must}'}; got {got}"


_SHOULD, _ASIDE = re.compile(r"^\w+ should\b"), re.compile(", (unable|got|not) .*")
_ERRORS = HTTPException, QueueFullError, Gauss2SvgError, RequestValidationError, Exception


def workers_and_threads(jobs: int | None, threads: int | None) -> tuple[int, int]:
    """Fits at once, and threads of each; raises InputError for more than there are cores."""
    cores = machine()["cores"]
    if threads is not None:
        whole_number("threads", threads, 1, cores)
    if jobs is None:
        # A fit on four threads takes 45 % of the time of one thread, on eight 36 %: more cores
        # serve more fits (docs/decisions/studio.md).
        jobs = max(1, cores // (threads or 4))
    whole_number("jobs", jobs, 1, cores)
    return jobs, threads or max(1, cores // jobs)
