"""A progress bar for a known number of steps, on standard error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def counting_bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Yields update(current step, finished steps, total steps).

    Nothing is shown if quiet or if standard error is not a terminal.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    console = Console(stderr=True)
    columns = (
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    shown = console.is_terminal and not quiet
    with Progress(*columns, console=console, transient=True, disable=not shown) as bar:
        task = bar.add_task("reading the photos", total=None)

        def update(now: str, done: int, total: int) -> None:
            # A file name may contain markup.
            bar.update(task, description=escape(now), completed=done, total=total)

        yield update
