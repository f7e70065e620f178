"""The command `gauss2svg studio`, imported only where it is run."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg.cli.streams import say
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
    """Vectorise photos in the browser: a page of this machine's, and the service under it.

    Parameters
    ----------
    folder
        Folder whose photos can be picked on the page.
    port
        Port; 0 takes a free one.
    host
        Address to listen on; others than 127.0.0.1 let others in.
    no_browser
        Print the address, and open no browser.
    jobs
        Fits at once; by the number of cores if not given.
    threads
        Threads of each fit; the cores shared out if not given.

    """
    for package in ("fastapi", "python_multipart", "uvicorn"):
        if find_spec(package) is None:
            raise InputError(
                f"the studio needs packages that are not installed ({package}). "
                'Try pip install "gauss2svg[studio]"'
            )
    from gauss2svg.studio.server import serve

    serve(folder, host, port, jobs, threads, browser=not no_browser, say=say)
    return 0
