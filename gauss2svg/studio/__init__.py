"""gauss2svg studio: vectorising in a browser, and the service under it.

    application.mount("/studio", gauss2svg.studio.app)

mounts it in one's own ASGI application. Its workers start with the first photo, and end with the
process; who may use it is up to the application. `gauss2svg studio` serves it behind a token.
"""

from __future__ import annotations

from functools import cache
from typing import Any


@cache
def __getattr__(name: str) -> Any:
    # Made on first use: the package imports without FastAPI.
    if name != "app":
        raise AttributeError(f"module 'gauss2svg.studio' has no attribute {name!r}")
    from gauss2svg.studio.service import create_app

    return create_app()
