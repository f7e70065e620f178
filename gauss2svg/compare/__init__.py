"""Comparisons: photos are vectorised in several variants, and reports compare the results.

A variant is a preset, a number of Gaussians, other settings, or another tool (modules `variants`
and `peers`). For each photo and each variant there is a task. The module `run` does a task: it
makes the file and measures it. The module `grid` stores the results as records. Two modules report
on the records: `table` writes a benchmark, and `pages` writes a gallery. `chart` draws the charts
of both. `records` measures the cost of a run and describes the machine.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from gauss2svg.options import Interval, OptionGroup
from gauss2svg.photo import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.svg import check_text


@dataclass(frozen=True, kw_only=True)
class BenchOptions(OptionGroup):
    """Options of a benchmark."""

    # The limit is 1e6 s, because system calls refuse a timeout of more than 24 days.
    peer_timeout: Annotated[float, Interval(ge=1e-3, le=1e6)] = 300.0
    """Maximum time (s) that another tool may take for a photo."""

    threads: Annotated[int | None, Interval(ge=1)] = None
    """Number of CPU threads of gauss2svg. The default is one for each core."""


@dataclass(frozen=True, kw_only=True)
class GalleryOptions(OptionGroup):
    """Options of a gallery."""

    jobs: Annotated[int, Interval(ge=1, le=256)] = 1
    """Number of worker processes. With several, each SVG takes longer."""

    threads: Annotated[int | None, Interval(ge=1)] = None
    """Number of CPU threads of each process. By default the processes share the cores."""

    photo_size: Annotated[int, Interval(ge=1, le=16383)] = 2048  # WebP allows at most 16383 px
    """Longest side (px). Larger photos are reduced to it first."""

    max_pixels: Annotated[int, Interval(ge=1, le=MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo. Larger photos are refused before they are decoded."""

    peer_timeout: Annotated[float, Interval(ge=1e-3, le=1e6)] = 3600.0
    """Maximum time (s) that another tool may take for a photo."""

    title: Annotated[str, check_text] = "Photos as Gaussians"
    """Title of the pages."""
