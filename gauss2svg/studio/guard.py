"""ASGI middleware that guards the studio.

`RequestLimits` limits requests to the studio, and adds security headers to responses. `Guard` asks
for a token. Only the command `gauss2svg studio` uses `Guard`, because an application that mounts
the studio decides itself who may use it.
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

MOST_UPLOADED = 256 * 10**6  # largest number of bytes of an uploaded form, including its files
_MOST_JSON = 4_000_000  # largest number of bytes in the body of a request that is not a form
PAUSE_S: float | None = 20.0  # longest pause (s) between two parts of a request's body
_BODY_S = 300.0  # longest time (s) that the whole body of a request may take to arrive

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
# Policy for an SVG that is opened as a page. The SVG may be drawn, but it may not run scripts or
# load files.
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
    """Return the response that refuses a request.

    It closes the connection, because the rest of the request's body is not read.
    """
    headers = {"Connection": "close", "Cache-Control": "no-store"}
    return JSONResponse({"error": line}, status, headers)


class RequestLimits:
    """Middleware that limits requests.

    It refuses a request if its body is too large or takes too long to arrive, or if it comes from a
    page of another site.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it if it exceeds the limits or comes from another site."""
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
                # The body is complete. The next message can only be that the client has
                # disconnected. It may come at any time, so the pause before it is not limited.
                pause_s = None
            if read > most:
                raise HTTPException(413, too_large, {"Connection": "close"})
            return message

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                response = MutableHeaders(scope=message)
                is_picture = response.get("content-type", "").startswith("image/svg+xml")
                policy = PICTURE_POLICY if is_picture else PAGE_POLICY
                for name, value in {**_HEADERS, "content-security-policy": policy}.items():
                    response.setdefault(name, value)
            await send(message)

        answer, length = self.app, headers.get("content-length", "")
        # A browser sends this header, which names the site of the page, with all requests except
        # plain GETs.
        origin = headers.get("origin")
        if origin is not None and origin.rpartition("/")[2] != headers.get("host"):
            answer = _refused(403, "a page of another site may not use the studio")
        elif length.isdecimal() and int(length) > most:
            answer = _refused(413, too_large)
        await answer(scope, bounded, with_headers)


class Guard:
    """Middleware that refuses requests without the token and requests for another server.

    A request names its server in the header "host".

    names  host names by which clients may address the server, in lower case and without ports
    local  True if only this machine can reach the server. If it is False, clients may also address
           the server by any IP address.
    """

    def __init__(self, app: ASGIApp, token: str, port: int, names: set[str], local: bool) -> None:
        self._app, self._token, self._names, self._local = app, token, names, local
        # A browser sends a cookie to all ports of a host. So the port is part of the cookie's name,
        # and two studios on one host do not overwrite each other's cookies.
        self._cookie = f"gauss2svg-{port}"
        # A ticket can open the page only once. The browser is started with the ticket and not with
        # the token, because other users may be able to read the browser's command line.
        self.ticket = secrets.token_urlsafe(24)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a request, or refuse it."""
        if scope["type"] == "http":
            answer = self._answer(HTTPConnection(scope))
            await answer(scope, receive, send)
        elif scope["type"] == "lifespan":
            await self._app(scope, receive, send)

    def _answer(self, request: HTTPConnection) -> ASGIApp:
        """Return the application that answers a request: the studio, a redirection or a refusal."""
        host = request.headers.get("host", "")
        name = re.sub(r":\d+$", "", host.lower())
        # By DNS rebinding, a hostile site can let its own name lead to this server, and then send
        # requests from the user's browser. The header "host" of such a request has the name of the
        # site. So a request is refused if the header has another name than those of this server. An
        # IP address in the header is no sign of this attack, because it is not a site's name.
        is_ip_address = re.fullmatch(r"[\d.]+|\[[\da-f:]+\]", name)
        if name not in self._names and (self._local or not is_ip_address):
            return _refused(421, f"the address must be the printed one; got {quoted(host)}")
        token = request.query_params.get("token", "")
        is_page = (request.scope["method"], request.scope["path"]) == ("GET", "/")
        if is_page and (_equal(token, self._token) or _equal(token, self.ticket)):
            if _equal(token, self.ticket):
                self.ticket = secrets.token_urlsafe(24)
            # The redirection removes the token from the address. With samesite="lax", a link on
            # another site may open the page, but requests that such a site makes by itself do not
            # have the cookie.
            redirection = RedirectResponse("/", 303, {"Cache-Control": "no-store"})
            redirection.set_cookie(self._cookie, self._token, httponly=True, samesite="lax")
            return redirection
        scheme, _, bearer = request.headers.get("authorization", "").partition(" ")
        token = bearer if scheme.lower() == "bearer" else request.cookies.get(self._cookie, "")
        if not _equal(token, self._token):
            return _refused(401, "the token must be that of the printed address; got another")
        return self._app


def _equal(token: str, secret: str) -> bool:
    return secrets.compare_digest(token.encode(), secret.encode())
