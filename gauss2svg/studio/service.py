"""The service, an ASGI application: photos in, progress and SVGs out; and the command's server."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import re
import secrets
import socket
import sys
import webbrowser
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from threading import Thread
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.datastructures import UploadFile
from starlette.exceptions import HTTPException
from uvicorn.protocols.http.h11_impl import H11Protocol

from gauss2svg.compare.machine import machine
from gauss2svg.errors import Gauss2SvgError, InputError, on_one_line, quoted, whole_number
from gauss2svg.studio.guard import Bounded, Guard
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


_HEAD_S = 10.0  # in which the head of a request must be there
_MOST_CONNECTIONS = 512
_MOST_WAITING = 256  # beyond which the one that has waited longest for a head goes
_LOCAL_NAMES = {"127.0.0.1", "localhost", "::1"}


class _Protocol(H11Protocol):
    """HTTP that waits neither for ever nor on too many connections for the head of a request."""

    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._watch()
        waiting = [
            (one._patience.when(), one)
            for one in self.connections
            if isinstance(one, _Protocol) and one._patience is not None
        ]
        if len(waiting) > _MOST_WAITING:  # else those that send nothing would shut out all others
            min(waiting, key=lambda pair: pair[0])[1]._give_up()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        self._watch()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._watch()  # kept alive, it waits for a head as one that has asked for nothing does

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._watch()

    def _watch(self) -> None:
        answering = self.cycle is not None and not self.cycle.response_complete
        if answering or self.transport.is_closing():
            if self._patience is not None:
                self._patience.cancel()
                self._patience = None
        elif self._patience is None:
            self._patience = self.loop.call_later(_HEAD_S, self._give_up)

    def _give_up(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()


class _Server(uvicorn.Server):
    """A server that says where it is once it answers, and ends its fits before its connections."""

    def __init__(self, config: uvicorn.Config, end_fits: Any, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._end_fits, self._ready = end_fits, ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        await self._end_fits()  # which ends the streams of their events
        await super().shutdown(sockets)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Signals end the server, which is what they are for: they are not raised again."""
        self.should_exit = True
        _ = sig, frame


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
    """Serve the studio until a signal; say is called with lines for a person.

    Raises InputError for an address that cannot be listened on.
    """
    whole_number("port", port, 0, 65535)
    app = create_app(jobs, threads, folder, is_local=_is_loopback(host))
    listening = _socket(host, port)
    with contextlib.closing(listening):
        port = listening.getsockname()[1]
        local, token = _is_loopback(host), secrets.token_urlsafe(24)
        names = _LOCAL_NAMES | ({host.lower()} - {"0.0.0.0", "::"})
        names |= set() if local else {socket.gethostname().lower()}
        shown_host = "127.0.0.1" if host in ("0.0.0.0", "::") else host
        shown_host = f"[{shown_host}]" if ":" in shown_host else shown_host
        address = f"http://{shown_host}:{port}/?token="
        guard = Guard(app, token, port, names, local)

        def ready() -> None:
            if not local:
                say(
                    f"warning: anyone who reaches {host} and knows the token may use this machine, "
                    "and the connection is not encrypted"
                )
            say(f"the studio is at {address}{token} (Ctrl-C ends it)")
            if browser:
                # A browser in the terminal would keep its caller until it is left.
                opened = f"{address}{guard.ticket()}"
                Thread(target=webbrowser.open, args=(opened,), daemon=True).start()

        _Server(_config(guard), app.jobs.close, ready).run(sockets=[listening])


def _config(app: Any) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        http=_Protocol,
        loop="asyncio",
        ws="none",
        log_level="critical",
        access_log=False,
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        timeout_keep_alive=10,
        timeout_graceful_shutdown=2,
    )


def _socket(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listening = socket.socket(family, kind, protocol)
        # The port is free again at once, and nobody else's until then: on Windows SO_REUSEADDR
        # would let others listen on it too, and take its requests.
        if sys.platform == "win32":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind(address)
        except OSError:
            listening.close()
            raise
    except OSError as error:
        raise InputError(
            f"host and port must be free to listen on; got {host}:{port} ("
            f"{error.strerror or error}). Try another --port, or --port 0"
        ) from error
    return listening


def _is_loopback(host: str) -> bool:
    if host.lower() == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False
