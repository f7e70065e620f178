"""Make galleries, which are static web pages that compare results for photos.

This file defines the options of a gallery.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from gauss2svg.options import Interval, OptionGroup, Seed
from gauss2svg.photo import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.svg import check_text


@dataclass(frozen=True, kw_only=True)
class GalleryOptions(OptionGroup):
    """Options of a gallery."""

    jobs: Annotated[int, Interval(ge=1, le=256)] = 1
    """Number of worker processes. With several, each SVG takes longer."""

    threads: Annotated[int | None, Interval(ge=1)] = None
    """Number of CPU threads of each process. By default the processes share the cores."""

    seed: Seed = 0
    """Random seed. The same seed gives the same files."""

    photo_size: Annotated[int, Interval(ge=1, le=16383)] = 2048  # WebP allows at most 16383 px
    """Longest side (px). Larger photos are reduced to it first."""

    max_pixels: Annotated[int, Interval(ge=1, le=MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo. Larger photos are refused before they are decoded."""

    peer_timeout: Annotated[float, Interval(ge=1e-3, le=1e6)] = 3600.0
    """Maximum time (s) that another tool may take for a photo."""

    title: Annotated[str, check_text] = "Photos as Gaussians"
    """Title of the pages."""
