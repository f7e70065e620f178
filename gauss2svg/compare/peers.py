"""Other tools that turn a photo into a small file: one table for the benchmark and the gallery.

A peer's package is imported only in the process that runs it.
"""

from __future__ import annotations

import hashlib
import io
import os
import shutil
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from gauss2svg.compare.machine import Stopwatch, peak_bytes
from gauss2svg.compare.records import answered
from gauss2svg.errors import InputError, PeerError, quoted
from gauss2svg.processes import end_of, run

Conversion = Callable[[], object]


@dataclass(frozen=True)
class Peer:
    """Another tool.

    version   installed version; None where the tool is not installed
    prepare   imports the tool, reads the PNG, and returns the function whose time is measured:
              it writes the file
    suffix    of the file; an .svg is rasterised to be scored, others are read as images
    settings  keywords of prepare that the benchmark tries
    """

    version: Callable[[], str | None]
    prepare: Callable[..., Conversion]
    suffix: str
    settings: tuple[dict[str, Any], ...]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _vtracer(png: Path, output: Path, style: str, **changes: Any) -> Conversion:
    import vtracer  # pyright: ignore[reportMissingImports]

    options = _VTRACER_STYLES[style] | changes
    return lambda: vtracer.convert_image_to_svg_py(str(png), str(output), **options)


_VTRACER_STYLES: dict[str, dict[str, Any]] = {
    "default": {},
    "polygon": {
        "mode": "polygon", "path_precision": 0, "filter_speckle": 4, "layer_difference": 16,
    },
    "detailed": {"filter_speckle": 1, "color_precision": 8, "layer_difference": 4},
}  # fmt: skip


def _splatthis(png: Path, output: Path, style: str) -> Conversion:
    from PIL import Image
    from splatthis import SplatConverter  # pyright: ignore[reportMissingImports]

    options = dict(_SPLATTHIS_STYLES[style])
    if side := options.pop("side", None):
        with Image.open(png) as image:
            shrunk = min(1.0, side / max(image.size))
            options["target_size"] = tuple(max(1, round(s * shrunk)) for s in image.size)
    converter = SplatConverter(device="cpu", seed=0, **options)
    return lambda: converter.convert(str(png), str(output), output_format="svg")


_SPLATTHIS_STYLES: dict[str, dict[str, Any]] = {
    # 160 px took 125 CPU seconds: larger images would only time out.
    "fast": {"max_splats": 500, "stages": [60, 40], "quality_profile": "fast", "side": 128},
    # The defaults of its command line.
    "default": {
        "max_splats": 2000, "stages": [200, 150, 100, 50], "quality_profile": "max-fidelity",
    },
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
    command = ["primitive", "-i", str(png), "-o", str(output), "-n", str(shapes), "-m", "7"]
    command += ["-s", str(side)]

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
    """That of the codec, which Pillow has from 11.3 on where it was built with it."""
    from PIL import features

    return features.version("avif") if "avif" in features.get_supported() else None


_PILLOW = partial(_version, "Pillow")
_RASTER_QUALITIES = tuple({"quality": quality} for quality in (10, 30, 60, 90))

PEERS: dict[str, Peer] = {
    "vtracer": Peer(
        partial(_version, "vtracer"), _vtracer, ".svg", tuple({"style": s} for s in _VTRACER_STYLES)
    ),
    "splatthis": Peer(
        partial(_version, "splatthis"),
        _splatthis,
        ".svg",
        tuple({"style": s} for s in _SPLATTHIS_STYLES),
    ),
    "primitive": Peer(_primitive_version, _primitive, ".svg", ({"shapes": 100}, {"shapes": 500})),
    "jpeg": Peer(_PILLOW, partial(_pillow, "JPEG"), ".jpg", _RASTER_QUALITIES),
    "webp": Peer(_PILLOW, partial(_pillow, "WEBP"), ".webp", _RASTER_QUALITIES),
    "avif": Peer(_avif_version, partial(_pillow, "AVIF"), ".avif", _RASTER_QUALITIES),
}


def check_peers(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Installed and absent ones of these peers, each once; InputError for an unknown one."""
    wanted = list(dict.fromkeys(names))
    for name in wanted:
        if name not in PEERS:
            raise InputError(f"peer must be one of {', '.join(PEERS)}; got {quoted(name)}")
    absent = [name for name in wanted if PEERS[name].version() is None]
    return [name for name in wanted if name not in absent], absent


def converted(tool: str, settings: dict[str, Any], png: Path, output: Path) -> dict[str, Any]:
    """Write the file of a tool and return what it took, or {"error": line}.

    It is called in a process of its own.
    """
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):  # of the tool, which may print
        os.dup2(null, stream)
    return answered(_converted, {"tool": tool, "paths": (png, output), "settings": settings})


def _converted(request: Mapping[str, Any]) -> dict[str, Any]:
    convert = PEERS[request["tool"]].prepare(*request["paths"], **request["settings"])
    watch = Stopwatch()
    convert()
    return watch.read() | {"peak_bytes": peak_bytes()}
