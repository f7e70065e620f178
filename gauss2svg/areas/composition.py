"""Kernels that draw layers over each other, and move their outlines by steps of Gauss-Newton.

gauss2svg/core/composition.c says what they do.
"""

from __future__ import annotations

import numpy as np

from gauss2svg.areas.kernels import Floats, Ints
from gauss2svg.core import Kernel
from gauss2svg.portable import dot

ACROSS = 6  # places along the end of a stroke (ACROSS of gauss2svg/core/composition.c)

compose_layers = Kernel(
    "compose_layers",
    "int int int float64 bool int64 bool int64 float64 int64 float64 int64 float64 float32 int64"
    " int64 float64 float32 float32 float32",
)
weigh_layers = Kernel(
    "weigh_layers",
    "int int int float64 int64 float64 float32 int64 int64 float32 float32 float32",
)
list_samples = Kernel(
    "list_samples",
    "int int int float64 bool int64 bool bool int64 float64 float64 int64 int64 float32 int64 int64"
    " float64 float64",
)
_project_samples = Kernel(
    "project_samples",
    "int int int int int int64 int64 float64 float64 int64 int64 float64 float64 float64 float64",
)


class Samples:
    """Samples of outlines, as a linear map from moves of the parameters to pixels.

    place, owner  (n,) row of each sample's pixel in an image (m, c), and its segment
    jacobian, weights  (n, 9) and (n, c) as list_samples writes them
    column   (k, 9) parameters by which the derivatives of a segment's samples are
    ties     (3, t) parameter, node and master
    factors  (2, t): a parameter is the sum of the node and the master, times these
    """

    def __init__(
        self, place: Ints, owner: Ints, jacobian: Floats, weights: Floats, column: Ints, ties: Ints,
        factors: Floats,
    ) -> None:  # fmt: skip
        self._arrays = (place, owner, jacobian, weights, column, ties, factors)

    def squared(self) -> Samples:
        """Return the samples with squared derivatives and factors."""
        place, owner, jacobian, weights, column, ties, factors = self._arrays
        return Samples(place, owner, jacobian**2, weights**2, column, ties, factors**2)

    def gradient(self, image: Floats, count: int, p: Floats | None = None) -> Floats:
        """Return the gradient (count,) by the parameters of a gradient by pixels, image (m, c).

        p: (count,) a move, whose pixels are written to `image` first. Its tied parameters are
        replaced. None: `image` stays as it is.
        """
        result = np.empty(count)
        n, channels = self._arrays[3].shape
        _project_samples(
            n, channels, len(image), count, self._arrays[5].shape[1], *self._arrays, p, image,
            result,
        )  # fmt: skip
        return result

    def solve(
        self, image: Floats, r: Floats, diagonal: Floats, damping: Floats, steps: int
    ) -> Floats:
        """Solve (J'J + D) step = r by conjugate gradients, preconditioned by the diagonal.

        image     (m, c) buffer
        r         (u,) right side
        diagonal  (u,) of J'J + D, all of it positive
        damping   (u,) D
        Return the step (u,). Parameters that follow from others have the step 0.
        """
        step, p = np.zeros_like(r), r / diagonal
        rz = first = dot(r, p)
        for _ in range(steps):
            # So no division is by 0: D is positive, and p is not 0 if rz is not.
            if rz < 1e-8 * first or rz < 1e-18:
                break
            product = self.gradient(image, len(r), p.copy()) + damping * p
            length = rz / dot(p, product)
            step += length * p
            r = r - length * product
            new = dot(r, r / diagonal)
            p = r / diagonal + new / rz * p
            rz = new
        return step
