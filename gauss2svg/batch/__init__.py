"""Vectorise many photos, in processes of this machine or by the workers of a cluster.

A batch writes an SVG and a record of each photo, and one table of all photos.
"""

from dataclasses import dataclass
from typing import Annotated

from gauss2svg.options import Interval, OptionGroup


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Options of the processes that run a batch."""

    # Few machines have 1024 cores, so a larger number is probably a mistake.
    workers: Annotated[int | None, Interval(ge=1, le=1024)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""
