"""Who may use the server, how much a request may bring, and what a page may load.

ASGI middleware. `Bounded` is around every application of the studio, also where it is mounted;
`Guard` only around that of the command, for a mounted one is its host's to guard.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
from contextlib import suppress
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gauss2svg.errors import quoted

MOST_UPLOADED = 256 * 10**6  # bytes of a form
_MOST_JSON = 4_000_000  # bytes of any other body
PAUSE_S: float | None = 20.0  # in which more of a body must come

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
    "cross-origin-opener-policy": "same-origin",
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
        too_large = f"a body must be at most {most / 1e6:g} MB; got more. Try a smaller file"

        async def bounded() -> Message:
            nonlocal read, pause_s
            try:
                async with asyncio.timeout(pause_s):
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
        if _is_of_another_site(scope["method"], headers):
            answer = _refused(403, "a page of another site may not use the studio")
        elif length.isdecimal() and int(length) > most:
            answer = _refused(413, too_large)
        await answer(scope, bounded, with_headers)


def _is_of_another_site(method: str, headers: Headers) -> bool:
    site, mode = headers.get("sec-fetch-site", ""), headers.get("sec-fetch-mode", "")
    # A link to the studio is no use of it.
    is_link = method == "GET" and mode in ("", "navigate")
    if site in ("cross-site", "same-site") and not is_link:
        return True
    origin = headers.get("origin", "")
    with suppress(ValueError):
        return origin != "" and urlsplit(origin).netloc.lower() != headers.get("host", "").lower()
    return True


class Guard:
    """Lets in who has the token, by the names of the server itself.

    names  hosts, as in addresses, without ports
    local  whether it is served to this machine only; else addresses in digits are its names too
    """

    def __init__(self, app: ASGIApp, token: str, port: int, names: set[str], local: bool) -> None:
        self._app, self._token, self._names, self._local = app, token, names, local
        # Cookies do not tell ports apart, and there may be two studios.
        self._cookie = f"gauss2svg-{port}"
        self._ticket = ""

    def ticket(self) -> str:
        """Return a token that opens the page once: others may read a browser's command line."""
        self._ticket = secrets.token_urlsafe(24)
        return self._ticket

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
        if not self._is_ours(host):
            needed = "the one that the studio has printed"
            return _refused(421, f"the address must be {needed}; got {quoted(host)}. Try that one")
        given = asked.query_params.get("token", "")
        if (asked.scope["method"], asked.scope["path"]) == ("GET", "/") and given:
            tickets, self._ticket = [self._token, *filter(None, [self._ticket])], ""
            if any(_equal(given, one) for one in tickets):
                # So that the token does not stay in the address. Lax, for a link of another site
                # may open the page; what such a site asks by itself has no cookie.
                home = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
                home.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
                return home
        scheme, _, bearer = asked.headers.get("authorization", "").partition(" ")
        given = bearer if scheme.lower() == "bearer" else asked.cookies.get(self._cookie, "")
        if not _equal(given, self._token):
            needed = "that of the address that the studio has printed"
            return _refused(401, f"the token must be {needed}; got another. Try that address")
        return self._app

    def _is_ours(self, host: str) -> bool:
        try:
            name = (urlsplit(f"//{host}").hostname or "").lower()
        except ValueError:
            return False
        # A name can be made to point here (DNS rebinding); digits cannot.
        return name in self._names or (not self._local and _is_address(name))


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


def _is_address(name: str) -> bool:
    with suppress(ValueError):
        return bool(ipaddress.ip_address(name))
    return False
