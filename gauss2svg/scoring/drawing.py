"""Draws an untrusted SVG in a process of its own: `python -m gauss2svg.scoring.drawing`.

Deep nesting overflows resvg's stack, which ends the process, and patterns within patterns
keep any renderer busy for years; here both are errors like others.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import Gauss2SvgError, RendererError
from gauss2svg.raster import rasterize

_REFUSED = 2


def draw(svg: str, width: int, height: int, renderer: str, timeout_s: float) -> NDArray[np.float32]:
    """What `rasterize` returns; a crash and more than timeout_s seconds are RendererErrors."""
    command = [sys.executable, "-P", "-m", "gauss2svg.scoring.drawing"]
    # What this process can import, and in -P nothing that happens to lie in the current folder.
    path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path)
    try:
        done = subprocess.run(
            [*command, str(width), str(height), renderer],
            input=svg.encode(),
            capture_output=True,
            timeout=timeout_s,
            check=False,
            env={**os.environ, "PYTHONPATH": path},
        )
    except subprocess.TimeoutExpired as error:
        raise RendererError(
            f"{renderer} has not drawn the SVG in {timeout_s:g} s; give a longer --draw-timeout, "
            "or try another --renderer"
        ) from error
    if done.returncode < 0:
        raise RendererError(
            f"{renderer} crashed on the SVG ({signal.Signals(-done.returncode).name}); nest its "
            "groups less deeply, or try another --renderer"
        )
    if done.returncode:
        said = done.stderr[-4000:].decode(errors="replace").strip().splitlines()
        raise RendererError(said[-1] if said else f"{renderer} cannot draw the SVG")
    return np.frombuffer(done.stdout, np.float32).reshape(height, width, 3)


def main() -> int:
    """Read the SVG from standard input, write its pixels to standard output as float32."""
    width, height, renderer = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    answer = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a library may chat; the pixels are all that goes to standard output
    try:
        pixels = rasterize(sys.stdin.buffer.read().decode(), width, height, renderer)
    except (Gauss2SvgError, MemoryError) as error:
        print(" ".join((str(error) or "out of memory").split()), file=sys.stderr)
        return _REFUSED
    with answer:
        answer.write(np.ascontiguousarray(pixels, np.float32).data)
    return 0


if __name__ == "__main__":
    sys.exit(main())
