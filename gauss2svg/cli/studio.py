"""The command `gauss2svg studio`, imported only when it is run."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

from gauss2svg.cli.terminal import say
from gauss2svg.errors import InputError
from gauss2svg.options import Interval, OptionGroup, file_path


@dataclass(frozen=True, kw_only=True)
class StudioOptions(OptionGroup):
    """Arguments of the command."""

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


SECTIONS = {"Parameters": StudioOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    for package in ("fastapi", "python_multipart", "uvicorn"):
        if find_spec(package) is None:
            raise InputError(
                f'{package} must be installed for the studio. Try pip install "gauss2svg[studio]"'
            )
    from gauss2svg.studio.service import serve

    options = StudioOptions.of(given)
    serve(
        options.folder, options.host, options.port, options.jobs, options.threads,
        browser=not options.no_browser, say=say,
    )  # fmt: skip
    return 0
