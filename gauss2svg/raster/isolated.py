"""Rasterise an untrusted SVG in a separate process: `python -m gauss2svg.raster.isolated`.

An SVG with deeply nested groups overflows the stack of resvg, which ends the process. An SVG with
nested patterns can keep any renderer busy for years. In a separate process whose time and memory
are limited, both cases become ordinary errors.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import Gauss2SvgError, RendererError
from gauss2svg.processes import end_of, module_command, python_environment, run
from gauss2svg.raster import rasterize_sized, renderers

_REFUSED = 2  # exit status which says that standard error has a message for the user
# Matches a message of resvg on a value or on CSS that it cannot read. Messages on fonts do not
# match, because resvg gets none, and neither do those on media and states such as :hover, which a
# still picture seldom has.
_MESSAGE = re.compile(
    r"^Warning \(.*?\): (?!.*(?:font|@media|:(?:hover|active|focus|visited|target)\b))"
    r"(?:Failed to \w+ |The )?(.*? value: '.*?'|a \w+ image|@[\w-]+ rule|':[\w-]+'|Selector .*)",
    re.MULTILINE,
)


class Drawing(NamedTuple):
    """The raster of an SVG, and what resvg says that it cannot read.

    pixels  (height, width, channels) float32 in 0..1
    unread  parts of the SVG, each of them once, such as "fill value: 'oklch(.6 .2 30)'". Other
            renderers say nothing
    """

    pixels: NDArray[np.float32]
    unread: list[str]


def draw(
    svg: str, width: int, height: int, renderer: str, timeout_s: float, channels: int = 3
) -> Drawing:
    """Return the raster of an SVG.

    With 3 channels the raster is over white. With 4 channels it has straight alpha. Raise
    RendererError if the renderer cannot draw the SVG, crashes, or takes more than timeout_s
    seconds.
    """
    words = str(width), str(height), renderer, str(channels)
    try:
        ended = run(
            module_command("gauss2svg.raster.isolated", *words),
            svg.encode(),
            timeout_s=timeout_s,
            environment=python_environment(),
        )
    except TimeoutError as error:
        raise RendererError(
            f"{renderer} has not drawn the SVG in {timeout_s:g} s. Try a longer "
            "--draw-timeout, or another --renderer"
        ) from error
    if ended.status:
        crash = (
            f"{renderer} crashed on the SVG ({end_of(ended.status)}). Try groups that are nested "
            "less deeply, or another --renderer"
        )
        raise RendererError(ended.complaint if ended.status == _REFUSED else crash)
    count = height * width * channels
    pixels = np.frombuffer(ended.output, np.float32, count).reshape(height, width, channels)
    messages = ended.output[pixels.nbytes :].decode(errors="replace")
    unread = dict.fromkeys(message[:80] for message in _MESSAGE.findall(messages))
    return Drawing(pixels, list(unread))


def main() -> int:
    """Read an SVG from standard input, and write its pixels to standard output as float32.

    Behind the pixels are the first messages that a library prints to standard output.
    """
    width, height, renderer = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    renderers.resvg_prints = True
    # On Linux, the process may take 4 GiB of memory, plus 64 bytes for each pixel of the raster.
    _limit_memory((4 << 30) + 64 * width * height)
    with os.fdopen(os.dup(1), "wb") as answer, tempfile.TemporaryFile() as messages:
        # From here on, a text that a library prints to standard output goes to a file. So no such
        # text can get between the pixels.
        os.dup2(messages.fileno(), 1)
        try:
            svg = sys.stdin.buffer.read().decode()
            pixels = rasterize_sized(svg, width, height, renderer, sys.argv[4:] == ["4"])
        except Exception as error:
            message = f"{renderer} cannot draw the SVG: {type(error).__name__}: {error}"  # a bug
            if isinstance(error, Gauss2SvgError):
                message = str(error)
            elif isinstance(error, MemoryError):
                message = f"{renderer} is out of memory. Try a smaller or simpler SVG"
            print(" ".join(message.split()), file=sys.stderr)
            return _REFUSED
        answer.write(np.ascontiguousarray(pixels, np.float32).data)
        messages.seek(0)
        answer.write(messages.read(100_000))
    return 0


def _limit_memory(limit: int) -> None:
    """Limit this process, and each process that it starts, to `limit` bytes of memory."""
    try:
        import resource
    except ImportError:  # there is no such module on Windows
        return
    # RLIMIT_AS is not used, because it limits the address space, of which browsers reserve
    # terabytes.
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


if __name__ == "__main__":
    sys.exit(main())
