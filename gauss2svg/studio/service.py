"""The ASGI application of the studio, and the server that the command runs."""

from __future__ import annotations

import asyncio
import contextlib
import mimetypes
import secrets
import signal
import socket
import webbrowser
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from threading import Thread

import uvicorn
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.staticfiles import StaticFiles
from uvicorn.server import HANDLED_SIGNALS

from gauss2svg.compare.records import machine
from gauss2svg.errors import Gauss2SvgError, on_one_line, quoted, refusal
from gauss2svg.options import Field
from gauss2svg.studio.guard import Guard, RequestLimits
from gauss2svg.studio.jobs import Jobs
from gauss2svg.studio.routes import router
from gauss2svg.studio.uploads import samples_in
from gauss2svg.version import __version__

_MOST_CONNECTIONS = 512
_LOCAL_NAMES = {"127.0.0.1", "localhost", "::1", "[::1]"}


def create_app(
    jobs: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    *,
    is_local: bool = False,
) -> RequestLimits:
    """Return the ASGI application.

    jobs      number of fits that run at the same time. If it is None, it depends on the number of
              cores.
    threads   number of CPU threads of each fit. If it is None, the fits share the cores.
    folder    folder whose photos can be picked on the page. If it is None, pictures of scikit-image
              can be picked.
    is_local  True if only this machine can reach the application. The page then says so.
    Raise InputError if there are more jobs or threads than cores, or if the folder has no photos.
    """
    queue = Jobs(*workers_and_threads(jobs, threads))

    handled = (HTTPException, RequestValidationError, Gauss2SvgError, OSError, Exception)

    @contextlib.asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        queue.start()
        yield

    app = FastAPI(
        title="gauss2svg studio",
        version=__version__,
        description="Photos in, SVGs of Gaussians out. Errors are {'error': one line}.",
        lifespan=lifespan,
        openapi_url="/api/openapi.json",
        exception_handlers=dict.fromkeys(handled, _error_response),
        # FastAPI's pages of documentation are left out, because they load scripts of other sites.
        docs_url=None,
        redoc_url=None,
    )
    app.state.jobs = queue
    app.state.samples = {sample.name: sample for sample in samples_in(folder)}
    app.state.is_local = is_local
    # Only one PNG is drawn at a time, because drawing is as costly as a fit.
    app.state.drawing = asyncio.Semaphore(1)
    app.include_router(router)
    mimetypes.add_type("text/javascript", ".js")  # the registry of Windows may lack this type
    packages = ["gauss2svg.studio", "gauss2svg.compare.pages"]
    app.mount("/static", StaticFiles(packages=[(package, "static") for package in packages]))
    return RequestLimits(app)


async def _error_response(_: Request, error: Exception) -> JSONResponse:
    """Return the response to a request that raised an error."""
    if isinstance(error, HTTPException) and isinstance(error.__cause__, OSError):
        error = error.__cause__  # the cause says why the form could not be stored on the disk
    headers = None
    match error:
        case HTTPException():
            status, line, headers = error.status_code, error.detail, error.headers
        case Gauss2SvgError():
            status, line = 422, str(error)
        case RequestValidationError():
            first = error.errors()[0]
            field = ".".join(name for name in first["loc"][1:] if isinstance(name, str))
            got = quoted(first["input"])
            status, line = 422, f"{field or 'the body'} must be valid; got {got} ({first['msg']})"
        case OSError():  # str(error) is not used, because it has the path of a file on the server
            status, line = 507, f"a file cannot be kept: {error.strerror}"
        case _:
            status, line = 500, f"{type(error).__name__}: {error}"
    return JSONResponse({"error": on_one_line(line)}, status, headers)


def workers_and_threads(jobs: int | None, threads: int | None) -> tuple[int, int]:
    """Return the number of simultaneous fits, and the number of threads of each.

    Raise InputError if one of them is larger than the number of cores.
    """
    cores = machine()["cores"]
    if threads is not None:
        Field("threads", int, 1, cores).checked(threads)
    if jobs is None:
        # A fit on four threads takes 45 % of the time that it takes on one thread. Eight threads
        # help little more: the fit then takes 36 %. So by default there is one fit for every four
        # cores (docs/decisions/studio.md).
        jobs = max(1, cores // (threads or 4))
    Field("jobs", int, 1, cores).checked(jobs)
    return jobs, threads or max(1, cores // jobs)


def serve(
    folder: Path | None,
    host: str,
    port: int,
    jobs: int | None,
    threads: int | None,
    *,
    browser: bool,
    say: Callable[[str], None],
) -> None:
    """Serve the studio until a signal comes.

    say  function that prints a line for the user
    Raise InputError if the server cannot listen on this host and port.
    """
    local, token = host.lower() in _LOCAL_NAMES, secrets.token_urlsafe(24)
    app = create_app(jobs, threads, folder, is_local=local)
    with _listening(host, port) as listening:
        port = listening.getsockname()[1]
        shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "::1": "[::1]"}.get(host, host)
        address = f"http://{shown}:{port}/?token="
        names = _LOCAL_NAMES | (set() if local else {host.lower(), socket.gethostname().lower()})
        guard = Guard(app, token, port, names, local)
        if not local:
            say(
                f"warning: anyone who reaches {host} and knows the token may use this machine, "
                "and the connection is not encrypted"
            )
        say(f"the studio is at {address}{token} (Ctrl-C ends it)")
        if browser:
            # If the browser runs in the terminal, webbrowser.open() returns only when the user
            # closes the browser. So it is called in a thread, and the server starts meanwhile.
            ticket_address = f"{address}{guard.ticket}"
            Thread(target=webbrowser.open, args=(ticket_address,), daemon=True).start()
        # Uvicorn handles signals itself while it runs. After a signal it shuts down, restores the
        # handlers that were set before, and raises the same signal once more. So "ignore" is set as
        # the handler here. Otherwise the second signal would end the program with an error.
        for number in HANDLED_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        config = uvicorn.Config(
            guard,
            log_level="critical",
            access_log=False,
            server_header=False,
            limit_concurrency=_MOST_CONNECTIONS,
            timeout_graceful_shutdown=1,
        )
        uvicorn.Server(config).run(sockets=[listening])


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens on the host and port.

    From now on clients can connect, but they get an answer only when the server runs.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        got = f"{host}:{port} ({error.strerror or error})"
        advice = "another --port, or --port 0"
        raise refusal("host and port", "free to listen on", got, advice) from error
