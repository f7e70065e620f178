"""The command `gauss2svg check`, imported only when it is run."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg import files
from gauss2svg.cli.terminal import say
from gauss2svg.errors import brief, refusal
from gauss2svg.files import STANDARD_STREAM, expanded
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Interval, OptionGroup

_Name = Annotated[str, Parameter(allow_leading_hyphen=True)]


@dataclass(frozen=True, kw_only=True)
class CheckOutput(OptionGroup):
    """Options that set which files are written, whether a summary is shown, and the exit status."""

    heatmap: Path | None = None
    """Save a map of the errors as a PNG file. Each pixel shows the largest difference of its colour
    channels, from black for none to pale yellow for 64 or more of 255 levels."""

    preview: Path | None = None
    """Save the rasterised SVG as a PNG file."""

    report: Path | None = None
    """Save all measurements as a JSON file."""

    min_psnr: Annotated[float | None, Interval(gt=0, le=1e9)] = None
    """PSNR (dB) below which the exit status is 1. A transparent photo must reach it over white and
    over black. Files are written in either case."""

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
        Photo or drawing, or - for standard input.
    svg
        SVG of any program, which may be gzipped, or - for standard input. It is stretched to the
        size at which it is compared.
    reference
        SVG or larger picture that the photo was made from. The SVG is also enlarged by
        --reference-scale and compared with this reference.
    options, output
        Options.

    """
    from gauss2svg.cli.summary import print_check
    from gauss2svg.measure.check import check

    names = expanded([photo, svg])
    if len(names) != 2 or names == [STANDARD_STREAM, STANDARD_STREAM]:
        got = brief(", ".join(names))
        raise refusal("photo and SVG", "one file each", got, "a file name for each")
    photo, svg = names
    inputs = {photo: "the photo", svg: "the SVG"}
    if reference is not None:
        inputs[reference] = "the reference"
    targets = [output.heatmap, output.preview, output.report]
    files.check_outputs(inputs, [path for path in targets if path is not None])
    result = check(
        files.standard_stream(sys.stdin, "input").read() if photo == STANDARD_STREAM else photo,
        files.standard_stream(sys.stdin, "input") if svg == STANDARD_STREAM else Path(svg),
        reference=reference,
        **dataclasses.asdict(options),
    )
    makers = {
        output.heatmap: result.heatmap,
        output.preview: lambda: files.as_png(result.raster),
        output.report: lambda: files.as_json(result.report),
    }
    files.write_all_atomically({path: make() for path, make in makers.items() if path is not None})
    if not output.quiet:
        print_check(result.report, "standard input" if svg == STANDARD_STREAM else svg)
    lowest = result.psnr if result.psnr_black is None else min(result.psnr, result.psnr_black)
    if output.min_psnr is not None and lowest < output.min_psnr:
        say(f"PSNR is {lowest:.2f} dB, below --min-psnr {output.min_psnr:g}")
        return 1
    return 0
