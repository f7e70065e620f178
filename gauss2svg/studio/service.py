"""The ASGI application of the studio, the server that the command runs, and what guards both.

`Guard` refuses requests of pages of other sites, and adds security headers to responses. Only the
command `gauss2svg studio` lets it ask for a token, because an application that mounts the studio
decides itself who may use it.
"""

from __future__ import annotations

import mimetypes
import re
import secrets
import signal
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import uvicorn
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection, Request
from starlette.responses import RedirectResponse
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.server import HANDLED_SIGNALS

from gauss2svg.errors import Gauss2SvgError, on_one_line, quoted, refusal
from gauss2svg.render.cpu import CORES
from gauss2svg.studio import StudioOptions
from gauss2svg.studio.jobs import Jobs
from gauss2svg.studio.routes import router, samples_in
from gauss2svg.version import __version__

_LOCAL_NAMES = {"127.0.0.1", "localhost", "::1", "[::1]"}


def create_app(
    jobs: int | None = None,
    threads: int | None = None,
    folder: Path | None = None,
    *,
    is_local: bool = False,
) -> Guard:
    """Return the ASGI application.

    jobs      number of fits that run at the same time. If it is None, it depends on the number of
              cores.
    threads   number of CPU threads of each fit. If it is None, the fits share the cores.
    folder    folder whose photos can be picked on the page. If it is None, pictures of scikit-image
              can be picked.
    is_local  True if only this machine can reach the application. The page then says so.
    Raise InputError if the folder has no photos.
    """
    app = FastAPI(
        title="gauss2svg studio",
        version=__version__,
        description="Photos in, SVGs of Gaussians out. Errors are {'error': one line}.",
        openapi_url="/api/openapi.json",
        exception_handlers=dict.fromkeys(
            (HTTPException, RequestValidationError, Gauss2SvgError, OSError, Exception),
            _error_response,
        ),
        # FastAPI's pages of documentation are left out, because they load scripts of other sites.
        docs_url=None,
        redoc_url=None,
    )
    # A fit on four threads takes 45 % of the time that it takes on one thread. Eight threads help
    # little more: the fit then takes 36 %. So by default there is one fit for every four cores
    # (docs/decisions/studio.md).
    jobs = jobs or max(1, CORES // (threads or 4))
    app.state.jobs = Jobs(jobs, threads or max(1, CORES // jobs))
    app.state.samples = samples_in(folder)
    app.state.is_local = is_local
    app.include_router(router)
    mimetypes.add_type("text/javascript", ".js")  # the registry of Windows may lack this type
    packages = ["gauss2svg.studio", "gauss2svg.compare"]
    app.mount("/static", StaticFiles(packages=[(package, "static") for package in packages]))
    return Guard(app)


async def _error_response(_: Request, error: Exception) -> JSONResponse:
    """Return the response to a request that raised an error."""
    match error:
        case HTTPException():
            status, line = error.status_code, error.detail
        case Gauss2SvgError():
            status, line = 422, str(error)
        case RequestValidationError():
            first = error.errors()[0]
            field = ".".join(name for name in first["loc"][1:] if isinstance(name, str))
            got = quoted(first["input"])
            status, line = 422, f"{field or 'the body'} must be valid; got {got} ({first['msg']})"
        case _:
            status, line = 500, f"{type(error).__name__}: {error}"
    return _refused(status, line)


def serve(options: StudioOptions, say: Callable[[str], None]) -> None:
    """Serve the studio until a signal comes.

    say  function that prints a line for the user
    Raise InputError if the server cannot listen on this host and port.
    """
    host, token = options.host, secrets.token_urlsafe(24)
    local = host.lower() in _LOCAL_NAMES
    app = create_app(options.jobs, options.threads, options.folder, is_local=local).app
    with _listening(host, options.port) as listening:
        port = listening.getsockname()[1]
        shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "::1": "[::1]"}.get(host, host)
        address = f"http://{shown}:{port}/?token={token}"
        if not local:
            say(
                f"warning: anyone who reaches {host} and knows the token may use this machine, "
                "and the connection is not encrypted"
            )
        say(f"the studio is at {address} (Ctrl-C ends it)")
        if not options.no_browser:
            # If the browser runs in the terminal, webbrowser.open() returns only when the user
            # closes the browser. So it is called in a thread, and the server starts meanwhile.
            Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        # Uvicorn handles signals itself while it runs. After a signal it shuts down, restores the
        # handlers that were set before, and raises the same signal once more. So "ignore" is set as
        # the handler here. Otherwise the second signal would end the program with an error.
        for number in HANDLED_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        guarded = Guard(app, token, port, local)
        config = uvicorn.Config(guarded, log_level="critical", timeout_graceful_shutdown=1)
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


# An SVG that is opened as a page may be drawn, but may not run scripts or load files.
_PICTURE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; sandbox"
)
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)


class Guard:
    """Middleware that refuses requests of pages of other sites, and adds security headers.

    With a token, it also refuses requests without the token and requests for another server. A
    request names its server in the header "host".

    token  token that requests need, or "" if none is needed
    port   port of the server
    local  whether only this machine can reach the server. If so, clients must address the server by
           a name of this machine.
    """

    def __init__(self, app: ASGIApp, token: str = "", port: int = 0, local: bool = False) -> None:
        self.app, self._token, self._local = app, token, local
        # A browser sends a cookie to all ports of a host. So the port is part of the cookie's name,
        # and two studios on one host do not overwrite each other's cookies.
        self._cookie = f"gauss2svg-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                is_picture = headers.get("content-type", "").startswith("image/svg+xml")
                for name, value in {
                    "content-security-policy": _PICTURE_POLICY if is_picture else _PAGE_POLICY,
                    "x-content-type-options": "nosniff",
                    "referrer-policy": "no-referrer",
                    "cross-origin-resource-policy": "same-origin",
                    "cache-control": "no-store",
                }.items():
                    headers.setdefault(name, value)
            await send(message)

        answer = self._answer(HTTPConnection(scope)) if scope["type"] == "http" else self.app
        await answer(scope, receive, with_headers)

    def _answer(self, request: HTTPConnection) -> ASGIApp:
        """Return the application that answers a request: the studio, a redirection or a refusal."""
        host = request.headers.get("host", "")
        # A browser sends this header, which names the site of the page, with all requests except
        # plain GETs.
        origin = request.headers.get("origin")
        if origin is not None and origin.rpartition("/")[2] != host:
            return _refused(403, "a page of another site may not use the studio")
        if not self._token:
            return self.app
        # By DNS rebinding, a hostile site can let its own name lead to this server, and then send
        # requests from the user's browser. The header "host" of such a request has the name of the
        # site.
        if self._local and re.sub(r":\d+$", "", host.lower()) not in _LOCAL_NAMES:
            return _refused(421, f"the address must be the printed one; got {quoted(host)}")
        is_page = (request.scope["method"], request.scope["path"]) == ("GET", "/")
        if is_page and self._has_token(request.query_params.get("token", "")):
            # The redirection removes the token from the address. With samesite="lax", a link on
            # another site may open the page, but requests that such a site makes by itself do not
            # have the cookie.
            redirection = RedirectResponse("/", 303)
            redirection.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
            return redirection
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        if not self._has_token(bearer or request.cookies.get(self._cookie, "")):
            return _refused(401, "the token must be that of the printed address; got another")
        return self.app

    def _has_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())


def _refused(status: int, line: str) -> JSONResponse:
    return JSONResponse({"error": on_one_line(line)}, status)
