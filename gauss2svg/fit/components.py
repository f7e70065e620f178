"""Connected components of a plane of whole numbers, as skimage.measure.label has them.

A kernel of our own: scikit-image takes a third of a second to import (docs/decisions/start.md).
"""

import numpy as np

from gauss2svg.kernel_cache import cached


@cached(nogil=True)
def components_of(levels):  # numba kernel
    """Components (h, w) of equal numbers in levels (h, w), which touch along sides or at corners.

    They are numbered from 1 in the order of their first pixels, row by row; levels of 0 are 0.
    """
    height, width = levels.shape
    # Of each pixel an earlier one of its component, or itself: union-find.
    parent = np.zeros(height * width, np.int64)
    for y in range(height):
        for x in range(width):
            level = levels[y, x]
            if level == 0:
                continue
            at = y * width + x
            root = at
            for k in range(4):  # left, and three above
                ny, nx = (y, x - 1) if k == 0 else (y - 1, x + k - 2)
                if ny < 0 or nx < 0 or nx >= width or levels[ny, nx] != level:
                    continue
                other = ny * width + nx
                while parent[other] != other:
                    parent[other] = parent[parent[other]]
                    other = parent[other]
                if other < root:
                    parent[root] = other
                    root = other
                else:
                    parent[other] = root
            parent[at] = root
    found = np.zeros((height, width), np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            if levels[y, x] == 0:
                continue
            at = y * width + x
            root = parent[at]
            while parent[root] != root:
                root = parent[root]
            parent[at] = root
            if root == at:
                count += 1
                found[y, x] = count
            else:
                found[y, x] = found[root // width, root % width]
    return found
