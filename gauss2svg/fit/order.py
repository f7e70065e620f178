"""Compositing order by segments of the image, for files with a layer for each segment.

Shapes are kept in that order from the start, so that the fit makes up for it, and centres that
have left their segment at the end are pulled back (docs/decisions/fit.md).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.state import State

# From (n, 2) positions, as shares of width and height, to the (n,) segment under each.
SegmentAt = Callable[[NDArray[np.float64]], NDArray[np.intp]]


class SegmentOrder:
    """Keeps the shapes of each round in the order of the segments under their centres.

    segment_at  finds the segments
    home        (n, 2) centres at the time of `fix`, as shares of width and height, or None
    """

    def __init__(self, segment_at: SegmentAt) -> None:
        self._segment_at = segment_at
        self.home: NDArray[np.float64] | None = None

    def grouped_by_segment(self, state: State, width: float, height: float) -> State:
        """The state in that order; positions in px of an image of width x height."""
        segment = self._segment_at(state.mean / [width, height])
        return state.select(np.lexsort((segment, state.round_index)))

    def fix(self, state: State, width: float, height: float) -> State:
        """The state in that order, whose segments `kept` returns shapes to."""
        state = self.grouped_by_segment(state, width, height)
        self.home = state.mean / [width, height]
        return state

    def kept(self, state: State, width: float, height: float) -> State:
        """The state with those centres pulled back that have left their segment since `fix`.

        Each returns on a straight line until it is inside: some tenths of a pixel, where another
        place in the order could change the render altogether.
        """
        if self.home is None:
            return state
        now = state.mean / [width, height]
        segment = self._segment_at(self.home)
        left = self._segment_at(now) != segment
        inside, outside = self.home[left], now[left]
        # Bisections of the way back into the segment.
        for _ in range(8):
            middle = 0.5 * (inside + outside)
            within = self._segment_at(middle) == segment[left]
            inside = np.where(within[:, None], middle, inside)
            outside = np.where(within[:, None], outside, middle)
        mean = state.mean.copy()
        mean[left] = inside * [width, height]
        return dataclasses.replace(state, mean=mean)
