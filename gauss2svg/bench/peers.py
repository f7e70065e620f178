"""Other ways from a photo to a small file. One table; add a peer here to have it everywhere.

Only what a peer needs is imported, and only in the process that runs it.
"""

from __future__ import annotations

import hashlib
import io
import shutil
import subprocess
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from gauss2svg.errors import InputError, PeerError

Work = Callable[[], object]


@dataclass(frozen=True)
class Peer:
    """Another tool.

    version   of what is installed, None where it is not
    prepare   imports the tool and reads the PNG, and returns the work that is timed: to
              write the file
    suffix    of the file: .svg is drawn to be scored, anything else is read as a picture
    settings  what is tried: keywords of prepare
    """

    version: Callable[[], str | None]
    prepare: Callable[..., Work]
    suffix: str
    settings: tuple[dict[str, Any], ...]


def _package(name: str) -> Callable[[], str | None]:
    def find() -> str | None:
        try:
            return version(name)
        except PackageNotFoundError:
            return None

    return find


def _vtracer(png: Path, drawn: Path, style: str, **changes: Any) -> Work:
    import vtracer  # pyright: ignore[reportMissingImports]

    options = _VTRACER_STYLES[style] | changes
    return lambda: vtracer.convert_image_to_svg_py(str(png), str(drawn), **options)


_VTRACER_STYLES: dict[str, dict[str, Any]] = {
    "default": {},
    "polygon": {
        "mode": "polygon", "path_precision": 0, "filter_speckle": 4, "layer_difference": 16,
    },
    "detailed": {"filter_speckle": 1, "color_precision": 8, "layer_difference": 4},
}  # fmt: skip


def _splatthis(png: Path, drawn: Path, style: str) -> Work:
    from PIL import Image
    from splatthis import SplatConverter  # pyright: ignore[reportMissingImports]

    options = dict(_SPLATTHIS_STYLES[style])
    if side := options.pop("side", None):
        with Image.open(png) as picture:
            shrunk = min(1.0, side / max(picture.size))
            options["target_size"] = tuple(max(1, round(s * shrunk)) for s in picture.size)
    converter = SplatConverter(device="cpu", seed=0, **options)
    return lambda: converter.convert(str(png), str(drawn), output_format="svg")


_SPLATTHIS_STYLES: dict[str, dict[str, Any]] = {
    # At 160 px it took 125 CPU seconds: larger pictures would only time out.
    "fast": {"max_splats": 500, "stages": [60, 40], "quality_profile": "fast", "side": 128},
    # What its command line does without options.
    "default": {
        "max_splats": 2000, "stages": [200, 150, 100, 50], "quality_profile": "max-fidelity",
    },
}  # fmt: skip


def _primitive_version() -> str | None:
    """First digits of the binary's hash: it does not know its own version."""
    found = shutil.which("primitive")
    return found and hashlib.sha256(Path(found).read_bytes()).hexdigest()[:8]


def _primitive(png: Path, drawn: Path, shapes: int) -> Work:
    from PIL import Image

    with Image.open(png) as picture:
        side = max(picture.size)
    # Mode 7 is rotated ellipses; the output is scaled to 1024 px unless told.
    command = ["primitive", "-i", str(png), "-o", str(drawn), "-n", str(shapes), "-m", "7"]
    command += ["-s", str(side)]

    def work() -> None:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise PeerError(f"primitive ended with status {done.returncode}: {done.stderr}")

    return work


def _pillow(format_name: str) -> Callable[..., Work]:
    def prepare(png: Path, drawn: Path, quality: int) -> Work:
        from PIL import Image

        with Image.open(png) as picture:
            pixels = picture.convert("RGB")
        pixels.save(io.BytesIO(), format_name, quality=quality)  # loads the codec

        return lambda: pixels.save(drawn, format_name, quality=quality)

    return prepare


_RASTER_QUALITIES = tuple({"quality": quality} for quality in (10, 30, 60, 90))

PEERS: dict[str, Peer] = {
    "vtracer": Peer(
        _package("vtracer"), _vtracer, ".svg", tuple({"style": s} for s in _VTRACER_STYLES)
    ),
    "splatthis": Peer(
        _package("splatthis"), _splatthis, ".svg", tuple({"style": s} for s in _SPLATTHIS_STYLES)
    ),
    "primitive": Peer(_primitive_version, _primitive, ".svg", ({"shapes": 100}, {"shapes": 500})),
    "jpeg": Peer(_package("Pillow"), _pillow("JPEG"), ".jpg", _RASTER_QUALITIES),
    "webp": Peer(_package("Pillow"), _pillow("WEBP"), ".webp", _RASTER_QUALITIES),
}


def check_peers(names: Iterable[str]) -> tuple[list[str], list[str]]:
    """Those of the names that are installed and those that are not, each once.

    Raises InputError for a name that is no peer's.
    """
    wanted = list(dict.fromkeys(names))
    for name in wanted:
        if name not in PEERS:
            raise InputError(f"peer is {name!r}; needed is one of {', '.join(PEERS)}")
    absent = [name for name in wanted if PEERS[name].version() is None]
    return [name for name in wanted if name not in absent], absent
