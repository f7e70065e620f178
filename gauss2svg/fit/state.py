"""What the optimiser owns: raw Gaussians in working pixels, and Adam's memory of each."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, OVER, RHO_LIMIT, Scene
from gauss2svg.scene.falloff import CUT

FARTHEST = 1e9  # px, from the origin and of a shape: well within what a scene may have
PARAMETERS = 10  # shift along the two whitened axes, three of shape, opacity, r, g, b, ln beta
COLOR, COLOR_AND_BETA = slice(6, 9), slice(6, 10)


@dataclass
class State:
    """n raw Gaussians, bottom first; float64.

    mean         (n, 2) px
    factor       (n, 3) entries l11, l21, l22 of the covariance's Cholesky factor, px
    raw_opacity  (n,) logit of the opacity
    color        (n, 3) sRGB, signed where they are summed
    raw_beta     (n,) ln of the falloff's exponent; exactly 0 stays 0: a Gaussian for good
    round_index  (n,) int32
    first, second (n, PARAMETERS) Adam's moments; age (n,) steps taken
    """

    mean: NDArray[np.float64]
    factor: NDArray[np.float64]
    raw_opacity: NDArray[np.float64]
    color: NDArray[np.float64]
    raw_beta: NDArray[np.float64]
    round_index: NDArray[np.int32]
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    age: NDArray[np.float64]

    @classmethod
    def empty(cls) -> State:
        """A state of no Gaussians."""
        wide = np.zeros((0, PARAMETERS))
        return cls(
            mean=np.zeros((0, 2)),
            factor=np.zeros((0, 3)),
            raw_opacity=np.zeros(0),
            color=np.zeros((0, 3)),
            raw_beta=np.zeros(0),
            round_index=np.zeros(0, np.int32),
            first=wide,
            second=wide.copy(),
            age=np.zeros(0),
        )

    def __len__(self) -> int:
        return len(self.mean)

    def copy(self) -> State:
        """With arrays of its own, which steps of this one leave alone."""
        return State(**{name: array.copy() for name, array in self.state_dict().items()})

    def state_dict(self) -> dict[str, Any]:
        """Its arrays by name, for a checkpoint."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @classmethod
    def from_state_dict(cls, memory: dict[str, Any]) -> State:
        """The state that gave this memory; raises InputError for arrays that cannot be one's."""
        usual = cls.empty()
        count = len(np.atleast_1d(memory.get("mean", [])))
        for name, array in usual.state_dict().items():
            got = memory.get(name)
            shape = (count, *array.shape[1:])
            if not isinstance(got, np.ndarray) or got.shape != shape or got.dtype != array.dtype:
                raise InputError(f"{name} of a checkpoint is not {array.dtype} {shape}; begin anew")
            if not np.isfinite(got).all():
                raise InputError(f"{name} of a checkpoint is not finite; begin anew")
        if (memory["second"] < 0).any() or (memory["age"] < 0).any():
            raise InputError("memory of a checkpoint's optimiser is none; begin anew")
        if max(np.abs(memory[name]).max(initial=0) for name in ("mean", "factor")) > FARTHEST:
            raise InputError("shapes of a checkpoint are beyond all bounds; begin anew")
        if not (memory["factor"][:, [0, 2]] > 0).all():
            raise InputError("factor of a checkpoint has no extent; begin anew")
        return cls(**memory)

    def select(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> State:
        """The Gaussians that a mask or an index picks, with their memory; rounds never decrease."""
        return State(*(getattr(self, f.name)[index] for f in dataclasses.fields(self)))

    def append(
        self,
        mean: NDArray[np.float64],
        factor: NDArray[np.float64],
        raw_opacity: NDArray[np.float64],
        color: NDArray[np.float64],
        raw_beta: NDArray[np.float64],
        round_index: int,
    ) -> State:
        """The state with new Gaussians on top, which have no memory yet."""
        count = len(mean)
        wide = np.zeros((count, PARAMETERS))
        rounds = np.full(count, round_index, np.int32)
        new = State(
            mean, factor, raw_opacity, color, raw_beta, rounds, wide, wide, np.zeros(count)
        )  # fmt: skip
        pairs = ((getattr(self, f.name), getattr(new, f.name)) for f in dataclasses.fields(self))
        return State(*(np.concatenate(pair) for pair in pairs))

    def quantized(self, scene: Scene) -> State:
        """With a scene's shapes, exponents and colours; the optimiser forgets the last two."""
        l11, l21, l22 = scene.factor[:, 0, 0], scene.factor[:, 1, 0], scene.factor[:, 1, 1]
        first, second = self.first.copy(), self.second.copy()
        first[:, COLOR_AND_BETA], second[:, COLOR_AND_BETA] = 0.0, 0.0
        return dataclasses.replace(
            self,
            factor=np.stack([l11, l21, l22], axis=1),
            raw_beta=np.log(scene.betas),
            color=scene.color.copy(),
            first=first,
            second=second,
        )

    def scaled(self, scale_x: float, scale_y: float) -> State:
        """The same Gaussians on a working image scaled by scale_x and scale_y."""
        return dataclasses.replace(
            self,
            mean=self.mean * [scale_x, scale_y],
            factor=self.factor * [scale_x, scale_y, scale_y],
        )

    def splats(self, background: NDArray[np.float64], blend: str = OVER) -> Splats:
        """The activated Gaussians, as the kernels read them."""
        sigma, rho, radius, shape, paint = _activate(
            self.mean, self.factor, self.raw_opacity, self.color, self.raw_beta
        )
        return Splats(self.mean, sigma, rho, radius, shape, paint, background, blend == ADD)

    def scene(
        self, background: NDArray[np.float64], width: float, height: float, blend: str = OVER
    ) -> Scene:
        """The activated Gaussians as a scene."""
        splats = self.splats(background)
        over = blend == OVER
        return Scene(
            width,
            height,
            mean=self.mean,
            sigma=splats.sigma,
            rho=splats.rho,
            color=np.clip(self.color, 0, 1) if over else self.color,
            opacity=splats.paint[:, 0] if over else np.ones(len(self)),
            background=background,
            round_index=self.round_index,
            blend=blend,
            beta=splats.shape[:, 5],
        )


@njit(parallel=True, cache=True)
def _activate(mean, factor, raw_opacity, color, raw_beta):
    n = mean.shape[0]
    sigma = np.empty((n, 2))
    rho = np.empty(n)
    radius = np.empty(n)
    shape = np.empty((n, 7))
    paint = np.empty((n, 4))
    for i in prange(n):
        l11, l21, l22 = factor[i, 0], factor[i, 1], factor[i, 2]
        sy = np.hypot(l21, l22)
        sigma[i, 0] = l11
        sigma[i, 1] = sy
        rho[i] = min(max(l21 / sy, -RHO_LIMIT), RHO_LIMIT)
        shape[i, 0] = mean[i, 0]
        shape[i, 1] = mean[i, 1]
        shape[i, 2] = 1 / l11
        shape[i, 3] = -l21 / (l11 * l22)
        shape[i, 4] = 1 / l22
        beta = np.exp(raw_beta[i])
        squared = 2 * CUT ** (1 / beta)
        radius[i] = np.sqrt(squared)
        shape[i, 5] = beta
        shape[i, 6] = squared
        paint[i, 0] = 1 / (1 + np.exp(-raw_opacity[i]))
        for k in range(3):
            paint[i, 1 + k] = color[i, k]
    return sigma, rho, radius, shape, paint
