"""Records of runs: their numbers, errors and costs, the machine, and other tools.

Another tool is a peer. A process that runs a peer imports this module and the package of the peer,
but no large package, so that the memory of the process is that of the peer.
"""

from __future__ import annotations

import io
import json
import os
import platform
import re
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.measure import SCORES

Row = dict[str, Any]
TOOL = "gauss2svg"  # value of "tool" in the records of gauss2svg itself
# {key of a report: what it counts}
COUNTS = {
    "area_count": "Areas", "line_count": "Lines", "node_count": "Nodes", "gaussians": "Gaussians",
}  # fmt: skip
COSTS = ("total_s", "cpu_s", "peak_bytes")  # keys of start_watch
# Keys that a record of the benchmark has of any file.
FILE_KEYS = (
    *COSTS, "width", "height", "renderer", "psnr_model", *(score.key for score in SCORES),
    "hue_error_svg", "hue_error_999_svg", "svg_bytes", "svgz_bytes",
)  # fmt: skip
# Further keys, whose values are None in the records of other tools.
OWN_KEYS = (
    "fit_width", "fit_height", "iterations", "rounds", "stop_reason", "threads",
    "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs",
)  # fmt: skip


def json_safe(value: Any) -> Any:
    """Return a value in the form that it has after it is written as JSON and read again.

    Infinity and NaN become None, because JSON does not have them.
    """
    return json.loads(json.dumps(value), parse_constant=lambda _: None)


def start_watch() -> Callable[[], dict[str, Any]]:
    """Start to measure costs. Return a function that returns the costs from then until its call.

    total_s     wall-clock seconds
    cpu_s       CPU seconds of this process and its children
    peak_bytes  largest memory that this process has held since it started, even before this call,
                or that a child has held. None if it is unknown
    """
    wall, cpu = time.perf_counter(), _cpu_s()
    return lambda: {
        "total_s": time.perf_counter() - wall, "cpu_s": _cpu_s() - cpu, "peak_bytes": _peak_bytes()
    }  # fmt: skip


def _cpu_s() -> float:
    children = os.times()
    return time.process_time() + children.children_user + children.children_system


def _peak_bytes() -> int | None:
    try:
        import resource
    except ImportError:  # Windows has no module `resource`
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit
    if peak := _from_proc("self/status", "VmHWM").removesuffix(" kB"):
        # On Linux, ru_maxrss of this process may be the peak of its parent, so VmHWM is read.
        return max(int(peak) * 1024, children)
    return max(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit, children)


def machine() -> dict[str, Any]:
    """Return the CPU model, the number of usable cores and the platform."""
    from gauss2svg.render.cpu import CORES  # imports NumPy, whose memory is none of a peer

    cpu = _from_proc("cpuinfo", "model name") or platform.processor() or platform.machine()
    return {"cpu": cpu, "cores": CORES, "platform": platform.platform()}


def _from_proc(file: str, name: str) -> str:
    """Return the first value after "name:" in a file of /proc, or "" if there is none."""
    try:
        text = Path("/proc", file).read_text(encoding="utf-8")
    except OSError:
        return ""
    values = re.findall(rf"^{name}[\t ]*:[\t ]*(.*?)[\t ]*$", text, re.MULTILINE)
    return values[0] if values else ""


class Peer(NamedTuple):
    """A tool other than gauss2svg.

    prepare   function that imports the tool, reads the PNG, and returns a second function, which
              writes the file. Only the time of the second function is measured.
    suffix    suffix of the file
    settings  each item has keyword arguments of `prepare`. By default the benchmark runs the tool
              with every item, and a gallery runs it with the first.
    package   package of the tool, as PyPI names it
    """

    prepare: Callable[..., Callable[[], object]]
    suffix: str
    settings: tuple[dict[str, Any], ...]
    package: str = "Pillow"

    @property
    def version(self) -> str | None:
        """The installed version, or None if the tool is not installed."""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return None


def _vtracer(png: Path, output: Path, style: str, **changes: Any) -> Callable[[], object]:
    import vtracer  # pyright: ignore[reportMissingImports]

    paths = str(png), str(output)
    return lambda: vtracer.convert_image_to_svg_py(*paths, **_VTRACER[style] | changes)


_VTRACER: dict[str, dict[str, Any]] = {
    "default": {},
    "polygon": {
        "mode": "polygon", "path_precision": 0, "filter_speckle": 4, "layer_difference": 16,
    },
    "detailed": {"filter_speckle": 1, "color_precision": 8, "layer_difference": 4},
}  # fmt: skip


def _pillow(format_name: str, png: Path, output: Path, quality: int) -> Callable[[], object]:
    from PIL import Image

    with Image.open(png) as image:
        pixels = image.convert("RGB")
    # The first save loads the codec, which must not be part of the measured time.
    pixels.save(io.BytesIO(), format_name, quality=quality)
    return lambda: pixels.save(output, format_name, quality=quality)


_QUALITIES = tuple({"quality": quality} for quality in (10, 30, 60, 90))
PEERS: dict[str, Peer] = {
    "vtracer": Peer(_vtracer, ".svg", tuple({"style": style} for style in _VTRACER), "vtracer"),
    "jpeg": Peer(partial(_pillow, "JPEG"), ".jpg", _QUALITIES),
    "webp": Peer(partial(_pillow, "WEBP"), ".webp", _QUALITIES),
    "avif": Peer(partial(_pillow, "AVIF"), ".avif", _QUALITIES),
}


def convert_by(tool: str, settings: dict[str, Any], png: Path, output: Path) -> dict[str, Any]:
    """Write the file of a peer, and return its cost.

    Call this in a process of its own, because it silences standard output and standard error.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(null, stream)
    convert = PEERS[tool].prepare(png, output, **settings)
    cost = start_watch()
    convert()
    return cost()
