"""The command `gauss2svg studio`, imported only when it is run."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg.cli.terminal import say
from gauss2svg.errors import InputError


def studio_command(
    folder: Path | None = None,
    *,
    port: int = 8137,
    host: str = "127.0.0.1",
    no_browser: Annotated[bool, Parameter(negative="")] = False,
    jobs: int | None = None,
    threads: int | None = None,
) -> int:
    """Open a page on which this machine vectorises photos. Programs can use the service too.

    Parameters
    ----------
    folder
        Folder whose photos the page offers.
    port
        Port to listen on. 0 takes a free one.
    host
        Address to listen on. Any other than 127.0.0.1 lets other machines in.
    no_browser
        Print the address of the page and open no browser.
    jobs
        Number of photos that are vectorised at the same time. The default depends on the number
        of cores.
    threads
        Number of CPU threads for each photo. By default the photos share the cores.

    """
    for package in ("fastapi", "python_multipart", "uvicorn"):
        if find_spec(package) is None:
            raise InputError(
                f'{package} must be installed for the studio. Try pip install "gauss2svg[studio]"'
            )
    from gauss2svg.studio.service import serve

    serve(folder, host, port, jobs, threads, browser=not no_browser, say=say)
    return 0
