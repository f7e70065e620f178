"""Properties of the curves through points."""

import numpy as np
import pytest
from outlines import cubic
from scipy.optimize import least_squares
from scipy.spatial import KDTree

from gauss2svg.areas.outlines import merged_path

ARC = np.array([[0, 0], [6, 4], [13, 5], [20, 0]])


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def merged(points, start, rate: float):
    """Return the segments that are left of pieces of an open polyline, and which are curved."""
    weight = np.ones(len(points))
    return merged_path(points, weight, np.array(start), None, False, 1 / 32, rate, 1e-4)[:2]


@pytest.mark.parametrize("seed", range(2))
def test_a_cubic_is_nearly_as_close_as_the_best_of_scipy(seed):
    rng = np.random.default_rng(seed)
    p = ARC + 0.5 * rng.normal(size=(4, 2))
    points = cubic(p, 60)
    points[1:-1] += 0.05 * rng.normal(size=(58, 2))

    def distances(handles):
        nodes = points[[0, -1]]
        curve = cubic(np.insert(nodes, 1, np.reshape(handles, (2, 2)), axis=0), 2000)
        return KDTree(curve).query(points)[0]

    (segment,), (is_curve,) = merged(points, [0, 59], 0.0)
    assert is_curve
    best = least_squares(distances, p[1:3].ravel(), diff_step=1e-3)
    assert rms(distances(segment[1:3])) < rms(best.fun) + 0.04  # px, after few rounds
