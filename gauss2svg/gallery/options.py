"""What a gallery is asked for, besides its photos and variants."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from gauss2svg.errors import InputError, must_be
from gauss2svg.options import Number, OptionGroup, Whole
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS

_MOST_JOBS = 256


def shown_title(name: str, title: Any) -> str:
    """A title as UTF-8 can hold it; raises InputError for what is not text, or empty."""
    if not isinstance(title, str) or not title.strip():
        raise InputError(must_be(name, "text that is not empty", title))
    return title.encode(errors="backslashreplace").decode()


@dataclass(frozen=True, kw_only=True)
class GalleryOptions(OptionGroup):
    """How a gallery is made."""

    jobs: Annotated[int, Whole(1, _MOST_JOBS)] = 1
    """Processes that work at once; with several the seconds of each are longer."""

    threads: Annotated[int | None, Whole(1)] = None
    """CPU threads of each process; the cores are shared out if not given."""

    seed: Annotated[int, Whole(0, 2**63 - 1)] = 0
    """Seed, as of the main command."""

    photo_size: Annotated[int | None, Whole(1)] = None
    """Longest side (px) to which photos are resized first."""

    max_pixels: Annotated[int, Whole(1, MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo, checked before it is decoded."""

    peer_timeout: Annotated[float, Number(1e-3, 1e6)] = 3600.0
    """Seconds that another tool may take for a photo."""

    title: Annotated[str, shown_title] = "Photos as Gaussians"
    """Title of the pages."""
