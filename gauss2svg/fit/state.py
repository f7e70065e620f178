"""The optimiser's state: raw parameters of the Gaussians in working pixels, and Adam's moments."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be, shown
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import ADD, OVER, RHO_LIMIT, Scene
from gauss2svg.scene.falloff import cut_radius

FARTHEST = 1e9  # px, from the origin and of a shape: well within the domain of scenes
PARAMETERS = 10  # shift along the two whitened axes, three of shape, opacity, r, g, b, ln beta
COLOR, COLOR_AND_BETA = slice(6, 9), slice(6, 10)


@dataclass
class State:
    """n raw Gaussians, bottom first; float64.

    mean         (n, 2) px
    factor       (n, 3) entries l11, l21, l22 of the covariance's Cholesky factor, px
    raw_opacity  (n,) logit of the opacity
    color        (n, 3) sRGB, signed with additive blending
    raw_beta     (n,) ln of the falloff's exponent; at exactly 0 it is fixed: a Gaussian
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
        """A state without Gaussians."""
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
        """A copy that shares no array with this one."""
        return State(**{name: array.copy() for name, array in self.state_dict().items()})

    def state_dict(self) -> dict[str, Any]:
        """The arrays by name, for a checkpoint."""
        return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}

    @classmethod
    def from_state_dict(cls, arrays: dict[str, Any]) -> State:
        """The state whose state_dict() this is; raises InputError for arrays that none has."""
        count = len(np.atleast_1d(arrays.get("mean", [])))
        for name, usual in cls.empty().state_dict().items():
            array = arrays.get(name)
            shape = (count, *usual.shape[1:])
            if not isinstance(array, np.ndarray):
                raise _damaged(name, f"an array {shape}", type(array).__name__)
            if array.shape != shape or array.dtype != usual.dtype:
                raise _damaged(name, f"{usual.dtype} {shape}", f"{array.dtype} {array.shape}")
            if not np.isfinite(array).all():
                raise _damaged(name, "finite", "infinite or undefined numbers")
        for name in ("second", "age"):
            if (arrays[name] < 0).any():
                raise _damaged(name, "at least 0", f"{arrays[name].min():g}")
        for name in ("mean", "factor"):
            most = np.abs(arrays[name]).max(initial=0)
            if most > FARTHEST:
                raise _damaged(name, f"at most {FARTHEST:g}", f"{most:g}")
        if not (arrays["factor"][:, [0, 2]] > 0).all():
            raise _damaged("factor", "above 0 on the diagonal", "shapes without extent")
        return cls(**arrays)

    def select(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> State:
        """The Gaussians that a mask or an index selects; rounds must not decrease."""
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
        """The state with new Gaussians on top, whose moments are 0."""
        count = len(mean)
        wide = np.zeros((count, PARAMETERS))
        rounds = np.full(count, round_index, np.int32)
        new = State(
            mean, factor, raw_opacity, color, raw_beta, rounds, wide, wide, np.zeros(count)
        )  # fmt: skip
        pairs = ((getattr(self, f.name), getattr(new, f.name)) for f in dataclasses.fields(self))
        return State(*(np.concatenate(pair) for pair in pairs))

    def quantized(self, scene: Scene) -> State:
        """The state of a scene's shapes, exponents and colours; resets moments of the two."""
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
        sigma, rho, whitening = _activate(self.factor)
        beta = np.exp(self.raw_beta)
        radius = cut_radius(beta)
        opacity = 1 / (1 + np.exp(-self.raw_opacity))
        return Splats(
            self.mean,
            sigma,
            rho,
            radius,
            np.column_stack([self.mean, whitening, beta, radius * radius]),
            np.column_stack([opacity, self.color]),
            background,
            blend == ADD,
        )

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
            opacity=splats.opacity if over else np.ones(len(self)),
            background=background,
            round_index=self.round_index,
            blend=blend,
            beta=splats.beta,
        )


def _damaged(name: str, needed: str, got: str) -> InputError:
    return InputError(
        must_be(f"the checkpoint's {name}", needed, shown(got), "starting the fit again")
    )


def _activate(
    factor: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """From Cholesky factors (n, 3): sigma (n, 2), rho (n,) and whitening w11, w21, w22 (n, 3)."""
    l11, l21, l22 = factor.T
    sy = np.sqrt(l21 * l21 + l22 * l22)
    rho = np.clip(l21 / sy, -RHO_LIMIT, RHO_LIMIT)
    whitening = np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=1)
    return np.stack([l11, sy], axis=1), rho, whitening
