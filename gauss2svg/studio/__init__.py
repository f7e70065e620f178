"""gauss2svg studio: a web page on which users vectorise photos, and the service behind it.

    application.mount("/studio", gauss2svg.studio.app)

mounts the studio in another ASGI application, which decides who may use it. The studio's workers
start with the first photo and end with the event loop. Only the command `gauss2svg studio` asks for
a token.
"""

from __future__ import annotations

from functools import cache
from typing import Any


@cache
def __getattr__(name: str) -> Any:
    # The app is created when it is first used, so that this package can be imported without
    # FastAPI.
    if name != "app":
        raise AttributeError(f"module 'gauss2svg.studio' has no attribute {name!r}")
    from gauss2svg.studio.service import create_app

    return create_app()
