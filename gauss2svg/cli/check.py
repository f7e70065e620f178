"""The command `gauss2svg check`; the command line loads it only when it is asked for."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

STATUS_UNDER = 1


def check_command(
    photo: Annotated[str, Parameter(allow_leading_hyphen=True)],
    svg: Annotated[str, Parameter(allow_leading_hyphen=True)],
    *,
    renderer: Literal["resvg", "cairo", "chromium", "librsvg", "firefox", "inkscape"] = "resvg",
    heatmap: Path | None = None,
    preview: Path | None = None,
    report: Path | None = None,
    min_psnr: float | None = None,
    max_svg_bytes: str = "256M",
    max_elements: int = 1_000_000,
    draw_timeout: float = 300.0,
    max_pixels: int = 89_478_485,
    matte: str | None = None,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Measure how true any SVG is to a photo.

    Parameters
    ----------
    photo
        The photo; - reads standard input.
    svg
        The SVG, gzipped or not; - reads standard input. It is stretched to the photo's size.
    renderer
        Which renderer draws the SVG; the last four if they are installed.
    heatmap
        Write a map of the errors there, as PNG: the largest difference of any channel, black
        for none, pale yellow for 64 and more levels of 255.
    preview
        Write what the renderer drew there, as PNG.
    report
        Write all numbers there, as JSON.
    min_psnr
        Decibels under which the exit status is 1, over black too where the photo is transparent;
        the files are written all the same.
    max_svg_bytes
        Most bytes of the SVG, gunzipped: 150000, 150k, 1.5M.
    max_elements
        Most elements of the SVG.
    draw_timeout
        Seconds that the drawing may take, up to 86400; the last four renderers end after 300.
    max_pixels
        Most pixels of the photo, told by its header before it is decoded.
    matte
        Colour over which a transparent photo is shown first: white, black, #fa0 or #ffaa00; its
        alpha is compared as well if not given.
    quiet
        No summary.

    """
    from gauss2svg.cli.streams import standard_stream
    from gauss2svg.cli.terminal import print_check
    from gauss2svg.errors import InputError
    from gauss2svg.files import (
        STANDARD_STREAM,
        as_json,
        as_png,
        check_outputs,
        refuse_option_like,
        write_all_atomically,
    )
    from gauss2svg.measure.check import check

    refuse_option_like(photo, svg)
    if photo == svg == STANDARD_STREAM:
        raise InputError("both the photo and the SVG are -; give a file name for one of them")
    if min_psnr is not None and not 0 < min_psnr < math.inf:
        raise InputError(f"min_psnr is {min_psnr}; needed are finite dB above 0")
    targets = [path for path in (heatmap, preview, report) if path is not None]
    check_outputs({photo: "the photo", svg: "the SVG"}, targets)

    picture: Any = photo
    if photo == STANDARD_STREAM:
        picture = standard_stream(sys.stdin, "input").read()
    drawing: Any = Path(svg)  # a name, also where it begins with <
    if svg == STANDARD_STREAM:
        drawing = standard_stream(sys.stdin, "input")
    result = check(
        picture,
        drawing,
        renderer=renderer,
        max_svg_bytes=max_svg_bytes,
        max_elements=max_elements,
        draw_timeout=draw_timeout,
        max_pixels=max_pixels,
        matte=matte,
    )
    files: dict[str | os.PathLike[str], bytes] = {}
    if heatmap is not None:
        files[heatmap] = result.heatmap()
    if preview is not None:
        files[preview] = as_png(result.raster)
    if report is not None:
        files[report] = as_json(result.report)
    write_all_atomically(files)
    if not quiet:
        print_check(result.report, None if svg == STANDARD_STREAM else svg)
    lowest = result.psnr if result.psnr_black is None else min(result.psnr, result.psnr_black)
    if min_psnr is not None and lowest < min_psnr:
        print(
            f"gauss2svg: PSNR is {lowest:.2f} dB, under the {min_psnr:g} dB asked for",
            file=sys.stderr,
        )
        return STATUS_UNDER
    return 0
