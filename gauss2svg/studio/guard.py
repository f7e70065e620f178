"""Who may use the server, how much a request may bring, and what a page may load.

ASGI middleware. `Bounded` is around every application of the studio, also where it is mounted;
`Guard` only around that of the command, for a mounted one is its host's to guard.
"""

from __future__ import annotations

import asyncio
import ipaddress
import secrets
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gauss2svg.errors import quoted

MOST_UPLOADED = 256 * 10**6  # bytes of a request
_BODY_S, _CHUNK_S = 300.0, 20.0  # in which a body must be there, and in which more of it must come

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
# An SVG opened by itself: it may be drawn, and nothing else.
PICTURE_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'; sandbox"
)
_OTHER_SITE = "a page of another site may not use the studio"
_HEADERS = {
    "content-security-policy": PAGE_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


class RefusedError(HTTPException):
    """A request that is refused: status and line."""

    def answer(self) -> JSONResponse:
        """The answer, after which what is left of a body is not read."""
        headers = {"Connection": "close", "Cache-Control": "no-store"}
        return JSONResponse({"error": self.detail}, self.status_code, headers)


class Bounded:
    """Bounds bodies in bytes and time, and adds the headers of safety."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        answered = whole = False
        read, until = 0, asyncio.get_running_loop().time() + _BODY_S

        async def bounded() -> Message:
            nonlocal read, whole
            if whole:  # from now on only a disconnection can come
                return await receive()
            left = min(_CHUNK_S, until - asyncio.get_running_loop().time())
            try:
                message = await asyncio.wait_for(receive(), max(left, 0))
            except TimeoutError as error:
                line = "a request must come without long pauses; try again, by a faster connection"
                raise RefusedError(408, line) from error
            read += len(message.get("body", b""))
            whole = not message.get("more_body", False)
            if read > MOST_UPLOADED:
                raise _too_large()
            return message

        async def with_headers(message: Message) -> None:
            nonlocal answered
            if message["type"] == "http.response.start":
                answered = True
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        try:
            if _is_of_another_site(scope):
                raise RefusedError(403, _OTHER_SITE)
            length = Headers(scope=scope).get("content-length", "")
            if length.isdecimal() and int(length) > MOST_UPLOADED:
                raise _too_large()
            await self._app(scope, bounded, with_headers)
        except RefusedError as error:
            if answered:
                raise
            await error.answer()(scope, receive, with_headers)


class Guard:
    """Lets in who has the token, by the names of the server itself, and no page of another site.

    names  hosts, as in addresses, without ports
    local  whether it is served to this machine only; else addresses in digits are its names too
    """

    def __init__(self, app: ASGIApp, token: str, port: int, names: set[str], local: bool) -> None:
        self._app = app
        self._token = token
        self._port = port
        self._names = names
        self._local = local
        # Cookies do not tell ports apart, and there may be two studios.
        self._cookie = f"gauss2svg-{port}"
        self._ticket = ""

    def ticket(self) -> str:
        """A token that opens the page once: others may read a browser's command line."""
        self._ticket = secrets.token_urlsafe(24)
        return self._ticket

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or answer why not."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        asked = HTTPConnection(scope)
        try:
            opened = self._check(asked)
        except RefusedError as error:
            await error.answer()(scope, receive, send)
            return
        if not opened:
            await self._app(scope, receive, send)
            return
        # So that the token does not stay in the address.
        home = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
        home.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
        if asked.headers.get("sec-fetch-site", "") in ("", "none", "same-origin"):
            await home(scope, receive, send)
            return

        async def with_cookie(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).append("set-cookie", home.headers["set-cookie"])
            await send(message)

        # Browsers would leave out the cookie after a link of another site.
        await self._app(scope, receive, with_cookie)

    def _check(self, asked: HTTPConnection) -> bool:
        """Whether the page is opened by the token in its address; raises RefusedError."""
        headers, token = asked.headers, asked.query_params.get("token", "")
        host = headers.get("host", "")
        if not self._is_ours(host):
            raise RefusedError(
                421,
                "the address must be the one that the studio has printed; got "
                f"{quoted(host)}. Try that one",
            )
        if not _is_own_origin(headers):
            raise RefusedError(403, _OTHER_SITE)
        is_page = (asked.scope["method"], asked.scope["path"]) == ("GET", "/")
        if is_page and self._ticket and _equal(token, self._ticket):
            self._ticket = ""
            return True
        opened = is_page and _equal(token, self._token)
        if not opened and headers.get("sec-fetch-site") in ("cross-site", "same-site"):
            raise RefusedError(403, _OTHER_SITE)
        scheme, _, bearer = headers.get("authorization", "").partition(" ")
        given = [token, asked.cookies.get(self._cookie, "")]
        given.append(bearer if scheme.lower() == "bearer" else "")
        if not any(_equal(text, self._token) for text in given):
            line = "the token must be given; try the address that the studio has printed"
            raise RefusedError(401, line)
        return opened

    def _is_ours(self, host: str) -> bool:
        try:
            parts = urlsplit(f"//{host}")
            name, port = (parts.hostname or "").lower(), parts.port or 80
        except ValueError:
            return False
        if self._local:
            return name in self._names and port == self._port
        # A name can be made to point here (DNS rebinding); digits cannot.
        return name in self._names or _is_address(name)


def _too_large() -> RefusedError:
    most = f"{MOST_UPLOADED / 1e6:g} MB"
    return RefusedError(413, f"an upload must be at most {most}; got more. Try a smaller file")


def _equal(given: str, secret: str) -> bool:
    return secrets.compare_digest(given.encode(), secret.encode())


def _is_own_origin(headers: Headers) -> bool:
    origin = headers.get("origin", "")
    try:
        return not origin or urlsplit(origin).netloc.lower() == headers.get("host", "").lower()
    except ValueError:
        return False


def _is_of_another_site(scope: Scope) -> bool:
    headers = Headers(scope=scope)
    site, mode = headers.get("sec-fetch-site", ""), headers.get("sec-fetch-mode", "")
    if not site:
        return not _is_own_origin(headers)
    # A link to the studio is no use of it.
    is_link = scope["method"] == "GET" and mode in ("", "navigate")
    return site in ("cross-site", "same-site") and not is_link


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
