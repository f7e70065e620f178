"""Who may use the server, how much a request may bring, and what a page may load.

Pure ASGI. `Bounded` is around every application of the studio, also where it is mounted; `Guard`
only around that of the command, for a mounted one is its host's to guard.
"""

from __future__ import annotations

import asyncio
import ipaddress
import json
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.exceptions import HTTPException

from gauss2svg.errors import quoted

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Any]]
Send = Callable[[Any], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

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
_HEADERS = [
    (b"content-security-policy", PAGE_POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]


class RefusedError(HTTPException):
    """A request that is refused: status and line."""


class Bounded:
    """Bounds bodies in bytes and time, and adds the headers of safety."""

    def __init__(self, app: App, most: int | None = None) -> None:
        self._app = app
        self._most = MOST_UPLOADED if most is None else most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        answered = whole = False
        read, until = 0, asyncio.get_running_loop().time() + _BODY_S

        async def bounded() -> Any:
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
            if read > self._most:
                raise self._too_large()
            return message

        async def with_headers(message: Any) -> None:
            nonlocal answered
            if message["type"] == "http.response.start":
                answered = True
                given = {name for name, _ in message["headers"]}
                more = [pair for pair in _HEADERS if pair[0] not in given]
                message = {**message, "headers": [*message["headers"], *more]}
            await send(message)

        try:
            if _is_of_another_site(scope):
                raise RefusedError(403, _OTHER_SITE)
            length = _header(scope, b"content-length")
            if length.isdecimal() and int(length) > self._most:
                raise self._too_large()
            await self._app(scope, bounded, with_headers)
        except RefusedError as error:
            if answered:
                raise
            await _refuse(with_headers, error)

    def _too_large(self) -> RefusedError:
        most = f"{self._most / 1e6:g} MB"
        return RefusedError(413, f"an upload must be at most {most}; got more. Try a smaller file")


class Guard:
    """Lets in who has the token, by the names of the server itself, and no page of another site.

    names  hosts, as in addresses, without ports
    local  whether it is served to this machine only; else addresses in digits are its names too
    """

    def __init__(self, app: App, token: str, port: int, names: set[str], local: bool) -> None:
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
        try:
            opened = self._check(scope)
        except RefusedError as error:
            await _refuse(send, error)
            return
        if not opened:
            await self._app(scope, receive, send)
            return
        cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"

        async def with_cookie(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = [*message["headers"], (b"set-cookie", cookie.encode())]
                message = {**message, "headers": headers}
            await send(message)

        if _header(scope, b"sec-fetch-site") in ("", "none", "same-origin"):
            # So that the token does not stay in the address.
            await _answer(with_cookie, 303, b"", {"Location": "/"})
        else:  # browsers would leave out the cookie after a link of another site
            await self._app(scope, receive, with_cookie)

    def _check(self, scope: Scope) -> bool:
        """Whether the page is opened by the token in its address; raises RefusedError."""
        host = _header(scope, b"host")
        if not self._is_ours(host):
            raise RefusedError(
                421,
                "the address must be the one that the studio has printed; got "
                f"{quoted(host)}. Try that one",
            )
        if not _is_own_origin(scope):
            raise RefusedError(403, _OTHER_SITE)
        asked = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        is_page = scope["method"] == "GET" and scope["path"] == "/"
        if (
            is_page
            and self._ticket
            and secrets.compare_digest(asked.encode(), self._ticket.encode())
        ):
            self._ticket = ""
            return True
        opened = is_page and self._fits(asked)
        if not opened and _header(scope, b"sec-fetch-site") in ("cross-site", "same-site"):
            raise RefusedError(403, _OTHER_SITE)
        scheme, _, bearer = _header(scope, b"authorization").partition(" ")
        # By hand: a parser gives up all cookies for one odd one of another server.
        cookies = [part.strip().partition("=") for part in _header(scope, b"cookie").split(";")]
        given = [value for name, _, value in cookies if name == self._cookie]
        given.append(bearer if scheme.lower() == "bearer" else "")
        if not any(self._fits(text) for text in [*given, asked]):
            line = "the token must be given; try the address that the studio has printed"
            raise RefusedError(401, line)
        return opened

    def _fits(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self._token.encode())

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


def _is_own_origin(scope: Scope) -> bool:
    origin = _header(scope, b"origin")
    try:
        return not origin or urlsplit(origin).netloc.lower() == _header(scope, b"host").lower()
    except ValueError:
        return False


def _is_of_another_site(scope: Scope) -> bool:
    site, mode = _header(scope, b"sec-fetch-site"), _header(scope, b"sec-fetch-mode")
    if not site:
        return not _is_own_origin(scope)
    # A link to the studio is no use of it.
    is_link = scope["method"] == "GET" and mode in ("", "navigate")
    return site in ("cross-site", "same-site") and not is_link


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _header(scope: Scope, name: bytes) -> str:
    return next((v.decode("latin-1") for n, v in scope["headers"] if n == name), "")


async def _refuse(send: Send, error: RefusedError) -> None:
    body = json.dumps({"error": error.detail}).encode()
    # What is left of a body is not read.
    headers = {"Content-Type": "application/json", "Connection": "close"}
    await _answer(send, error.status_code, body, headers)


async def _answer(send: Send, status: int, body: bytes, headers: dict[str, str]) -> None:
    headers = {**headers, "Content-Length": str(len(body)), "Cache-Control": "no-store"}
    pairs = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    await send({"type": "http.response.start", "status": status, "headers": pairs})
    await send({"type": "http.response.body", "body": body})
