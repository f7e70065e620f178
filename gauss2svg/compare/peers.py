"""Peers: other tools that turn a photo into a small file, for the benchmark and galleries.

The package of a peer is imported only in the process that runs the peer. If a peer is a program,
its measured time includes the time that the program takes to start.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.compare.records import start_watch
from gauss2svg.errors import PeerError, quoted
from gauss2svg.files import reason_of
from gauss2svg.processes import end_of, run

Conversion = Callable[[], object]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _output(command: list[str]) -> str:
    """Run a program, and return its standard output. Raise PeerError if it fails."""
    try:
        ended = run(command)
    except OSError as error:
        raise PeerError(f"cannot run {command[0]}: {reason_of(error)}") from error
    if ended.status:
        complaint = ended.complaint or "no message"
        raise PeerError(f"{Path(command[0]).name} {end_of(ended.status)}: {complaint}")
    return ended.output.decode(errors="replace")


class Peer(NamedTuple):
    """A tool other than gauss2svg.

    prepare   function that imports the tool, reads the PNG, and returns a second function, which
              writes the file. Only the time of the second function is measured.
    suffix    suffix of the file. An .svg file is rasterised to compute its scores. Any other file
              is read as an image.
    settings  each item has keyword arguments of `prepare`. By default the benchmark runs the tool
              with every item, and a gallery runs it with the first.
    version   function that returns the installed version, or None if the tool is not installed
    """

    prepare: Callable[..., Conversion]
    suffix: str
    settings: tuple[dict[str, Any], ...]
    version: Callable[[], str | None] = partial(_version, "Pillow")


def _vtracer(png: Path, output: Path, style: str, **changes: Any) -> Conversion:
    import vtracer  # pyright: ignore[reportMissingImports]

    paths = str(png), str(output)
    return lambda: vtracer.convert_image_to_svg_py(*paths, **_VTRACER[style] | changes)


# Environment variable with the path of a second Python, in which vtracer 1.0 is installed. A second
# Python is needed, because vtracer 0.6 and vtracer 1.0 cannot be installed in the same one.
VTRACER1 = "GAUSS2SVG_VTRACER1"
_VTRACER1_STYLES: dict[str, dict[str, Any]] = {
    "default": {},
    "polygon": {"mode": "polygon", "optimize": 2, "path_precision": 0},
    "detailed": {"filter_speckle": 1, "color_precision": 8, "layer_difference": 4},
    "watershed": {
        "clustering": "watershed", "watershed_detail": 512, "optimize": 2, "path_precision": 1,
    },
}  # fmt: skip
_ISOLATED = "-I"  # option with which the other Python ignores PYTHONPATH
_SAY_VERSION = (
    "import importlib.metadata, vtracer\n"
    "vtracer.Config; print(importlib.metadata.version('vtracer'))"
)
_CONVERT = (
    "import json, sys, vtracer\n"
    "vtracer.Config(**json.loads(sys.argv[3])).convert_file(sys.argv[1], sys.argv[2])"
)


def _vtracer1_version() -> str | None:
    if not (python := os.environ.get(VTRACER1)):
        return None
    try:
        return _output([python, _ISOLATED, "-c", _SAY_VERSION]).strip()
    except PeerError as error:
        raise PeerError(
            f"{VTRACER1} must be a Python that has vtracer 1.0; got {quoted(python)}, {error}. "
            "Try to install vtracer==1.0.0a4 in an environment of its own"
        ) from error


def _vtracer1(png: Path, output: Path, style: str) -> Conversion:
    words = [str(png), str(output), json.dumps(_VTRACER1_STYLES[style])]
    return partial(_output, [os.environ[VTRACER1], _ISOLATED, "-c", _CONVERT, *words])


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
    # This setting has the same values as the defaults of splatthis's command line.
    "default": {
        "max_splats": 2000, "stages": [200, 150, 100, 50], "quality_profile": "max-fidelity",
    },
    # With this setting, the image is reduced until its longest side is `side` px, because splatthis
    # would take too long for a larger one. It took 125 CPU seconds for an image of 160 px.
    "fast": {"max_splats": 500, "stages": [60, 40], "quality_profile": "fast", "side": 128},
}  # fmt: skip


def _primitive_version() -> str | None:
    """Return the first digits of a hash of the program, because it does not report its version."""
    path = shutil.which("primitive")
    return path and hashlib.sha256(Path(path).read_bytes()).hexdigest()[:8]


def _primitive(png: Path, output: Path, shapes: int) -> Conversion:
    from PIL import Image

    with Image.open(png) as image:
        side = max(image.size)
    # Mode 7 draws rotated ellipses. Without -s the output is scaled to 1024 px.
    numbers = ["-n", str(shapes), "-m", "7", "-s", str(side)]
    return partial(_output, ["primitive", "-i", str(png), "-o", str(output), *numbers])


def _swag_version() -> str | None:
    if not shutil.which("swag"):
        return None
    return _output(["swag", "--version"]).strip().rpartition(" ")[2]


def _swag(png: Path, output: Path, quality: str) -> Conversion:
    def convert() -> None:
        with tempfile.TemporaryDirectory() as folder:
            words = ["--quality", quality, "--max-edge", "0", "--background", "keep"]
            words += ["--workers", "1", "--no-measure", "--quiet"]
            _output(["swag", str(png), "--out", folder, *words])
            # The program may be another one that is also called swag. It then leaves no SVG in this
            # folder, so the loop does not write `output`, and the run counts as failed.
            for drawing in Path(folder).glob("*.svg"):
                shutil.move(drawing, output)

    return convert


def _neroued(png: Path, output: Path, pipeline: str) -> Conversion:
    import neroued_vectorizer as tracer  # pyright: ignore[reportMissingImports]

    config = tracer.VectorizerConfig()
    config.pipeline_mode = getattr(tracer.PipelineMode, pipeline)
    return lambda: output.write_text(
        tracer.vectorize(str(png), config).svg_content, encoding="utf-8"
    )


def _pillow(format_name: str, png: Path, output: Path, quality: int) -> Conversion:
    from PIL import Image

    with Image.open(png) as image:
        pixels = image.convert("RGB")
    # The first save loads the codec, which must not be part of the measured time.
    pixels.save(io.BytesIO(), format_name, quality=quality)
    return lambda: pixels.save(output, format_name, quality=quality)


def _avif_version() -> str | None:
    """Return the version of the AVIF codec, or None if Pillow was built without it."""
    from PIL import features

    return features.version("avif")


def _settings(name: str, values: Iterable[Any]) -> tuple[dict[str, Any], ...]:
    return tuple({name: value} for value in values)


_QUALITIES = _settings("quality", (10, 30, 60, 90))


PEERS: dict[str, Peer] = {
    "vtracer": Peer(_vtracer, ".svg", _settings("style", _VTRACER), partial(_version, "vtracer")),
    "splatthis": Peer(
        _splatthis, ".svg", _settings("style", _SPLATTHIS), partial(_version, "splatthis")
    ),
    "primitive": Peer(_primitive, ".svg", _settings("shapes", (100, 500)), _primitive_version),
    "vtracer1": Peer(_vtracer1, ".svg", _settings("style", _VTRACER1_STYLES), _vtracer1_version),
    "swag": Peer(_swag, ".svg", _settings("quality", ("fast", "balanced")), _swag_version),
    "neroued": Peer(
        _neroued, ".svg", _settings("pipeline", ("V2",)), partial(_version, "neroued-vectorizer")
    ),
    "jpeg": Peer(partial(_pillow, "JPEG"), ".jpg", _QUALITIES),
    "webp": Peer(partial(_pillow, "WEBP"), ".webp", _QUALITIES),
    "avif": Peer(partial(_pillow, "AVIF"), ".avif", _QUALITIES, _avif_version),
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
