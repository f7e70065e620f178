"""The command line: `gauss2svg IMAGE -o OUT.svg`."""

from __future__ import annotations

import logging
import os
import re
import shlex
import signal
import sys
import time
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter

from gauss2svg.errors import Gauss2SvgError, InputError, on_one_line
from gauss2svg.interruption import STATUS_OF_SIGNAL, Terminated, interruptible, terminable
from gauss2svg.photo.chatter import own_standard_error
from gauss2svg.streams import drop_output, hold_closed_descriptors
from gauss2svg.version import __version__

_BEGUN = time.perf_counter()
STATUS_BAD_INPUT = 2
STATUS_INTERRUPTED = STATUS_OF_SIGNAL + signal.SIGINT
STATUS_TERMINATED = STATUS_OF_SIGNAL + signal.SIGTERM

app = App(
    name="gauss2svg",
    version=__version__,
    help="Turn a photo into an SVG of Gaussians, and measure how true it is.",
    suppress_keyboard_interrupt=False,  # main says what became of the files
)
# By name, so that it is loaded only where it is asked for.
app.command(
    "gauss2svg.bench.command:bench_command",
    name="bench",
    help="Vectorise photos by many settings, and write tables and plots of cost and fidelity.",
)
app.command(
    "gauss2svg.gallery.command:gallery_command",
    name="gallery",
    help="Write pages that show what becomes of photos, beside them and side by side.",
)
app.command(
    "gauss2svg.scoring.command:check_command",
    name="check",
    help="Measure how true any SVG is to a photo.",
)


@app.default
def vectorize_command(
    image: Annotated[str, Parameter(allow_leading_hyphen=True)],
    *,
    output: Annotated[str, Parameter(name=["--output", "-o"], allow_leading_hyphen=True)],
    gaussians: int | Literal["auto"] = "auto",
    target_psnr: float | None = None,
    max_bytes: str | None = None,
    time_limit: float | None = None,
    quality: Literal["draft", "fast", "balanced", "high", "max"] = "balanced",
    iterations: int | None = None,
    init: Literal["selective", "error", "random", "live"] = "selective",
    schedule: Literal["exponential", "linear", "all-at-once"] = "exponential",
    loss: Literal["mse", "l1", "mse+ssim", "l1+ssim"] = "mse",
    ssim_weight: float | None = None,
    per_round: int | None = None,
    round_iterations: int | None = None,
    relocate: bool = True,
    blend: Literal["over", "add"] = "over",
    portable: Annotated[bool, Parameter(negative="")] = False,
    falloff: Literal["gaussian", "adaptive"] | None = None,
    max_size: int | None = None,
    max_memory: str | None = None,
    form: Literal["gradient", "blur", "hybrid"] = "gradient",
    palette: int | None = None,
    stops: Literal[5, 6, 8, 10, 12] | None = None,
    precision: float | None = None,
    seed: int = 0,
    dtype: Literal["float32", "float64"] = "float32",
    threads: int | None = None,
    renderer: Literal["resvg", "cairo", "chromium", "librsvg", "firefox", "inkscape"] = "resvg",
    title: str = "Vectorised photo",
    alt: str | None = None,
    size: str | None = None,
    aspect: str | None = None,
    segments: str | None = None,
    animate: float | None = None,
    fragments: Annotated[bool, Parameter(negative="")] = False,
    outline: Path | None = None,
    gzip: Annotated[bool, Parameter(negative="")] = False,
    matte: str | None = None,
    finish: Literal["resvg", "cairo", "chromium", "all"] | None = None,
    max_pixels: int = 89_478_485,
    report: Path | None = None,
    preview: Path | None = None,
    save_scene: Path | None = None,
    learning_rate: float = 1.0,
    checkpoint: Path | None = None,
    checkpoint_every: float = 30.0,
    resume: Path | None = None,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Turn a photo into an SVG of Gaussians, and measure how true it is.

    Parameters
    ----------
    image
        The photo: JPEG, PNG, WebP, TIFF, GIF, BMP or AVIF; - reads standard input.
    output
        The SVG to write; - writes standard output.
    gaussians
        How many; auto: as many as the scene is worth at this quality.
    target_psnr
        Decibels that the drawn SVG shall have, with as few Gaussians as reach it.
    max_bytes
        Most bytes of the file: 150000, 150k, 1.5M.
    time_limit
        Seconds for everything; the fit takes the time that there is.
    quality
        What a kilobyte must buy, from the fastest to the most exact.
    iterations
        Steps of the optimiser; as many as the quality says if not given.
    init
        Where new Gaussians go: on the largest components of the error, by squared error, at random,
        or on components as the paper's formula says.
    schedule
        How a given number is reached from round to round.
    loss
        What the fit makes small; those with ssim keep more texture and take longer.
    ssim_weight
        Of structural similarity in those losses, 0 to 1; 0.2 if not given.
    per_round
        How many a round adds: exponential ones 1, 2, 4, .. up to this, linear ones this.
    round_iterations
        Steps of the optimiser in each round.
    relocate
        Place anew, on the way, what is missed least.
    blend
        over: shapes are painted over each other; add: the paper's sum of Gaussians of signed
        colours, in a file for resvg, browsers, librsvg and Inkscape.
    portable
        Convert the sum to shapes painted over each other, for every renderer.
    falloff
        adaptive, the default: each shape learns how crisp its rim is; gaussian: all are soft, as
        in the paper and in every sum.
    max_size
        Longest side in pixels of the picture that the fit runs on.
    max_memory
        What the process may take, by an estimate: 500M, 2G; 80 % of what is free if not given.
        Over it the fit runs on fewer pixels.
    form
        Of shapes in the file: gradient, for every renderer; blur, smaller, and hybrid, only large
        shapes blurred, for Chromium, Firefox and Inkscape.
    palette
        Most gradients in the file, 0 for all: fewer make it smaller.
    stops
        Stops of a gradient; as many as the quality says if not given.
    precision
        Of coordinates, in pixels, such as 0.05; as fine as the quality says if not given.
    seed
        The same seed gives the same file; selective placement hardly draws at random.
    dtype
        Of what the fit computes; float64 takes twice as long and is no truer.
    threads
        CPU threads; one for each core if not given.
    renderer
        Which renderer draws the SVG to measure it; the last four if they are installed.
    title
        The picture's name, which browsers and screen readers tell.
    alt
        What is to be seen in it, for screen readers.
    size
        Its width where it is printed or placed, such as 120mm, 5in or 300px; photo: as the photo's
        resolution says.
    aspect
        How it fills a frame of other proportions: preserveAspectRatio, such as 'xMidYMid slice'.
    segments
        Layers inside of the rounds: about how many superpixels, or a label image of the photo's
        size.
    animate
        Seconds in which the rounds fade in, where motion is welcome; the end is the still picture.
    fragments
        Opened as out.svg#round-3 the file shows the picture up to that round.
    outline
        Write the shapes as bare strokes there, as another SVG.
    gzip
        Gzip the SVG, also where its name does not end in .svgz; --max-bytes holds for the file.
    max_pixels
        Most pixels of the photo, told by its header before it is decoded; up to 178956970.
    matte
        Colour over which a transparent photo is shown first: white, black, #fa0 or #ffaa00; the SVG
        is transparent where the photo is if not given.
    finish
        Last changes by what this renderer, or all three, really draws: slow, a little truer.
    report
        Write all numbers of the run there, as JSON.
    preview
        Write what the renderer drew there, as PNG.
    save_scene
        Write the fitted Gaussians there, as NPZ.
    learning_rate
        Times the usual sizes of the fit's steps.
    checkpoint
        Keep there where the fit stands, to go on from by --resume.
    checkpoint_every
        Seconds between two checkpoints.
    resume
        A checkpoint of this same command, from which the fit goes on to the same file.
    quiet
        No progress and no summary.

    """
    from gauss2svg.atomic import write_all_atomically
    from gauss2svg.outputs import as_json, as_png, check_targets, refuse_option_like
    from gauss2svg.pipeline import vectorize
    from gauss2svg.scene import ADD
    from gauss2svg.streams import STANDARD_STREAM, standard_stream
    from gauss2svg.svg import file_bytes, is_svgz
    from gauss2svg.terminal import print_summary, show_progress

    refuse_option_like(image, output)
    if outline is not None and blend == ADD and not portable:
        raise InputError(
            "--outline is asked for with --blend add, whose signed colours have no strokes; leave "
            "it out, or add --portable"
        )
    to_stdout = output == STANDARD_STREAM
    targets = [path for path in (outline, report, preview, save_scene) if path is not None]
    if not to_stdout:
        targets.insert(0, Path(output))
    inputs = {image: "the photo"}
    count = None
    if segments is not None and re.fullmatch(r"[+-]?[0-9]{1,9}", segments):
        count = int(segments)
    elif segments is not None:
        inputs[segments] = "the label image"
    if resume is not None:
        inputs[str(resume)] = "the checkpoint"
    check_targets(inputs, targets)
    if checkpoint is not None:  # it may be the one that is gone on from
        inputs.pop(str(resume), None)
        check_targets(inputs, [*targets, checkpoint])

    source: Any = image
    if image == STANDARD_STREAM:
        source = standard_stream(sys.stdin, "input").read()
    stdout = standard_stream(sys.stdout, "output") if to_stdout else None
    with interruptible() as interruption, show_progress(quiet) as progress:
        result = vectorize(
            source,
            gaussians=gaussians,
            target_psnr=target_psnr,
            max_bytes=max_bytes,
            time_limit=time_limit,
            quality=quality,
            iterations=iterations,
            init=init,
            schedule=schedule,
            loss=loss,
            ssim_weight=ssim_weight,
            per_round=per_round,
            round_iterations=round_iterations,
            relocate=relocate,
            blend=blend,
            portable=portable,
            max_size=max_size,
            max_memory=max_memory,
            form=form,
            palette=palette,
            stops=stops,
            precision=precision,
            seed=seed,
            dtype=dtype,
            falloff=falloff,
            threads=threads,
            renderer=renderer,
            finish=finish,
            title=title,
            alt=alt,
            size=size,
            aspect=aspect,
            segments=segments if count is None else count,
            animate=animate,
            fragments=fragments,
            gzip=gzip or is_svgz(output),
            learning_rate=learning_rate,
            checkpoint=checkpoint,
            checkpoint_every=checkpoint_every,
            resume=resume,
            max_pixels=max_pixels,
            matte=matte,
            progress=progress,
            stop=interruption.asked,
            started=_BEGUN if time_limit is not None else None,
        )
    svg = file_bytes(result.svg, bool(result.report["gzip"]))
    files: dict[str | os.PathLike[str], bytes] = {} if to_stdout else {output: svg}
    if outline is not None:
        files[outline] = file_bytes(result.outline(), is_svgz(outline))
    if preview is not None:
        files[preview] = as_png(result.raster)
    if save_scene is not None:
        files[save_scene] = _npz(result.scene)
    if report is not None:
        files[report] = as_json(result.report)
    if stdout is not None:
        stdout.write(svg)
        stdout.flush()
    write_all_atomically(files)
    if quiet:
        for line in result.report["unreached"]:  # bad news is told all the same
            print(f"gauss2svg: {line}", file=sys.stderr)
    else:
        print_summary(result.report, None if to_stdout else output)
    if result.report["checkpoint_trouble"] is not None:
        print(f"gauss2svg: {result.report['checkpoint_trouble']}", file=sys.stderr)
        checkpoint = None  # nothing to go on from
    if interruption.signal is not None:
        _tell_interrupted(result.report, "standard output" if to_stdout else output, checkpoint)
    return interruption.status


def _tell_interrupted(report: dict[str, Any], output: str, checkpoint: Path | None) -> None:
    again = ""
    if checkpoint is not None:
        again = f"; go on with --resume {shlex.quote(str(checkpoint))}"
    print(
        f"gauss2svg: interrupted after {report['iterations']} iterations; the best so far is in "
        f"{output}{again}",
        file=sys.stderr,
    )


def _npz(scene: Any) -> bytes:
    import io

    stream = io.BytesIO()
    scene.save(stream)
    return stream.getvalue()


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status: 0, or 2 with one line on standard error.

    130 and 143 are those of Ctrl-C and SIGTERM, also where the best so far was written. 1 is that
    of a benchmark or a gallery of which something failed, and of a check under its --min-psnr.
    """
    hold_closed_descriptors()
    warnings.filterwarnings("ignore", module="PIL")  # told as errors where they matter
    for library in ("PIL", "tifffile"):  # whose complaints would be more lines than one
        logging.getLogger(library).addHandler(logging.NullHandler())
    try:
        with terminable(), own_standard_error():
            status = app(
                arguments, exit_on_error=False, print_error=False, result_action="return_value"
            )
    except CycloptsError as error:
        return _refuse(f"{' '.join(str(error).split()).rstrip('.')}; see gauss2svg --help")
    except Gauss2SvgError as error:
        return _refuse(str(error))
    except MemoryError as error:
        return _refuse(f"out of memory ({error}); try a smaller photo or fewer --gaussians")
    except OSError as error:  # a stream that broke: files are Gauss2SvgErrors already
        drop_output()
        return _refuse(f"{error.strerror or error}; nothing more was written")
    except (KeyboardInterrupt, SystemError) as error:
        # A Ctrl-C inside a kernel arrives wrapped in numba's SystemError.
        cause = error if isinstance(error, KeyboardInterrupt) else None
        cause = cause or error.__cause__ or error.__context__
        if not isinstance(cause, KeyboardInterrupt):
            raise
        print("gauss2svg: interrupted; every file is whole or untouched", file=sys.stderr)
        return STATUS_TERMINATED if isinstance(cause, Terminated) else STATUS_INTERRUPTED
    return status if isinstance(status, int) else 0


def run() -> None:
    """The command as a program: once its status is known, signals change nothing any more."""
    status = main()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _refuse(message: str) -> int:
    print(f"gauss2svg: {on_one_line(' '.join(message.split()))}", file=sys.stderr)
    return STATUS_BAD_INPUT


if __name__ == "__main__":
    run()
