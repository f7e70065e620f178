"""The command `gauss2svg studio`, imported only where it is run."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg.cli.streams import say
from gauss2svg.errors import InputError


def studio_command(
    folder: Annotated[
        Path | None, Parameter(help="Folder whose photos can be picked on the page.")
    ] = None,
    *,
    port: Annotated[int, Parameter(help="Port; 0 takes a free one.")] = 8137,
    host: Annotated[
        str, Parameter(help="Address to listen on; others than 127.0.0.1 let others in.")
    ] = "127.0.0.1",
    no_browser: Annotated[
        bool, Parameter(negative="", help="Print the address, and open no browser.")
    ] = False,
    jobs: Annotated[
        int | None, Parameter(help="Fits at once; by the number of cores if not given.")
    ] = None,
    threads: Annotated[
        int | None, Parameter(help="Threads of each fit; the cores shared out if not given.")
    ] = None,
) -> int:
    """Vectorise photos in the browser: a page of this machine's, and the service under it."""
    try:
        import fastapi  # noqa: F401
        import python_multipart  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"the studio needs packages that are not installed ({error.name}). "
            'Try pip install "gauss2svg[studio]"'
        ) from error
    from gauss2svg.studio.server import serve

    serve(folder, host, port, jobs, threads, browser=not no_browser, say=say)
    return 0
