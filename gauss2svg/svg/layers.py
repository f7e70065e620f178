"""Layers of a document: rounds, and in each the segments of the picture.

Shapes of a segment are one group, so they follow each other: the painter's order within a round
becomes that of the segments. Whatever fits or measures a scene is to have it in that order.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene

Labels = NDArray[np.integer] | None  # (rows, columns), spread over the canvas


def segment_of(scene: Scene, labels: NDArray[np.integer]) -> NDArray[np.intp]:
    """(n,) label under each shape's centre; a centre off the canvas has that of its edge."""
    rows, columns = labels.shape
    across = np.clip(scene.mean[:, 0] * (columns / scene.width), 0, columns - 1)
    down = np.clip(scene.mean[:, 1] * (rows / scene.height), 0, rows - 1)
    return labels[down.astype(np.intp), across.astype(np.intp)].astype(np.intp)


def layer_order(scene: Scene, labels: NDArray[np.integer]) -> NDArray[np.intp]:
    """(n,) indices of the shapes by round, then by segment, then as they were."""
    return np.lexsort((segment_of(scene, labels), scene.rounds))


def arranged(scene: Scene, labels: Labels) -> Scene:
    """The scene in the order of its file: that of layer_order, or as it is without labels."""
    return scene if labels is None else scene.select(layer_order(scene, labels))


def runs(values: Sequence[int]) -> Iterator[tuple[int, slice]]:
    """Each value with the slice of neighbours that have it, in order."""
    begin = 0
    for end in range(1, len(values) + 1):
        if end == len(values) or values[end] != values[begin]:
            yield values[begin], slice(begin, end)
            begin = end
