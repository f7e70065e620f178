"""The command `gauss2svg check`, imported only when it is run."""

import math
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from gauss2svg import files
from gauss2svg.cli.parser import STATUS_SOME_FAILED, output_files
from gauss2svg.cli.terminal import say
from gauss2svg.errors import brief, refusal
from gauss2svg.files import STANDARD_STREAM, check_ending, expanded
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Interval, OptionGroup, file_path, flag_of
from gauss2svg.photo import SUFFIXES


@dataclass(frozen=True, kw_only=True)
class CheckFiles(OptionGroup):
    """Files that are compared."""

    photo: str
    """Photo or drawing, or - for standard input."""

    svg: str
    """SVG of any program, which may be gzipped, or - for standard input. It is stretched to the
    size at which it is compared."""


@dataclass(frozen=True, kw_only=True)
class CheckOutput(OptionGroup):
    """Options that set which files are written, whether a summary is shown, and the exit status."""

    heatmap: Annotated[Path | None, file_path] = None
    """Save a map of the errors as a PNG file. Each pixel shows the largest difference of
    its colour channels, from black for none to pale yellow for 64 or more of 255 levels."""

    preview: Annotated[Path | None, file_path] = None
    """Save the rasterised SVG as a PNG file."""

    report: Annotated[Path | None, file_path] = None
    """Save all measurements as a JSON file, or print them on standard output with -."""

    min_psnr: Annotated[float | None, Interval(ge=0.01, le=1e9)] = None
    """PSNR (dB) below which the exit status is 1. A transparent photo must reach it over white and
    over black. Files are written in either case."""

    quiet: bool = False
    """Show no summary."""


SECTIONS = {"Parameters": CheckFiles, "Measuring": CheckOptions, "Output": CheckOutput}
_ENDINGS = {"heatmap": (".png",), "preview": (".png",), "report": (".json",)}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.cli.summary import print_check
    from gauss2svg.measure.check import check

    asked, output, options = CheckFiles.of(given), CheckOutput.of(given), CheckOptions.of(given)
    names = expanded([asked.photo, asked.svg])
    if len(names) != 2 or names[1].lower().endswith(SUFFIXES) or names == 2 * [STANDARD_STREAM]:
        got = brief(", ".join(names))
        raise refusal("files", "one photo and then one SVG", got, "gauss2svg check PHOTO SVG")
    photo, svg = names
    paths = output_files(output, _ENDINGS, "svg" if svg == STANDARD_STREAM else Path(svg).stem)
    files.check_outputs({photo: "the photo", svg: "the SVG"}, [*paths.values()])
    for name, path in paths.items():
        check_ending(flag_of(name), path, _ENDINGS[name])
    source = files.read_input() if photo == STANDARD_STREAM else photo
    stdin = files.standard_stream(sys.stdin, "input") if svg == STANDARD_STREAM else None
    result = check(source, stdin or Path(svg), **vars(options))
    report = files.as_json(result.report)
    makers = {"heatmap": result.heatmap, "preview": partial(files.as_png, result.raster)}
    contents = {path: makers[name]() if name in makers else report for name, path in paths.items()}
    files.write_all_atomically(contents)
    if str(output.report) == STANDARD_STREAM:
        files.write_output(report)
    if not output.quiet:
        print_check(result.report, svg)
    psnrs = [result.report[key] for key in ("psnr_svg", "psnr_svg_black")]
    lowest = min((psnr for psnr in psnrs if psnr is not None), default=math.inf)
    if output.min_psnr is not None and lowest < output.min_psnr:
        say(f"{svg}: PSNR is {lowest:.2f} dB, below --min-psnr {output.min_psnr:g}")
        return STATUS_SOME_FAILED
    return 0
