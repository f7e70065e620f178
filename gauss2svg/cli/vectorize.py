"""The command `gauss2svg PHOTO -o OUT.svg`."""

import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Group, Parameter

from gauss2svg.cli.parameters import options_of, refuse_unknown_options
from gauss2svg.cli.signals import interruptible
from gauss2svg.cli.streams import say, standard_stream, write_output
from gauss2svg.errors import InputError, brief, quoted, whole_number
from gauss2svg.files import (
    STANDARD_STREAM,
    as_json,
    as_png,
    check_outputs,
    check_writable,
    expanded,
    refuse_option_like,
    saved,
    write_all_atomically,
)
from gauss2svg.photo.formats import TITLES
from gauss2svg.pipeline.options import GROUP_TITLES, Options, option_names
from gauss2svg.scene import ADD
from gauss2svg.scene.inks import MOST_INKS, PALETTE_SUFFIX

_BEGUN = time.perf_counter()

_EXAMPLES = (
    "gauss2svg photo.jpg -o out.svg                     # adapts to the image",
    "gauss2svg photo.jpg -o out.svg --quality draft     # small and fast",
    "gauss2svg photo.jpg -o out.svg --max-bytes 150k    # the best that fits",
)
HELP = "Turn a photo into an SVG of Gaussians, and measure how closely it matches.\n\n" + (
    "  \n".join(_EXAMPLES)  # a line each, as Markdown has it
)
_OURS = b"written by gauss2svg"  # of the description of every file
_HEAD = 65536  # bytes within which it stands
_ORDER = ("goal", "svg", "document", "fit", "densify", "run")  # of the help
_PARAMETERS = f"""

Parameters
----------
photo
    {", ".join(TITLES)}; - is standard input.
output
    SVG to write, - for standard output; by default photo.svg.
"""


@dataclass(frozen=True, kw_only=True)
class OutputFiles:
    """Further files, and what is shown."""

    preview: Path | None = None
    """Save the rasterised SVG to this file, as PNG."""

    report: Path | None = None
    """Save all numbers of the run to this file, as JSON."""

    outline: Path | None = None
    """Save the outlines of the shapes to this file, as SVG."""

    save_scene: Path | None = None
    """Save the fitted Gaussians to this file, as NPZ."""

    overwrite: bool = False
    """Replace an SVG of another program."""

    quiet: bool = False
    """Show neither progress nor summary."""


@dataclass(frozen=True, kw_only=True)
class MakerFiles:
    """What printers and plotters take."""

    separations: Path | None = None
    """With --inks save a plate for each to plate-1.svg, plate-2.svg, where this is plate.svg: black
    where the ink is seen."""

    pens: int | None = None
    """Pens that draw the --outline, each a layer; then lines end at the page, and sizes are in
    mm."""


@dataclass(frozen=True, kw_only=True)
class Files(MakerFiles, OutputFiles):
    """All further files."""


def vectorize_command(everything: bool, short: bool = False) -> Callable[..., int]:
    """The command as a function of options whose groups are shown in its help, or most of them.

    short  whether it has no others, which the short help need not read
    """
    groups = {
        key: Group(GROUP_TITLES[key], sort_key=order, show=everything or order == 0)
        for order, key in enumerate(_ORDER[:1] if short else _ORDER)
    }
    makers_group = Group("Plates and pens", sort_key=0.6, show=everything)
    parsed = options_of(groups)
    defaults = parsed()

    def command(
        *photo: Annotated[str, Parameter(allow_leading_hyphen=True, group="Parameters")],
        output: Annotated[
            str | None, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)
        ] = None,
        options: Annotated[parsed, Parameter(name="*")] = defaults,  # pyright: ignore[reportInvalidTypeForm]
        files: Annotated[
            OutputFiles, Parameter(name="*", group=Group("Output files", sort_key=0.5))
        ] = OutputFiles(),
        makers: Annotated[MakerFiles, Parameter(name="*", group=makers_group)] = MakerFiles(),
    ) -> int:
        both = Files(**vars(files), **vars(makers))
        return _run(_one_photo(photo), output, Options(**vars(options)), both)

    command.__doc__ = HELP + _PARAMETERS
    return command


def _one_photo(photos: tuple[str, ...]) -> str:
    photos = tuple(expanded(photos))
    refuse_unknown_options(photos, option_names())
    if len(photos) != 1:
        got, advice = brief(", ".join(photos)), "gauss2svg batch"
        if not photos:
            got, advice = "none", "gauss2svg --help"
        raise InputError(f"the photo must be one file; got {got}. Try {advice}")
    return photos[0]


def _run(photo: str, output: str | None, options: Any, files: Files) -> int:
    with interruptible() as interruption:
        output, options = _checked(photo, output, options, files)
        result = _result(photo, output, options, files, interruption)
        left_out = _write(result, output, files)
        _report(result, output, files, interruption, left_out)
    return interruption.status


def _checked(photo: str, output: str | None, options: Any, files: Files) -> tuple[str, Any]:
    """The name of the SVG and the options that follow from it, once all names are checked."""
    from gauss2svg.svg.file import check_svg_name, is_svgz

    refuse_option_like(photo, output or "")
    if output is None:
        output = _default_output(photo, files.overwrite)
    if files.outline is not None and options.fit.blend == ADD and not options.svg.portable:
        raise InputError(
            "--outline must not be given with --blend add, whose signed colours have no strokes. "
            "Try --portable"
        )
    _check_pens(options, files)
    if not output:
        check_svg_name("--output", output)
    _check_files(photo, output, options, files)
    if output != STANDARD_STREAM:
        check_svg_name("--output", output)
    _check_names(
        [
            ("--preview", files.preview, ".png"),
            ("--report", files.report, ".json"),
            ("--outline", files.outline, ".svg"),
            ("--separations", files.separations, ".svg"),
            ("--save-scene", files.save_scene, ".npz"),
        ]
    )
    return output, options.changed(gzip=True) if is_svgz(output) else options


def _check_pens(options: Any, files: Files) -> None:
    """Refuse pens without outlines, and plates without inks."""
    from gauss2svg.svg.outlines import MOST_PENS

    if files.separations is not None:
        if options.fit.inks is None:
            raise InputError("--separations must be given with --inks; got none. Try --inks 3")
        check_writable(files.separations)  # no folder: then plates would have no name
    if files.pens is None:
        return
    whole_number("--pens", files.pens, 1, MOST_PENS)
    if files.outline is None:
        raise InputError(
            f"--pens must be given with --outline; got {files.pens} alone. Try --outline plot.svg"
        )
    for name in options.document.layered:
        raise InputError(f"--pens must not be given with {name}, whose layers are rounds")


def _plates(files: Files, count: int) -> list[Path]:
    """Names of the files of so many plates."""
    path = files.separations
    if path is None:
        return []
    return [path.with_name(f"{path.stem}-{k}{path.suffix}") for k in range(1, count + 1)]


def _default_output(photo: str, overwrite: bool) -> str:
    """The name of the SVG beside a photo: photo.svg of photo.jpg.

    Raises InputError where that is the photo itself or, unless overwrite is True, an existing file
    that gauss2svg did not write.
    """
    if photo == STANDARD_STREAM:
        raise InputError(
            "--output must be given where the photo is standard input. Try -o out.svg, or -o - for "
            "standard output"
        )
    output = Path(photo).with_suffix(".svg")
    if output == Path(photo):
        raise InputError(f"the photo must be an image other than an SVG; got {quoted(photo)}")
    if not overwrite and output.is_file() and not _is_ours(output):
        raise InputError(
            f"{output} must be given by name, for it exists and gauss2svg did not write it. Try "
            f"-o {output} to replace it, or -o with another name"
        )
    return os.fspath(output)


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return _OURS in file.read(_HEAD)
    except OSError:
        return False


def _check_names(files: Iterable[tuple[str, str | os.PathLike[str] | None, str]]) -> None:
    """check_svg_name of further files: option, path or None, and the suffix of what is written."""
    import mimetypes

    from gauss2svg.svg.file import check_svg_name, check_type

    for name, path, suffix in files:
        if path is None:
            continue
        if os.fspath(path).lower().endswith(PALETTE_SUFFIX):  # the inks may be read from it
            raise InputError(f"{name} must be no palette file; got {brief(path)}. Try another name")
        if suffix == ".svg":
            check_svg_name(name, path)
        else:
            known = mimetypes.guess_type(f"x{suffix}")[0]
            allowed = (known,) if known else ()
            check_type(name, os.fspath(path), (*allowed, "text/plain"), suffix)


def _result(photo: str, output: str, options: Any, files: Files, interruption: Any) -> Any:
    from gauss2svg.pipeline.shown import watched
    from gauss2svg.pipeline.vectorize import vectorize_by

    source: Any = photo
    if photo == STANDARD_STREAM:
        source = standard_stream(sys.stdin, "input").read()
    if output == STANDARD_STREAM:
        standard_stream(sys.stdout, "output")  # refused now where it is closed
    with watched(not files.quiet) as show:

        def progress(now: Any) -> None:
            if now.phase in ("write", "measure"):
                interruption.after_fit()
            if show is not None:
                show(now)

        return vectorize_by(
            options,
            source,
            progress=progress,
            stop=interruption.asked,
            started=_BEGUN if options.goal.time_limit is not None else None,
        )


def _write(result: Any, output: str, files: Files) -> list[str]:
    """Write all files; a line for each plate that is left out or of an earlier run."""
    from gauss2svg.svg.file import file_bytes, is_svgz

    svg = file_bytes(result.svg, result.report["gzip"])
    written: dict[str | os.PathLike[str], bytes] = {}
    left_out: list[str] = []
    if output == STANDARD_STREAM:
        write_output(svg)
    else:
        written[output] = svg
    if files.outline is not None:
        written[files.outline] = file_bytes(result.outline(files.pens), is_svgz(files.outline))
    if files.separations is not None:
        plates, inks = result.plates(), result.report["inks"].split(",")
        for path, ink in zip(_plates(files, len(inks)), inks, strict=True):
            if ink in plates:
                written[path] = file_bytes(plates[ink], is_svgz(path))
            else:
                left_out.append(f"{path} is not written: no shape of {ink} is seen")
        older = (path for path in _plates(files, MOST_INKS) if path not in written)
        said = "is of an earlier run, and not a plate of this picture"
        left_out += [f"{path} {said}" for path in older if path.exists()]
    if files.preview is not None:
        written[files.preview] = as_png(result.raster)
    if files.save_scene is not None:
        written[files.save_scene] = saved(result.scene.save)
    if files.report is not None:
        written[files.report] = as_json(result.report)
    write_all_atomically(written)
    return left_out


def _report(result: Any, output: str, files: Files, interruption: Any, left_out: list[str]) -> None:
    """What a person reads at the end, on standard error."""
    from gauss2svg.cli.summary import print_summary

    report, where = result.report, "standard output" if output == STANDARD_STREAM else output
    if files.quiet:
        lines = list(report["unreached"])  # bad news is reported all the same
    else:
        lines = []
        print_summary(report, None if output == STANDARD_STREAM else output)
        if files.outline is not None and (hiding := result.hiding) > 0:
            lines.append(
                f"{hiding} opaque ellipses hide what is below them in the picture, where "
                f"{files.outline} has all lines"
            )
    lines += left_out
    if interruption.signal is not None:
        lines.append(
            f"interrupted after {report['iterations']} iterations; the best so far is in {where}"
        )
    for line in lines:
        say(line)


def _check_files(photo: str, output: str, options: Any, files: Files) -> None:
    """Refuse outputs that could not be written, or would overwrite an input or each other."""
    further = (files.outline, files.report, files.preview, files.save_scene)
    outputs = [path for path in further if path is not None]
    inks = options.fit.inks
    if inks is not None:
        outputs += _plates(files, inks if isinstance(inks, int) else inks.count(",") + 1)
    if output != STANDARD_STREAM:
        outputs.insert(0, Path(output))
    check_outputs({photo: "the photo"}, outputs)
