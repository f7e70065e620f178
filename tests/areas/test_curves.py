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


def test_pieces_of_one_curve_become_one_and_corners_stay():
    segment, curved = merged(cubic(ARC, 61), range(0, 61, 6), 0.01)
    assert curved.tolist() == [True]
    assert KDTree(cubic(ARC, 2000)).query(cubic(segment[0], 99))[0].max() < 0.1
    ends = np.linspace(0, 20, 41)
    bent = np.stack([np.minimum(ends, 10), np.maximum(ends - 10, 0)], axis=1)
    segment, curved = merged(bent, range(0, 41, 4), 0.01)
    assert curved.tolist() == [False, False]
    assert segment[:, [0, 3]].tolist() == [[[0, 0], [10, 0]], [[10, 0], [10, 10]]]
