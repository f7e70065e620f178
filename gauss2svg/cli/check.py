"""The command `gauss2svg check`, imported only when it is run."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from gauss2svg import files
from gauss2svg.cli.terminal import say
from gauss2svg.errors import brief, refusal
from gauss2svg.files import STANDARD_STREAM, expanded
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Interval, OptionGroup, file_path

USAGE = "PHOTO SVG [OPTIONS]"


@dataclass(frozen=True, kw_only=True)
class CheckFiles(OptionGroup):
    """Files that are compared."""

    photo: str
    """Photo or drawing, or - for standard input."""

    svg: str
    """SVG of any program, which may be gzipped, or - for standard input. It is stretched to the
    size at which it is compared."""

    reference: str | None = None
    """SVG or larger picture that the photo was made from. The SVG is also enlarged by
    --reference-scale and compared with this reference."""


@dataclass(frozen=True, kw_only=True)
class CheckOutput(OptionGroup):
    """Options that set which files are written, whether a summary is shown, and the exit status."""

    heatmap: Annotated[Path | None, file_path] = None
    """Save a map of the errors as a PNG file. Each pixel shows the largest difference of its colour
    channels, from black for none to pale yellow for 64 or more of 255 levels."""

    preview: Annotated[Path | None, file_path] = None
    """Save the rasterised SVG as a PNG file."""

    report: Annotated[Path | None, file_path] = None
    """Save all measurements as a JSON file."""

    min_psnr: Annotated[float | None, Interval(gt=0, le=1e9)] = None
    """PSNR (dB) below which the exit status is 1. A transparent photo must reach it over white and
    over black. Files are written in either case."""

    quiet: bool = False
    """Show no summary."""


SECTIONS = {"Parameters": CheckFiles, "Measuring": CheckOptions, "Output": CheckOutput}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.cli.summary import print_check
    from gauss2svg.measure.check import check

    asked, output = CheckFiles.of(given), CheckOutput.of(given)
    names, reference = expanded([asked.photo, asked.svg]), asked.reference
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
        **dataclasses.asdict(CheckOptions.of(given)),
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
