"""Layers of a document: rounds, and within each round the segments of the image.

Shapes of a segment form one group, so that painter's order within a round becomes the order of the
segments. Anything that fits or measures a scene must use that order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene

Labels = NDArray[np.integer] | None  # (rows, columns), spread over the canvas


def segment_at(labels: NDArray[np.integer], position: NDArray[np.float64]) -> NDArray[np.intp]:
    """(n,) label under positions (n, 2), which are shares of the canvas; off it, its edge's."""
    rows, columns = labels.shape
    across, down = np.clip(position * [columns, rows], 0, [columns - 1, rows - 1]).astype(np.intp).T
    return labels[down, across].astype(np.intp)


def segment_of(scene: Scene, labels: NDArray[np.integer]) -> NDArray[np.intp]:
    """(n,) label under each shape's centre."""
    return segment_at(labels, scene.mean / [scene.width, scene.height])


def grouped_by_segment(scene: Scene, labels: Labels) -> Scene:
    """The scene in the order of its file: by round, by segment, then as it was.

    Without labels it is as it was.
    """
    if labels is None:
        return scene
    return scene.select(np.lexsort((segment_of(scene, labels), scene.round_index)))


def runs(values: Sequence[int]) -> Iterator[tuple[int, slice]]:
    """Each value with the slice of neighbours that have it, in order."""
    begin = 0
    for end in range(1, len(values) + 1):
        if end == len(values) or values[end] != values[begin]:
            yield values[begin], slice(begin, end)
            begin = end
