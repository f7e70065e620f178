"""The command `gauss2svg PHOTO -o OUT.svg`."""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from gauss2svg import files, processes
from gauss2svg.cli.parser import output_files, run_options
from gauss2svg.cli.terminal import Interruption, handling, say, status_of
from gauss2svg.errors import InputError, brief, refusal, several
from gauss2svg.files import STANDARD_STREAM, SVG_ENDINGS, check_ending, expanded, in_folder
from gauss2svg.options import Interval, OptionGroup, file_path, flag_of
from gauss2svg.pipeline.options import GROUP_TITLES, GROUPS, Goal, Options
from gauss2svg.processes import command_line
from gauss2svg.scene import ADD
from gauss2svg.svg import MOST_TRAP, Plotter

if TYPE_CHECKING:
    from gauss2svg.pipeline.vectorize import Result

_PROGRAM_START_S = time.perf_counter()  # --time-limit counts the time from here

USAGE = "PHOTO [-o OUT.svg] [OPTIONS]   (--help-all lists all options)"
ABOUT = """Turn a picture into an SVG of soft shapes, and measure how closely it matches.

gauss2svg photo.jpg -o out.svg                       # adapts to the picture
gauss2svg photo.jpg -o out.svg --max-bytes 150k      # the best file of 150 kB
gauss2svg photo.jpg --max-bytes 60k --count-gzipped  # the best of 60 kB gzipped"""
# {option that names an output file: endings that this file may have}
_ENDINGS = {"preview": (".png",), "report": (".json",), "save_scene": (".npz",)}
_ENDINGS |= dict.fromkeys(("outline", "separations", "plot"), SVG_ENDINGS)


@dataclass(frozen=True, kw_only=True)
class Command(OptionGroup):
    """The files of a run."""

    photo: tuple[str, ...] = ()
    """JPEG, PNG, WebP, TIFF, AVIF, HEIC and others, - for stdin."""

    output: str | None = None
    """SVG to write, or - for stdout. The default is photo.svg."""


@dataclass(frozen=True, kw_only=True)
class InputFiles(OptionGroup):
    """Options for files that are read in addition to the photo."""

    focus: Annotated[Path | None, file_path] = None
    """Put more detail where this picture is white. It has the proportions of the photo."""

    start: Annotated[Path | None, file_path] = None
    """Refine the shapes of this scene (.npz) or SVG, in place of a new fit. An SVG of another
    program must consist of filled paths and lines."""


@dataclass(frozen=True, kw_only=True)
class OutputFiles(OptionGroup):
    """Options for files that are written in addition to the SVG, and for messages."""

    preview: Annotated[Path | None, file_path] = None
    """Save the rasterised SVG as a PNG file."""

    report: Annotated[Path | None, file_path] = None
    """Save all measurements of the run as a JSON file, or print them on standard output with -."""

    outline: Annotated[Path | None, file_path] = None
    """Save the outlines of the shapes as a second SVG file."""

    save_scene: Annotated[Path | None, file_path] = None
    """Save the fitted Gaussians as a NumPy file (.npz)."""

    overwrite: bool = False
    """Replace photo.svg even if another program wrote it."""

    quiet: bool = False
    """Show neither progress nor summary."""


@dataclass(frozen=True, kw_only=True)
class PlatesAndPens(OptionGroup):
    """Options for files that are written for printers and plotters."""

    separations: Annotated[Path | None, file_path] = None
    """Save one SVG for each of the --inks, black where the ink is visible. The name plate.svg gives
    plate-1.svg, plate-2.svg and so on."""

    cut: bool = False
    """Make --separations and --outline for a cutter: the region in which each of the --inks is
    seen, as closed paths clear of all others. Needs gauss2svg[cut]."""

    trap: Annotated[float | None, Interval(ge=0.001, le=MOST_TRAP)] = None
    """Width (mm) by which regions of --cut spread below darker inks beside them, such as 0.2."""

    marks: bool = False
    """Add a margin with register marks, its number and its ink to each of the --separations."""

    plot: Annotated[Path | None, file_path] = None
    """Save strokes for a pen plotter as an SVG in mm: lines and outlines of a drawing, hatching for
    a photo. Each of the --inks has a pen."""


@dataclass(frozen=True, kw_only=True)
class Files(Plotter, PlatesAndPens, OutputFiles, InputFiles):
    """Options for all files except the photo and the SVG."""

    @property
    def prints_report(self) -> bool:
        """Whether the report is printed on standard output."""
        return str(self.report) == STANDARD_STREAM


COMMON = {"Parameters": Command, "Goal": Goal, "Output files": OutputFiles}  # sections of --help
SECTIONS = COMMON | {
    "Input files": InputFiles,
    "Plates and pens": PlatesAndPens,
    "Plotter": Plotter,
}
SECTIONS |= {title: GROUPS[key] for key, title in GROUP_TITLES.items()}


def run(given: dict[str, Any]) -> int:
    """Run the command with the values that were given, and return its exit status."""
    command = Command.of(given)
    photos = expanded(command.photo)
    if len(photos) != 1 or os.path.isdir(photos[0] or "."):
        got = brief(", ".join(photos)) or ("''" if photos else "none")
        advice = "gauss2svg batch PHOTOS -o FOLDER" if photos else "gauss2svg --help"
        if len(photos) == 2 and photos[1].lower().endswith(SVG_ENDINGS):
            advice = command_line(["gauss2svg", photos[0], "-o", photos[1]])
        raise refusal("the photo", "one file", got, advice)
    return _run(photos[0], command.output, run_options(given), Files.of(given))


def _run(photo: str, output: str | None, options: Options, extras: Files) -> int:
    processes.keep_freed_memory()
    interruption = Interruption()
    with handling(interruption.receive):
        stem = "photo" if photo == STANDARD_STREAM else Path(photo).stem
        output = _output(photo, output, stem, extras.overwrite)
        paths = output_files(extras, _ENDINGS, stem)
        _check_together(options, extras, output)
        _check_files(photo, output, options, extras, paths)
        if output.lower().endswith(".svgz"):
            options = options.changed(gzip=True)
        result = _result(photo, output, options, extras, interruption)
        # The summary tells which targets were missed. With --quiet, there is no summary. A line is
        # then printed for each missed target, because the user must know of it.
        lines = [*result.report["unreached"]] if extras.quiet else []
        lines += _write(result, output, extras, paths)
        written_to = "standard output" if output == STANDARD_STREAM else output
        if not extras.quiet:
            from gauss2svg.cli.summary import print_summary

            print_summary(result.report, written_to)
        if interruption.signal is not None:
            steps = result.report["iterations"]
            after = f" after {several(steps, 'step')} of the fit" if steps else ""
            lines.append(f"interrupted{after}. The best picture so far is in {written_to}")
        for line in lines:
            say(line)
    return 0 if interruption.signal is None else status_of(interruption.signal)


def _output(photo: str, output: str | None, stem: str, overwrite: bool) -> str:
    """Return the name of the SVG: `output`, or photo.svg in the folder of `output` or of the photo.

    If the name is photo.svg, raise InputError if there is such a file that gauss2svg did not write,
    unless `overwrite` is True. Also raise it if `output` is None and the photo is standard input.

    stem  name of the photo without its ending
    """
    if output == STANDARD_STREAM:
        return output
    if output == "" or (output is None and photo == STANDARD_STREAM):
        needed, advice = "the name of a file or folder", "-o out.svg, or -o - for standard output"
        raise refusal("--output", needed, "none", advice)
    path = in_folder(output, f"{stem}.svg") if output else str(Path(photo).with_suffix(".svg"))
    if path == photo and output is None:
        raise refusal("the photo", "another image than an SVG", photo, "a PNG or JPEG of it")
    if path != output and not overwrite and os.path.isfile(path):
        from gauss2svg.svg.file import is_own

        if not is_own(path):
            raise InputError(
                f"--output must be given, because {path} exists and gauss2svg did not write it. "
                f"Try -o {path} to replace it, or another name"
            )
    return path


def _check_files(
    photo: str, output: str, options: Options, extras: Files, paths: dict[str, Path]
) -> None:
    """Raise InputError if an output would replace an input, or has a wrong ending.

    Raise OutputError if an output cannot be written.

    paths  output files by their options
    """
    targets = [] if output == STANDARD_STREAM else [Path(output)]
    targets += [path for name, path in paths.items() if name != "separations"]
    inks = options.fit.inks
    if "separations" in paths:
        count = inks if isinstance(inks, int) else str(inks).count(",") + 1
        targets += _plates(paths["separations"], count)
    inputs = {photo: "the photo", extras.focus: "the mask", extras.start: "the scene"}
    files.check_outputs({str(path): text for path, text in inputs.items() if path}, targets)
    if output != STANDARD_STREAM:
        check_ending("--output", output, SVG_ENDINGS)
    for name, path in paths.items():
        check_ending(flag_of(name), path, _ENDINGS[name])


def _plates(path: Path, count: int) -> list[Path]:
    """Return the paths of the first `count` plates: plate-1.svg, plate-2.svg for plate.svg."""
    return [path.with_name(f"{path.stem}-{k}{path.suffix}") for k in range(1, count + 1)]


def _check_together(options: Options, extras: Files, output: str) -> None:
    """Raise InputError if an option of an output file needs or excludes another option.

    Also raise it if --cut needs a package that is not installed.
    """
    inks, plates = options.fit.inks, extras.separations
    targets, needed = plates or extras.outline, "with --inks 3 and --separations cut.svg"
    two_streams = extras.prints_report and output == STANDARD_STREAM
    rules = [
        (two_streams, "--report", "with a file if -o is standard output"),
        (extras.outline and options.written_blend == ADD, "--outline", f"without --blend {ADD}"),
        (plates and inks is None, "--separations", "with --inks 3"),
        (extras.cut and (inks is None or not targets), "--cut", needed),
        (extras.trap and not extras.cut, "--trap", "with --cut"),
        (extras.marks and not plates, "--marks", "with --separations plate.svg"),
    ]
    changed = Plotter.of(vars(extras)) != Plotter() and extras.plot is None
    rules.append((changed, "options of plotters", "with --plot plot.svg"))
    for is_broken, name, other in rules:
        if is_broken:
            raise InputError(f"{name} must be given {other}")
    if extras.cut:
        from gauss2svg.svg.plates import require_shapely  # few runs need it

        require_shapely()


def _result(
    photo: str, output: str, options: Options, extras: Files, interruption: Interruption
) -> "Result":
    from gauss2svg.pipeline.progress_display import watched
    from gauss2svg.pipeline.vectorize import vectorize_by

    source, start = files.read_input() if photo == STANDARD_STREAM else photo, None
    if output == STANDARD_STREAM or extras.prints_report:
        # If standard output is closed, this raises an error now and not only after the fit.
        files.standard_stream(sys.stdout, "output")
    if extras.start is not None:
        from gauss2svg.scene import Scene
        from gauss2svg.svg.read import read_svg

        read = Scene.load if extras.start.suffix.lower() == ".npz" else read_svg
        start = read(extras.start)
    started = _PROGRAM_START_S if options.goal.time_limit is not None else None
    with watched(not extras.quiet) as progress:
        return vectorize_by(
            options, source, focus=extras.focus, start=start, progress=progress,
            stop=interruption.should_stop, started=started,
        )  # fmt: skip


def _write(result: "Result", output: str, extras: Files, paths: dict[str, Path]) -> Iterator[str]:
    """Write all files. Yield the lines that are to be printed about plots and plates."""
    from gauss2svg.svg.file import file_bytes, is_svgz

    svgs: dict[Path, str] = {}
    lines: list[str] = []
    if "plot" in paths:
        plot = result.plot(Plotter.of(vars(extras)))
        svgs[paths["plot"]] = plot.svg
        lines.append(f"{paths['plot']}: {plot}")
    if "outline" in paths:
        svgs[paths["outline"]] = result.outline(extras.cut, extras.trap or 0.0)
    if "separations" in paths:
        plates = result.plates(extras.cut, extras.trap or 0.0, extras.marks)
        inks = result.report["inks"].split(",")
        for path, ink in zip(_plates(paths["separations"], len(inks)), inks, strict=True):
            if ink in plates:
                svgs[path] = plates[ink]
                lines.append(f"{path}: {ink}")
            else:
                yield f"{path} is not written, because {ink} is visible nowhere"
    if extras.cut and not extras.quiet and (count := result.thin_parts()):
        parts = "1 part is" if count == 1 else f"{count:,} parts are"
        thin = f"{parts} too thin to cut (0.3 mm), and left to the ink beside"
        lines.append(f"{thin}. Try a larger --size")
    contents: dict[files.FileName, bytes] = {}
    svg = file_bytes(result.svg, result.report["gzip"])
    if output == STANDARD_STREAM:
        files.write_output(svg)
    else:
        contents[output] = svg
    contents |= {path: file_bytes(text, is_svgz(path)) for path, text in svgs.items()}
    if "preview" in paths:
        contents[paths["preview"]] = files.as_png(result.raster)
    if "save_scene" in paths:
        contents[paths["save_scene"]] = files.saved(result.scene.save)
    if "report" in paths:
        contents[paths["report"]] = files.as_json(result.report)
    files.write_all_atomically(contents)
    if extras.prints_report:
        files.write_output(files.as_json(result.report))
    if not extras.quiet:
        yield from lines
