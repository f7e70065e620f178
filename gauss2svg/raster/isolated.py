"""Rasterise an untrusted SVG in a separate process.

An SVG with deeply nested groups overflows the stack of resvg, which ends the process. An SVG with
nested patterns can keep any renderer busy for years. In a separate process whose time and memory
are limited, both cases become ordinary errors.
"""

from __future__ import annotations

import os
import re
import tempfile

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.pool import Pool, WorkerDiedError
from gauss2svg.raster import rasterize_sized, renderers

# Matches a message of resvg on a value or on CSS that it cannot read. Messages on fonts do not
# match, because resvg gets none, and neither do those on media and states such as :hover, which a
# still picture seldom has.
_MESSAGE = re.compile(
    r"^Warning \(.*?\): (?!.*(?:font|@media|:(?:hover|active|focus|visited|target)\b))"
    r"(?:Failed to \w+ |The )?(.*? value: '.*?'|a \w+ image|@[\w-]+ rule|':[\w-]+'|Selector .*)",
    re.MULTILINE,
)


# The raster (height, width, channels) of an SVG, float32 in 0..1, and what resvg says that it
# cannot read: parts of the SVG, each of them once, such as "fill value: 'oklch(.6 .2 30)'". Other
# renderers say nothing.
Drawing = tuple[NDArray[np.float32], list[str]]


def draw(
    svg: str, width: int, height: int, renderer: str, timeout_s: float, channels: int = 3
) -> Drawing:
    """Return the raster of an SVG, and what resvg cannot read of it.

    With 3 channels the raster is over white. With 4 channels it has straight alpha. Raise
    RendererError if the renderer cannot draw the SVG, crashes, or takes more than timeout_s
    seconds.
    """
    size = width, height
    with Pool(1) as pool:
        job = pool.submit(_drawn, svg, *size, renderer, channels == 4, timeout=timeout_s)
        try:
            return job.result()
        except TimeoutError as error:
            raise RendererError(
                f"{renderer} has not drawn the SVG in {timeout_s:g} s. Try a longer "
                "--draw-timeout, or another --renderer"
            ) from error
        except WorkerDiedError as error:
            raise RendererError(
                f"{renderer} crashed on the SVG ({error}). Try groups that are nested less "
                "deeply, or another --renderer"
            ) from error
        except MemoryError as error:
            raise RendererError(
                f"{renderer} is out of memory. Try a smaller or simpler SVG"
            ) from error


def _drawn(svg: str, width: int, height: int, renderer: str, alpha: bool) -> Drawing:
    """Return what `draw` returns, in the process that is only for this SVG."""
    # On Linux, the process may take 4 GiB of memory, plus 64 bytes for each pixel of the raster.
    _limit_memory((4 << 30) + 64 * width * height)
    renderers.resvg_prints = True
    with tempfile.TemporaryFile() as messages:
        # What libraries print is not for the user.
        for stream in (1, 2):
            os.dup2(messages.fileno(), stream)
        pixels = rasterize_sized(svg, width, height, renderer, alpha)
        messages.seek(0)
        printed = messages.read(100_000).decode(errors="replace")
    unread = dict.fromkeys(message[:80] for message in _MESSAGE.findall(printed))
    return pixels, list(unread)


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
