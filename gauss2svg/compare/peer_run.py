"""A run of another tool: in a process of its own, its file measured as those of our own are."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.records import finite
from gauss2svg.compare.worker import in_own_process
from gauss2svg.errors import PeerError, RendererError
from gauss2svg.files import as_png
from gauss2svg.measure.check import check
from gauss2svg.measure.perceptual import perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.load import WHITE, load_image

_MEASURED = (
    "width", "height", "renderer", "psnr_model", *(score.key for score in SCORES),
    "psnr_svg_enlarged", "svg_bytes", "svgz_bytes",
)  # fmt: skip


def peer_file(
    tool: str, settings: Mapping[str, Any], photo: NDArray[np.float32], timeout: float
) -> tuple[bytes, dict[str, Any]]:
    """The file that a tool makes of a photo (h, w, 3), and what its run took.

    timeout  of the process, in s
    Raises PeerError where there is no file.
    """
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png, output = Path(folder) / "photo.png", Path(folder) / f"output{PEERS[tool].suffix}"
        png.write_bytes(as_png(photo))
        request = {"tool": tool, "settings": settings, "png": str(png), "output": str(output)}
        run = in_own_process(request, timeout)
        if "error" in run:
            raise PeerError(run["error"])
        if not output.exists():
            raise PeerError(f"{tool} wrote no file. Try running it by hand")
        return output.read_bytes(), run


def peer_record(request: Mapping[str, Any]) -> dict[str, Any]:
    """The record of a peer's run: what it took, the size of its file (bytes) and its scores.

    request  image, tool, settings and peer_timeout, perhaps reference and reference_scale
    An SVG is rasterised at the photo's size. Raises PeerError where there is no file, and
    RendererError for one that cannot be rasterised and for an image of another size.
    """
    photo = load_image(request["image"], matte=WHITE).pixels
    tool = request["tool"]
    data, run = peer_file(tool, request["settings"], photo, request["peer_timeout"])
    is_svg = PEERS[tool].suffix == ".svg"
    source = request.get("reference")
    scale = None if source is None else request["reference_scale"]
    measured = (
        check(photo, data, reference=source, reference_scale=scale).report
        if is_svg
        else _measured_image(data, photo)
    )
    return run | finite({name: measured.get(name) for name in _MEASURED})


def _measured_image(data: bytes, photo: NDArray[np.float32]) -> dict[str, Any]:
    height, width = photo.shape[:2]
    raster = load_image(data, matte=WHITE).pixels
    if raster.shape != photo.shape:
        raise RendererError(
            f"image must be {width}x{height} px; got {raster.shape[1]}x{raster.shape[0]}"
        )
    return {
        "width": width,
        "height": height,
        "renderer": "Pillow",
        **measure_pixels(raster, photo),
        **perceptual_scores(raster, photo).report,
        "svg_bytes": len(data),
        "svgz_bytes": len(gzip.compress(data, compresslevel=9, mtime=0)),
    }
