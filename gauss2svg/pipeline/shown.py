"""What `progress=True` shows: a bar in a terminal, the forming picture in a notebook."""

from __future__ import annotations

import html
import importlib
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from gauss2svg.fit.options import FitProgress
from gauss2svg.pipeline.run import Progress, ProgressCallback

_PHASES = {
    "read": "reading the photo",
    "compile": "preparing kernels (compiled on the first run, some seconds)",
    "fit": "fitting",
    "write": "writing the SVG",
    "measure": "rasterising and measuring the SVG",
}
_FITS = {"additive": "fitting additively", "correct": "correcting the number of Gaussians"}
# Of a notebook, whose messages are kept and sent as text.
_FRAMES_A_SECOND, _MOST_SIDE = 4, 400


def watched(
    progress: ProgressCallback | bool | None,
) -> AbstractContextManager[ProgressCallback | None]:
    """The callback of a run: the one that is given, for True one that shows the run."""
    if progress is not True:
        return nullcontext(None if progress is False else progress)
    # IPython runs, if at all, before this; elsewhere it need not be installed.
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return _notebook() if hasattr(shell, "kernel") else _terminal()


@contextmanager
def _terminal() -> Iterator[ProgressCallback | None]:
    """A callback that updates a bar on standard error; None where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, SpinnerColumn, TextColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        TextColumn("{task.fields[state]}"),
    )
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None, state="")

        def update(progress: Progress) -> None:
            description, done = _said(progress)
            total = None if done is None else 1.0
            state = (
                "" if progress.fit is None else f"{_figures(progress.fit)}, {_left(progress.fit)}"
            )
            bar.update(task, description=description, completed=done, total=total, state=state)

        yield update


@contextmanager
def _notebook() -> Iterator[ProgressCallback]:
    """A callback that updates one output of a cell; the last picture and its figures stay."""
    from gauss2svg.render.frame import FrameMaker
    from gauss2svg.svg.notebook import image

    display: Any = importlib.import_module("IPython.display")
    frames = FrameMaker(_FRAMES_A_SECOND, _MOST_SIDE)
    handle = display.display(display.HTML("starting"), display_id=True)
    last = phase = ""

    def update(progress: Progress) -> None:
        nonlocal last, phase
        description, done = _said(progress)
        if progress.fit is not None:
            frame = frames.frame(progress.fit.scene)
            if not frame:
                return
            last = (
                image(frame, "image/jpeg", "the picture so far") + f"<br/>{_figures(progress.fit)}"
            )
            description += f", {_left(progress.fit)}"
        elif progress.phase == phase:
            return
        phase = progress.phase
        bar = "<progress>" if done is None else f'<progress value="{done:.3f}">'
        handle.update(display.HTML(f"{last}<br/>{bar}</progress> {html.escape(description)}"))

    try:
        yield update
    finally:
        handle.update(display.HTML(last))


def _said(progress: Progress) -> tuple[str, float | None]:
    """What a run does, and how far it is in 0..1 where that is known."""
    now = progress.fit
    if now is None:
        return _PHASES[progress.phase], None
    return _FITS.get(progress.phase, f"fitting, round {now.round}"), now.done


def _figures(now: FitProgress) -> str:
    return f"{now.gaussians} Gaussians, {now.psnr:.2f} dB"


def _left(now: FitProgress) -> str:
    return f"{now.remaining_s:.0f} s left"
