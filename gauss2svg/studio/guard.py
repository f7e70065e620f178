"""Who may use the server, how much a request may bring, and what a page may load.

ASGI middleware. `Bounded` is around every application of the studio, also where it is mounted;
`Guard` only around that of the command, for a mounted one is its host's to guard.
"""

from __future__ import annotations

import asyncio
import re
import secrets
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gauss2svg.errors import quoted

MOST_UPLOADED = 256 * 10**6  # bytes of a form
_MOST_JSON = 4_000_000  # bytes of any other body
PAUSE_S: float | None = 20.0  # in which more of a body must come
_BODY_S = 300.0  # in which all of a body must come

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
# An SVG opened by itself: it may be drawn, and nothing else.
PICTURE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; sandbox"
)
_HEADERS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


def _refused(status: int, line: str) -> JSONResponse:
    """Return the answer to a request, after which what is left of its body is not read."""
    headers = {"Connection": "close", "Cache-Control": "no-store"}
    return JSONResponse({"error": line}, status, headers)


class Bounded:
    """Bounds bodies in bytes and time, refuses pages of other sites, adds headers of safety."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        headers, read, pause_s = Headers(scope=scope), 0, PAUSE_S
        is_form = headers.get("content-type", "").startswith("multipart/form-data")
        most = MOST_UPLOADED if is_form else _MOST_JSON
        ends = time.monotonic() + _BODY_S
        too_large = f"a body must be at most {most / 1e6:g} MB; got more. Try a smaller file"

        async def bounded() -> Message:
            nonlocal read, pause_s
            try:
                async with asyncio.timeout(pause_s and min(pause_s, ends - time.monotonic())):
                    message = await receive()
            except TimeoutError:
                line = "a body must come without long pauses; got one. Try a faster connection"
                raise HTTPException(408, line, {"Connection": "close"}) from None
            read += len(message.get("body", b""))
            if not message.get("more_body", False):
                pause_s = None  # from now on only a disconnection can come
            if read > most:
                raise HTTPException(413, too_large, {"Connection": "close"})
            return message

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                answered = MutableHeaders(scope=message)
                is_picture = answered.get("content-type", "").startswith("image/svg+xml")
                policy = PICTURE_POLICY if is_picture else PAGE_POLICY
                for name, value in {**_HEADERS, "content-security-policy": policy}.items():
                    answered.setdefault(name, value)
            await send(message)

        answer, length = self.app, headers.get("content-length", "")
        origin = headers.get("origin")  # which pages send with all but plain GETs
        if origin is not None and origin.rpartition("/")[2] != headers.get("host"):
            answer = _refused(403, "a page of another site may not use the studio")
        elif length.isdecimal() and int(length) > most:
            answer = _refused(413, too_large)
        await answer(scope, bounded, with_headers)


class Guard:
    """Lets in who has the token, by the names of the server itself.

    names  hosts, as in addresses, in lower case and without ports
    local  whether it is served to this machine only; else addresses in digits are its names too
    """

    def __init__(self, app: ASGIApp, token: str, port: int, names: set[str], local: bool) -> None:
        self._app, self._token, self._names, self._local = app, token, names, local
        # Cookies do not tell ports apart, and there may be two studios.
        self._cookie = f"gauss2svg-{port}"
        # Opens the page once, for others may read a browser's command line.
        self.ticket = secrets.token_urlsafe(24)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or answer why not."""
        if scope["type"] == "http":
            answer = self._answer(HTTPConnection(scope))
            await answer(scope, receive, send)
        elif scope["type"] == "lifespan":
            await self._app(scope, receive, send)

    def _answer(self, asked: HTTPConnection) -> ASGIApp:
        """Return what answers a request: the studio, or a refusal."""
        host = asked.headers.get("host", "")
        name = re.sub(r":\d+$", "", host.lower())
        # A name can be made to point here (DNS rebinding); digits cannot.
        is_digits = re.fullmatch(r"[\d.]+|\[[\da-f:]+\]", name)
        if name not in self._names and (self._local or not is_digits):
            return _refused(421, f"the address must be the printed one; got {quoted(host)}")
        given = asked.query_params.get("token", "")
        is_home = (asked.scope["method"], asked.scope["path"]) == ("GET", "/")
        if is_home and (_equal(given, self._token) or _equal(given, self.ticket)):
            if _equal(given, self.ticket):
                self.ticket = secrets.token_urlsafe(24)
            # So that the token does not stay in the address. Lax, for a link of another site may
            # open the page; what such a site asks by itself has no cookie.
            home = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
            home.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
            return home
        scheme, _, bearer = asked.headers.get("authorization", "").partition(" ")
        given = bearer if scheme.lower() == "bearer" else asked.cookies.get(self._cookie, "")
        if not _equal(given, self._token):
            return _refused(401, "the token must be that of the printed address; got another")
        return self._app


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())
