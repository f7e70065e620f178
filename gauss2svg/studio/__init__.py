"""gauss2svg studio: a web page on which users vectorise photos, and the service behind it.

    application.mount("/studio", gauss2svg.studio.app)

mounts the studio in another ASGI application, which decides who may use it. The studio's workers
start with the first photo and end with the event loop. Only the command `gauss2svg studio` asks for
a token.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from gauss2svg.options import Interval, OptionGroup, file_path


@dataclass(frozen=True, kw_only=True)
class StudioOptions(OptionGroup):
    """Options of the studio's server."""

    folder: Annotated[Path | None, file_path] = None
    """Folder whose photos the page offers."""

    port: Annotated[int, Interval(ge=0, le=65535)] = 8137
    """Port to listen on. 0 takes a free one."""

    host: str = "127.0.0.1"
    """Address to listen on. Any other than 127.0.0.1 lets other machines in."""

    no_browser: bool = False
    """Print the address of the page and open no browser."""

    jobs: Annotated[int | None, Interval(ge=1)] = None
    """Number of photos that are vectorised at the same time. The default depends on the number of
    cores."""

    threads: Annotated[int | None, Interval(ge=1)] = None
    """Number of CPU threads for each photo. By default the photos share the cores."""


@cache
def __getattr__(name: str) -> Any:
    # The app is created when it is first used, so that this package can be imported without
    # FastAPI.
    if name != "app":
        raise AttributeError(f"module 'gauss2svg.studio' has no attribute {name!r}")
    from gauss2svg.studio.service import create_app

    return create_app()
