"""The command `gauss2svg studio`, imported only when it is run."""

from importlib.util import find_spec
from typing import Any

from gauss2svg.cli.terminal import say
from gauss2svg.errors import InputError
from gauss2svg.studio import StudioOptions

SECTIONS = {"Parameters": StudioOptions}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    for package in ("fastapi", "python_multipart", "uvicorn"):
        if find_spec(package) is None:
            raise InputError(
                f'{package} must be installed for the studio. Try pip install "gauss2svg[studio]"'
            )
    from gauss2svg.studio.service import serve

    serve(StudioOptions.of(given), say)
    return 0
