"""The command `gauss2svg check`, imported only when it is run."""

import math
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from gauss2svg import files
from gauss2svg.cli.parser import STATUS_SOME_FAILED
from gauss2svg.cli.terminal import say
from gauss2svg.errors import Gauss2SvgError, brief, of_file, refusal
from gauss2svg.files import STANDARD_STREAM, SVG_ENDINGS, check_ending, expanded, in_folder
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Interval, OptionGroup, file_path, flag_of
from gauss2svg.photo import SUFFIXES
from gauss2svg.pipeline.progress_display import counting
from gauss2svg.processes import command_line


@dataclass(frozen=True, kw_only=True)
class CheckFiles(OptionGroup):
    """Files that are compared."""

    photo: str
    """Photo or drawing, or - for standard input. Or a folder of photos with SVGs of their names."""

    svg: tuple[str, ...] = ()
    """SVG of any program, which may be gzipped, or - for standard input. It is stretched to the
    size at which it is compared. Several give a table. After a folder of photos, the folder of
    their SVGs. If a photo or SVG in them has no partner of its name, the exit status is 1."""


@dataclass(frozen=True, kw_only=True)
class CheckOutput(OptionGroup):
    """Options that set which files are written, whether a summary is shown, and the exit status."""

    heatmap: Annotated[Path | None, file_path] = None
    """Save a map of the errors of one SVG as a PNG file. Each pixel shows the largest difference of
    its colour channels, from black for none to pale yellow for 64 or more of 255 levels."""

    preview: Annotated[Path | None, file_path] = None
    """Save the rasterised SVG as a PNG file, if there is one SVG."""

    report: Annotated[Path | None, file_path] = None
    """Save all measurements as a JSON file, or print them on standard output with -. Those of a
    table are a list."""

    min_psnr: Annotated[float | None, Interval(ge=0.01, le=1e9)] = None
    """PSNR (dB) below which the exit status is 1. A transparent photo must reach it over white and
    over black. Files are written in either case."""

    quiet: bool = False
    """Show no summary."""


SECTIONS = {"Parameters": CheckFiles, "Measuring": CheckOptions, "Output": CheckOutput}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    from gauss2svg.cli.summary import check_table, print_check
    from gauss2svg.measure.check import check

    asked, output, options = CheckFiles.of(given), CheckOutput.of(given), CheckOptions.of(given)
    pairs, lines = _pairs(asked)
    is_one = len(asked.svg) == len(pairs) == 1 and not os.path.isdir(asked.photo)
    inputs = {photo: "the photo" for photo, _ in pairs} | {svg: "the SVG" for _, svg in pairs}
    pictures = _pictures(output, pairs[0][1], is_one)
    is_printed = str(output.report) == STANDARD_STREAM
    reports = [Path(in_folder(output.report, "check.json"))] if output.report else []
    reports = [] if is_printed else reports
    for path in reports:
        check_ending("--report", path, (".json",))
    files.check_outputs(inputs, [*pictures.values(), *reports])
    records: list[dict[str, Any]] = []
    contents: dict[Path, bytes] = {}
    status = STATUS_SOME_FAILED if lines else 0
    with counting(output.quiet or is_one) as update:
        for photo, svg in pairs:
            update(svg, len(records), len(pairs))
            stdin = files.standard_stream(sys.stdin, "input") if svg == STANDARD_STREAM else None
            try:
                source = files.read_input() if photo == STANDARD_STREAM else photo
                result = check(source, stdin or Path(svg), **vars(options))
            except Gauss2SvgError as error:
                if is_one:
                    raise
                records.append({"photo": photo, "svg": svg, "error": str(error)})
                lines.append(f"failed: {of_file(svg, str(error))}")
                status = 2
                continue
            records.append({"photo": photo, "svg": svg, **result.report})
            lines += [] if is_one else [f"{svg}: {note}" for note in result.report["notes"]]
            makers = {"heatmap": result.heatmap, "preview": partial(files.as_png, result.raster)}
            contents |= {path: makers[name]() for name, path in pictures.items()}
            psnrs = [result.report[key] for key in ("psnr_svg", "psnr_svg_black")]
            lowest = min((psnr for psnr in psnrs if psnr is not None), default=math.inf)
            if output.min_psnr is not None and lowest < output.min_psnr:
                limit = f"below --min-psnr {output.min_psnr:g}"
                lines.append(f"{svg}: PSNR is {lowest:.2f} dB, {limit}")
                status = max(status, STATUS_SOME_FAILED)
    # Only the reports of several SVGs have the names of the files.
    one = {name: value for name, value in records[0].items() if name not in ("photo", "svg")}
    report = files.as_json(one if is_one else records)
    files.write_all_atomically(contents | dict.fromkeys(reports, report))
    if is_printed:
        files.write_output(report)
    if is_one and not output.quiet:
        print_check(records[0], pairs[0][1])
    elif is_printed and not output.quiet:  # standard output is the report
        print(check_table(records), end="", file=sys.stderr)
    elif not output.quiet:
        files.write_output(check_table(records).encode())
    for line in lines:
        say(line)
    return status


def _pairs(asked: CheckFiles) -> tuple[list[tuple[str, str]], list[str]]:
    """Return the photo and the SVG of each comparison, and a line on files without a partner.

    Raise InputError if there is no comparison.
    """
    photos, svgs = expanded([asked.photo]), expanded(asked.svg)
    photo = photos[0]
    if os.path.isdir(photo):
        return _pairs_of_folders(photo, svgs)
    if not svgs:
        raise refusal("SVG", "given", "none", "gauss2svg check --help")
    is_wrong = any(name.lower().endswith(SUFFIXES) for name in svgs)
    if is_wrong or len(photos) != 1 or [photo, *svgs].count(STANDARD_STREAM) > 1:
        got = brief(", ".join([*photos, *svgs]))
        raise refusal("files", "one photo and then SVGs", got, "gauss2svg check PHOTO SVG")
    return [(photo, svg) for svg in svgs], []


def _pairs_of_folders(photos: str, svgs: list[str]) -> tuple[list[tuple[str, str]], list[str]]:
    from gauss2svg.batch.inputs import photos_of

    folder = svgs[0] if svgs else photos
    names = [(path, os.path.join(folder, name)) for path, name in photos_of([photos])]
    pairs = [(p, n + end) for p, n in names for end in SVG_ENDINGS if os.path.isfile(n + end)]
    if not pairs or len(svgs) > 1:
        got = brief(", ".join(svgs[1:])) if pairs else f"none in {folder}"
        advice = command_line(["gauss2svg", "batch", photos, "-o", folder])
        raise refusal("SVGs", "in a folder and have the names of the photos", got, advice)
    paired = {Path(path) for pair in pairs for path in pair}
    found = [path for path in sorted(Path(folder).rglob("*")) if path.suffix.lower() in SVG_ENDINGS]
    alone = [str(p) for p in (*(Path(p) for p, _ in names), *found) if p not in paired]
    more = f" and {len(alone) - 10} more" if len(alone) > 10 else ""
    line = f"without a partner of the same name: {', '.join(alone[:10])}{more}"
    return pairs, [line] * bool(alone)


def _pictures(output: CheckOutput, svg: str, is_one: bool) -> dict[str, Path]:
    """Return {option: path} for the pictures that are saved of an SVG.

    Raise InputError if a picture is asked for and there are several SVGs.
    """
    stem = "svg" if svg == STANDARD_STREAM else Path(svg).stem
    pictures = {}
    for name in ("heatmap", "preview"):
        if (path := getattr(output, name)) is None:
            continue
        if not is_one:
            raise refusal(flag_of(name), "given with one SVG", "several", "each SVG alone")
        pictures[name] = Path(in_folder(path, f"{stem}-{name}.png"))
        check_ending(flag_of(name), pictures[name], (".png",))
    return pictures
