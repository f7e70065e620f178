"""The optimiser's state: raw parameters of Gaussians in px of the target, and Adam's moments."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.render.cpu import Splats, splats_from
from gauss2svg.scene import ADD, OVER, PLAIN, RHO_LIMIT, SOFT, Scene
from gauss2svg.scene.scene import STEPPED

# Bound in px of |x| + |y| + l11 + |l21| + l22 of a Gaussian. A step that would exceed it is not
# taken, so means and sizes stay in the domain of scenes.
FARTHEST = 1e9
# The first five columns of gradients and of Adam's moments are two shifts of the mean along the
# whitened axes, and A11, A12 and A22 (gauss2svg.fit.adam). Each of these columns takes the learning
# rate of the parameter that is listed here for it. The columns of the parameters in STEPPED follow.
GEOMETRY = ("mean", "mean", "sigma", "rho", "sigma")
_ENDS = np.cumsum([len(GEOMETRY), *(p.width for p, _ in STEPPED)]).tolist()
COLUMNS = {
    p.name: slice(end - p.width, end) for (p, _), end in zip(STEPPED, _ENDS[1:], strict=True)
}
COLUMN_COUNT = _ENDS[-1]  # number of columns of a gradient and of each of Adam's arrays
COLOR = COLUMNS["color"]


@dataclass
class State:
    """Raw parameters of n Gaussians, bottom first; float64 by default.

    mean         (n, 2) in px
    factor       (n, 3) entries l11, l21, l22 of the Cholesky factor of the covariance, in px
    raw_opacity  (n,) logit of the opacity
    color        (n, 3) sRGB, signed with additive blending
    raw_beta     (n,) natural logarithm of the exponent of the falloff
    round_index  (n,) int32, the round of growth that added each Gaussian
    drawn        (n,) int8, how a file draws each shape (Scene.drawn)
    adam_m       (n, COLUMN_COUNT) Adam's first moments
    adam_v       (n, COLUMN_COUNT) Adam's second moments
    age          (n,) number of Adam steps that each Gaussian has taken
    """

    mean: NDArray[np.float64]
    factor: NDArray[np.float64]
    raw_opacity: NDArray[np.float64]
    color: NDArray[np.float64]
    raw_beta: NDArray[np.float64]
    round_index: NDArray[np.int32]
    drawn: NDArray[np.int8]
    adam_m: NDArray[np.float64]
    adam_v: NDArray[np.float64]
    age: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        mean: NDArray[np.float64],
        factor: NDArray[np.float64],
        round_index: int,
        **raw: NDArray[np.float64],
    ) -> State:
        """Return new Gaussians of one round, whose Adam moments are 0.

        raw: arrays of raw parameters, by the names of the fields of State. A parameter that is not
        passed starts at its value Raw.first.
        """
        count = len(mean)
        for parameter, raw_form in STEPPED:
            raw.setdefault(raw_form.name, np.full(parameter.shape(count), raw_form.first))
        moments = np.zeros((count, COLUMN_COUNT))
        # The arrays are copied to C order, because the kernels are compiled for it.
        return cls(
            mean=np.array(mean, order="C"),
            factor=np.array(factor, order="C"),
            **{name: np.array(values, order="C") for name, values in raw.items()},
            round_index=np.full(count, round_index, np.int32),
            drawn=np.full(count, SOFT, np.int8),
            adam_m=moments,
            adam_v=moments.copy(),
            age=np.zeros(count),
        )

    @classmethod
    def of_scene(cls, scene: Scene) -> State:
        """Return the shapes of an alpha-composited scene, with Adam's moments of 0."""
        raw: dict[str, Any] = {}
        for parameter, form in STEPPED:
            # Opacities 0 and 1 have infinite logits. NumPy need not warn, because they are clipped.
            with np.errstate(divide="ignore"):
                values = form.inverse(getattr(scene, parameter.name))
            raw[form.name] = np.clip(values, form.least, form.most)
        state = cls.of(scene.mean, scene.cholesky, 0, **raw)
        rounds, drawn = scene.round_index.copy(), scene.drawn.copy()
        return dataclasses.replace(state, round_index=rounds, drawn=drawn)

    def __len__(self) -> int:
        return len(self.mean)

    def copy(self) -> State:
        """Return a copy that shares no array with this state."""
        return State(**{name: array.copy() for name, array in vars(self).items()})

    def select(self, index: NDArray[np.bool_] | NDArray[np.intp]) -> State:
        """Return the state of the Gaussians that `index`, a mask or an index array, picks.

        An index array must keep the rounds in ascending order.
        """
        return State(**{name: array[index] for name, array in vars(self).items()})

    def append(self, new: State) -> State:
        """Return the state with the Gaussians of `new` on top."""
        new_arrays = vars(new)
        return State(**{n: np.concatenate([a, new_arrays[n]]) for n, a in vars(self).items()})

    def quantized(self, scene: Scene) -> State:
        """Return the state with some values replaced by those of `scene`, the scene of a file.

        The replaced values are those that change when a scene is written to a file: the Cholesky
        factors, `drawn` and the shared parameters. Adam's moments of the shared parameters become
        0.
        """
        adam_m, adam_v = self.adam_m.copy(), self.adam_v.copy()
        shared = {}
        for parameter, raw in STEPPED:
            if parameter.shared:
                adam_m[:, COLUMNS[parameter.name]] = adam_v[:, COLUMNS[parameter.name]] = 0.0
                shared[raw.name] = raw.inverse(getattr(scene, parameter.name).copy())
        return dataclasses.replace(
            self,
            factor=scene.cholesky,
            drawn=scene.drawn.copy(),
            adam_m=adam_m,
            adam_v=adam_v,
            **shared,
        )

    def scaled(self, scale_x: float, scale_y: float) -> State:
        """Return the state on a working image whose sides are scaled by scale_x and scale_y."""
        return dataclasses.replace(
            self,
            mean=self.mean * [scale_x, scale_y],
            factor=self.factor * [scale_x, scale_y, scale_y],
        )

    def _activated(self) -> dict[str, Any]:
        return {p.name: raw.activated(getattr(self, raw.name)) for p, raw in STEPPED}

    def splats(self, background: NDArray[np.float64], blend: str = OVER) -> Splats:
        """Return the Gaussians as the arrays that the kernels read.

        The raw parameters are converted, for example logits to opacities.
        """
        sigma, rho, whitening = _activate(self.factor)
        return splats_from(
            self.mean,
            sigma,
            rho,
            whitening,
            background=background,
            additive=blend == ADD,
            is_plain=self.drawn == PLAIN,
            **self._activated(),
        )

    def scene(
        self, background: NDArray[np.float64], width: float, height: float, blend: str = OVER
    ) -> Scene:
        """Return the Gaussians as a scene.

        The raw parameters are converted, for example logits to opacities, and the values are
        clipped to the domain of scenes.
        """
        sigma, rho, _ = _activate(self.factor)
        activated = self._activated()
        clipped: dict[str, Any] = {
            p.name: np.clip(activated[p.name], *p.domain(blend)) for p, _ in STEPPED
        }
        return Scene(
            width,
            height,
            mean=self.mean,
            sigma=sigma,
            rho=rho,
            background=background,
            round_index=self.round_index,
            blend=blend,
            drawn=self.drawn,
            **clipped,
        )


def _activate(
    factor: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return sigma (n, 2), rho (n,) and the whitening w11, w21, w22 (n, 3) of Cholesky factors."""
    l11, l21, l22 = factor.T
    sy = np.sqrt(l21 * l21 + l22 * l22)
    rho = np.clip(l21 / sy, -RHO_LIMIT, RHO_LIMIT)
    whitening = np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=1)
    return np.stack([l11, sy], axis=1), rho, whitening
