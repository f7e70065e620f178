"""Displays of the progress of a run: a bar in a terminal, or the forming picture in a notebook."""

from __future__ import annotations

import html
import importlib
import shutil
import sys
import threading
import time
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import on_one_line, several
from gauss2svg.fit import FitProgress
from gauss2svg.pipeline.options import Progress, ProgressCallback

if TYPE_CHECKING:
    from gauss2svg.scene import Scene

LINE_EVERY_S = 60  # a run of one night prints only hundreds of lines
_PHASES = {
    "read": "reading the photo",
    "areas": "finding areas",
    "fit": "fitting",
    "write": "writing the SVG",
    "measure": "rasterising and measuring the SVG",
}


def watched(
    progress: ProgressCallback | bool | None,
) -> AbstractContextManager[ProgressCallback | None]:
    """Return a context manager that yields the callback of a run, or None.

    If `progress` is a function, this function is the callback. If `progress` is True, the callback
    shows the run in a notebook or in a terminal.
    """
    if progress is True:
        return _notebook() if _is_in_notebook() else _terminal()
    return nullcontext(None if progress is False else progress)


@contextmanager
def counting(quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar of tasks in a notebook or a terminal, and yield a function that moves the bar.

    The function is update(current step, finished tasks, number of tasks). If there is neither a
    notebook nor a terminal, it prints a line every minute instead.

    quiet  whether to show nothing
    """
    start = "reading the photos"
    bar = _notebook_bar() if _is_in_notebook() else terminal_bar(start, prints_lines=True)
    with nullcontext() if quiet else bar as show:

        def update(now: str, done: int, total: int) -> None:
            if show is not None:
                show(f"{done:,} of {total:,}{f': {now}' if now else ''}", done / max(total, 1))

        yield update


def _is_in_notebook() -> bool:
    # In a notebook, IPython has been imported already. Elsewhere, it need not be installed.
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


@contextmanager
def terminal_bar(
    text: str, prints_lines: bool = False
) -> Iterator[Callable[[str, float | None], None] | None]:
    """Show a bar with a text, and yield a function update(text, share) that changes it.

    share         share of the work that is done, 0..1, or None if it is unknown
    prints_lines  whether to print the text every minute if standard error is not a terminal. If it
                  is False, yield None then.
    """
    is_terminal = getattr(sys.stderr, "isatty", bool)()  # it is None without a console
    if not (is_terminal or prints_lines):
        yield None
        return
    state, begun, ended = (text, 0.0), time.monotonic(), threading.Event()

    def update(text: str, share: float | None) -> None:
        nonlocal state
        state = text, state[1] if share is None else share

    def draw() -> None:
        (text, share), seconds = state, int(time.monotonic() - begun)
        text = f"{seconds // 60}:{seconds % 60:02} {on_one_line(text)}"
        if not is_terminal:
            print(f"gauss2svg: {text}", file=sys.stderr)
            return
        width = max(0, min(24, columns() - len(text) - 2))
        bar = "\N{FULL BLOCK}" * round(width * share)
        put(f"{bar:{width}} {text}")

    def put(line: str) -> None:
        # A wide character takes two columns.
        free = columns() - 1 - sum(unicodedata.east_asian_width(c) in "WF" for c in line)
        print(f"\r{line:{free}.{free}}\r", end="", file=sys.stderr, flush=True)

    def redraw() -> None:
        while not ended.wait(0.1 if is_terminal else LINE_EVERY_S):
            draw()
        if is_terminal:
            draw()
            put("")

    # A thread draws the bar, so that the time also moves while the program draws.
    thread = threading.Thread(target=redraw, daemon=True)
    thread.start()
    try:
        yield update
    finally:
        ended.set()
        thread.join()


def columns() -> int:
    """Return the width of the terminal, or 80 if it is not known."""
    return shutil.get_terminal_size().columns


@contextmanager
def _terminal() -> Iterator[ProgressCallback | None]:
    with terminal_bar("starting") as show:
        yield None if show is None else lambda progress: show(*_text_and_share(progress))


class FrameMaker:
    """Maker of the frames that show a fit in progress.

    The first frame is due at once. A later frame is due when enough time has passed since the last
    one. Two limits determine this time: the number of frames per second, and the share of the CPU
    time that frames may take.

    size  arguments of gauss2svg.render.as_jpeg
    """

    def __init__(self, most_a_second: float = 15, **size: int) -> None:
        self._between_s, self._size = 1 / most_a_second, size
        self._due = self._cpu_due = 0.0

    def frame(self, scene: Callable[[], Scene]) -> bytes:
        """Return a JPEG of the scene that `scene` returns. If no frame is due, return b""."""
        started, cpu_started = time.perf_counter(), time.process_time()
        if started < self._due or cpu_started < self._cpu_due:
            return b""
        from gauss2svg.render import as_jpeg

        data = as_jpeg(scene(), **self._size)
        cpu_ended = time.process_time()
        self._due = started + self._between_s
        # Frames may take 6 % of the CPU time of a fit (docs/decisions/studio.md). This limit counts
        # CPU time and not wall-clock time, which other programs on the machine would change.
        self._cpu_due = cpu_ended + (cpu_ended - cpu_started) / 0.06
        return data


@contextmanager
def _notebook_bar() -> Iterator[Callable[..., None]]:
    """Show a bar in the output of the notebook's cell, and yield a function that changes it.

    The function is that of `terminal_bar`, with a third argument: HTML to show above the bar. An
    empty text shows no bar.
    """
    display: Any = importlib.import_module("IPython.display")
    handle = display.display(display.HTML("starting"), display_id=True)

    def show(text: str, share: float | None, above: str = "") -> None:
        bar = "<progress>" if share is None else f'<progress value="{share:.3f}">'
        bar = f"{bar}</progress> {html.escape(text)}" if text else ""
        handle.update(display.HTML(above + bar))

    yield show


@contextmanager
def _notebook() -> Iterator[ProgressCallback]:
    """Yield a callback that updates the output of the notebook's cell.

    At the end, the last picture and its figures stay in the output.
    """
    from gauss2svg.render import as_jpeg
    from gauss2svg.svg.file import image

    most_side = 400  # px. Frames are small and few, because notebooks keep all of them as text
    frames = FrameMaker(most_a_second=4, most_side=most_side)
    newest: FitProgress | None = None
    last = ""

    def picture(frame: bytes, fit: FitProgress) -> str:
        return image(frame, "image/jpeg", "the picture so far") + f"<br/>{_figures(fit)}<br/>"

    def update(progress: Progress) -> None:
        nonlocal last, newest
        if progress.fit is not None:
            newest = progress.fit
            frame = frames.frame(newest.scene)
            if not frame:
                return
            last = picture(frame, newest)
        show(*_text_and_share(progress), last)

    with _notebook_bar() as show:
        try:
            yield update
        finally:
            # The last call of `update` may not have shown its picture, because it came too soon
            # after another one. So the newest picture is shown now.
            if newest is not None:
                last = picture(as_jpeg(newest.scene(), most_side), newest)
            show("", None, last)


def _text_and_share(progress: Progress) -> tuple[str, float | None]:
    """Return a text about the state of the run, and the share of the fit that is done.

    The share is in 0..1, or None if it is unknown.
    """
    now = progress.fit
    if now is None:
        return _PHASES[progress.phase], None
    texts = {"additive": "fitting additively", "correct": "correcting the number of shapes"}
    texts["areas"] = "refining areas"
    text = texts.get(progress.phase, f"fitting, round {now.round}")
    return f"{text}, {now.remaining_s:.0f} s left: {_figures(now)}", now.done


def _figures(now: FitProgress) -> str:
    shapes = several(now.gaussians, "shape") if now.gaussians or not now.areas else ""
    return ", ".join(filter(None, [now.areas, shapes, f"{now.psnr:.2f} dB"]))
