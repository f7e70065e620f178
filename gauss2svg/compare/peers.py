"""Other tools that turn a photo into a small file: one table for the benchmark and the gallery.

A peer's package is imported only in the process that runs it.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.compare.records import started_watch
from gauss2svg.errors import PeerError
from gauss2svg.processes import end_of, run

Conversion = Callable[[], object]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


class Peer(NamedTuple):
    """Another tool.

    prepare   imports the tool, reads the PNG, and returns the function whose time is measured:
              it writes the file
    suffix    of the file; an .svg is rasterised to be scored, others are read as images
    settings  keywords of prepare that the benchmark tries, first what a gallery has by default
    version   installed version; None where the tool is not installed
    """

    prepare: Callable[..., Conversion]
    suffix: str
    settings: tuple[dict[str, Any], ...]
    version: Callable[[], str | None] = partial(_version, "Pillow")


def _vtracer(png: Path, output: Path, style: str, **changes: Any) -> Conversion:
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


def _splatthis(png: Path, output: Path, style: str) -> Conversion:
    from PIL import Image
    from splatthis import SplatConverter  # pyright: ignore[reportMissingImports]

    options = dict(_SPLATTHIS[style])
    if side := options.pop("side", None):
        with Image.open(png) as image:
            image.thumbnail((side, side))
        options["target_size"] = image.size
    converter = SplatConverter(device="cpu", seed=0, **options)
    return lambda: converter.convert(str(png), str(output), output_format="svg")


_SPLATTHIS: dict[str, dict[str, Any]] = {
    # The defaults of its command line.
    "default": {
        "max_splats": 2000, "stages": [200, 150, 100, 50], "quality_profile": "max-fidelity",
    },
    # 160 px took 125 CPU seconds: larger images would only time out.
    "fast": {"max_splats": 500, "stages": [60, 40], "quality_profile": "fast", "side": 128},
}  # fmt: skip


def _primitive_version() -> str | None:
    """First digits of the binary's hash, for it does not report a version."""
    found = shutil.which("primitive")
    return found and hashlib.sha256(Path(found).read_bytes()).hexdigest()[:8]


def _primitive(png: Path, output: Path, shapes: int) -> Conversion:
    from PIL import Image

    with Image.open(png) as image:
        side = max(image.size)
    # Mode 7 is rotated ellipses; without -s the output is scaled to 1024 px.
    numbers = ["-n", str(shapes), "-m", "7", "-s", str(side)]
    command = ["primitive", "-i", str(png), "-o", str(output), *numbers]

    def convert() -> None:
        ended = run(command)
        if ended.status:
            raise PeerError(f"primitive {end_of(ended.status)}: {ended.complaint or 'no message'}")

    return convert


def _pillow(format_name: str, png: Path, output: Path, quality: int) -> Conversion:
    from PIL import Image

    with Image.open(png) as image:
        pixels = image.convert("RGB")
    pixels.save(io.BytesIO(), format_name, quality=quality)  # loads the codec
    return lambda: pixels.save(output, format_name, quality=quality)


def _avif_version() -> str | None:
    """Return the version of the codec, which Pillow may be built without."""
    from PIL import features

    return features.version("avif")


def _each(name: str, values: Iterable[Any]) -> tuple[dict[str, Any], ...]:
    return tuple({name: value} for value in values)


_QUALITIES = _each("quality", (10, 30, 60, 90))


PEERS: dict[str, Peer] = {
    "vtracer": Peer(_vtracer, ".svg", _each("style", _VTRACER), partial(_version, "vtracer")),
    "splatthis": Peer(
        _splatthis, ".svg", _each("style", _SPLATTHIS), partial(_version, "splatthis")
    ),
    "primitive": Peer(_primitive, ".svg", _each("shapes", (100, 500)), _primitive_version),
    "jpeg": Peer(partial(_pillow, "JPEG"), ".jpg", _QUALITIES),
    "webp": Peer(partial(_pillow, "WEBP"), ".webp", _QUALITIES),
    "avif": Peer(partial(_pillow, "AVIF"), ".avif", _QUALITIES, _avif_version),
}


def converted(tool: str, settings: dict[str, Any], png: Path, output: Path) -> dict[str, Any]:
    """Write the file of a tool and return what it took, in a process of its own."""
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):  # of the tool, which may print
        os.dup2(null, stream)
    convert = PEERS[tool].prepare(png, output, **settings)
    cost = started_watch()
    convert()
    return cost()
