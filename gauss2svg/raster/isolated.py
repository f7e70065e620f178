"""Rasterises an untrusted SVG in a process of its own: `python -m gauss2svg.raster.isolated`.

Deep nesting overflows resvg's stack, which ends the process, and nested patterns keep any renderer
busy for years. In a process of its own, whose memory is limited, both become ordinary errors.
"""

from __future__ import annotations

import os
import sys

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import Gauss2SvgError, RendererError
from gauss2svg.photo.alpha import over
from gauss2svg.processes import end_of, module_command, module_path, run
from gauss2svg.raster import rasterize_sized

_REFUSED = 2
_MOST_BYTES, _BYTES_A_PIXEL = 4 << 30, 64  # of memory that a drawing may take, on Linux


def draw(
    svg: str, width: int, height: int, renderer: str, timeout_s: float, channels: int = 3
) -> NDArray[np.float32]:
    """Raster of an SVG, as by `rasterize_sized`, over white for 3 channels.

    Raises RendererError also for a crash and after timeout_s seconds.
    """
    words = str(width), str(height), renderer, str(channels)
    try:
        ended = run(
            module_command("gauss2svg.raster.isolated", *words),
            svg.encode(),
            timeout_s=timeout_s,
            environment=module_path(),
        )
    except TimeoutError as error:
        raise RendererError(
            f"{renderer} has not drawn the SVG in {timeout_s:g} s. Try a longer "
            "--draw-timeout, or another --renderer"
        ) from error
    if ended.status == _REFUSED:
        raise RendererError(ended.complaint)
    if ended.status:
        raise RendererError(
            f"{renderer} crashed on the SVG ({end_of(ended.status)}). Try groups that are nested "
            "less deeply, or another --renderer"
        )
    return np.frombuffer(ended.output, np.float32).reshape(height, width, channels)


def main() -> int:
    """Read the SVG from standard input, write its pixels to standard output as float32."""
    width, height, renderer = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # libraries may print; standard output is for the pixels only
    clear = sys.argv[4:] == ["4"]
    _limit_memory(_MOST_BYTES + _BYTES_A_PIXEL * width * height)
    try:
        svg = sys.stdin.buffer.read().decode()
        pixels = rasterize_sized(svg, width, height, renderer, clear)
        pixels = pixels if clear else over(pixels)
    except Gauss2SvgError as error:
        return _refuse(str(error))
    except MemoryError:
        return _refuse(f"{renderer} is out of memory. Try a smaller or simpler SVG")
    except Exception as error:  # a bug here or in a library; its class tells the cause
        return _refuse(f"{renderer} cannot draw the SVG: {type(error).__name__}: {error}")
    with answer:
        answer.write(np.ascontiguousarray(pixels, np.float32).data)
    return 0


def _limit_memory(most: int) -> None:
    """Limit the memory of this process, and of each that it starts."""
    try:
        import resource
    except ImportError:  # Windows
        return
    # Not addresses, of which browsers reserve terabytes.
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _refuse(message: str) -> int:
    print(" ".join(message.split()), file=sys.stderr)
    return _REFUSED


if __name__ == "__main__":
    sys.exit(main())
