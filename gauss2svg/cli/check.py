"""The command `gauss2svg check`, imported only where it is run."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg import files
from gauss2svg.batch.inputs import expanded
from gauss2svg.cli.parameters import refuse_options
from gauss2svg.cli.streams import say, standard_stream
from gauss2svg.errors import InputError, brief, refusal
from gauss2svg.files import STANDARD_STREAM
from gauss2svg.options import Number, OptionGroup, Renderer, Whole, byte_size
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.pipeline.options import color_name

STATUS_UNDER = 1
_Name = Annotated[str, Parameter(allow_leading_hyphen=True)]


@dataclass(frozen=True, kw_only=True)
class CheckOptions(OptionGroup):
    """How an SVG is measured: keywords of `gauss2svg.check`."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG; the last four must be installed."""

    max_svg_bytes: Annotated[int | str, byte_size] = "256M"
    """Maximum size of the SVG, decompressed: 150000, 150k or 1.5M."""

    max_elements: Annotated[int, Whole(1)] = 1_000_000
    """Maximum number of elements of the SVG."""

    draw_timeout: Annotated[float, Number(0, 86400, above=True)] = 300.0
    """Time limit (s) of rasterising, at most 86400; the last four renderers stop after 300."""

    max_pixels: Annotated[int, Whole(1, MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of the photo, checked before it is decoded."""

    max_size: Annotated[int | None, Whole(1, MOST_PIXELS)] = None
    """Longest side (px) to which a larger photo is reduced first; its own size if not given."""

    matte: Annotated[str | None, color_name] = None
    """Background colour to composite a transparent photo over: white, black, #fa0 or #ffaa00. If
    not given, alpha is compared as well."""

    reference_scale: Annotated[float | None, Number(0, MOST_PIXELS, above=True)] = None
    """Times the photo's size at which the SVG is compared with --reference; 4 if not given."""


@dataclass(frozen=True, kw_only=True)
class CheckOutput(OptionGroup):
    """Files that are written, what is shown, and the exit status."""

    heatmap: Path | None = None
    """Save a map of the errors to this file, as PNG: the largest difference of any channel, from
    black for none to pale yellow for 64 or more of 255 levels."""

    preview: Path | None = None
    """Save the rasterised SVG to this file, as PNG."""

    report: Path | None = None
    """Save all numbers to this file, as JSON."""

    min_psnr: Annotated[float | None, Number(0, 1e9, above=True)] = None
    """PSNR (dB) below which the exit status is 1; a transparent photo must reach it over white
    and over black. The files are written in any case."""

    quiet: bool = False
    """Show no summary."""


def check_command(
    photo: _Name,
    svg: _Name,
    *,
    reference: Annotated[
        str | None, Parameter(group="Measuring", allow_leading_hyphen=True)
    ] = None,
    options: Annotated[CheckOptions, Parameter(name="*", group="Measuring")] = CheckOptions(),
    output: Annotated[
        CheckOutput, Parameter(name="*", group="Output", negative=())
    ] = CheckOutput(),
) -> int:
    """Measure how closely any SVG matches a photo.

    Parameters
    ----------
    photo
        Photo; - reads standard input.
    svg
        SVG, also gzipped; - reads standard input. It is stretched to the photo's size, or to that
        of --max-size.
    reference
        What the photo was made from, an SVG or a larger picture, with which the SVG is compared as
        well, enlarged by --reference-scale.
    options, output
        Options.

    """
    from gauss2svg.cli.summary import print_check
    from gauss2svg.measure.check import check

    names = expanded([photo, svg])
    refuse_options(check_command, names, reference or "")
    if len(names) != 2:
        raise refusal("photo and SVG", "one file each", brief(", ".join(names)))
    photo, svg = names
    if photo == svg == STANDARD_STREAM:
        raise InputError("photo and SVG must not both be -. Try a file name for one of them")
    inputs = {photo: "the photo", svg: "the SVG"}
    if reference is not None:
        inputs[reference] = "the reference"
    targets = [output.heatmap, output.preview, output.report]
    files.check_outputs(inputs, [path for path in targets if path is not None])
    read = standard_stream(sys.stdin, "input") if STANDARD_STREAM in names else None
    result = check(
        photo if read is None or svg == STANDARD_STREAM else read.read(),
        Path(svg) if read is None or photo == STANDARD_STREAM else read,
        reference=reference,
        **dataclasses.asdict(options),
    )
    written = {
        output.heatmap: result.heatmap,
        output.preview: lambda: files.as_png(result.raster),
        output.report: lambda: files.as_json(result.report),
    }
    files.write_all_atomically({path: made() for path, made in written.items() if path is not None})
    if not output.quiet:
        print_check(result.report, "standard input" if svg == STANDARD_STREAM else svg)
    lowest = result.psnr if result.psnr_black is None else min(result.psnr, result.psnr_black)
    if output.min_psnr is not None and lowest < output.min_psnr:
        say(f"PSNR is {lowest:.2f} dB, below --min-psnr {output.min_psnr:g}")
        return STATUS_UNDER
    return 0
