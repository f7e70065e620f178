"""The optimiser's state, and its Adam steps in each Gaussian's own frame.

The state has raw parameters of Gaussians in px of the target, and Adam's moments.

A step changes the mean and the shape in whitened coordinates z, where x = mean + L z and L is the
Cholesky factor of the covariance:

    mean <- mean + L t,    L <- cholesky of L exp(2 A) L^T,  A symmetric.

A step of a given size thus changes large, small and thin Gaussians equally, relative to their own
size. The kernels return the moments m of a quantity h, which gauss2svg/core/gaussians.h defines.
The gradients follow from these moments:

    dL/dt = (m1, m2),  dL/dA11 = m11,  dL/dA12 = 2 m12,  dL/dA22 = m22,
    dL/d(logit opacity) = (sum dL/dalpha alpha) (1 - opacity),  dL/dcolor = sum w g,
    dL/d(ln beta) = -beta sum dL/dalpha alpha' t ln s.

Steps change the logarithms of sizes, aspect ratios and exponents, and the logits of opacities. rho
follows from L, and no step can make the covariance indefinite. The rim of a crisp shape is only
about sigma / beta wide, so its steps of mean and shape are multiplied by beta^-0.35. Without this
factor, fits of drawings with plain ellipses diverge (docs/decisions/divergence.md). Colours are
clipped to 0..1, and a colour at a bound leaves it with the first step that points inward. Stepping
the logits of colours would be no better, because the gradient of a logit vanishes at the bounds
(docs/decisions/adam.md).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.core import Floats, Kernel
from gauss2svg.fit import ADAPTIVE, FitOptions
from gauss2svg.render.cpu import Splats, splats_from
from gauss2svg.scene import ADD, OVER, PLAIN, RHO_LIMIT, SOFT, Scene
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.scene import PARAMETERS, STEPPED

# The first five columns of gradients and of Adam's moments are two shifts of the mean along the
# whitened axes, and A11, A12 and A22. Each of these columns takes the learning
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

    mean: Floats
    factor: Floats
    raw_opacity: Floats
    color: Floats
    raw_beta: Floats
    round_index: NDArray[np.int32]
    drawn: NDArray[np.int8]
    adam_m: Floats
    adam_v: Floats
    age: Floats

    @classmethod
    def of(cls, mean: Floats, factor: Floats, round_index: int, **raw: Floats | float) -> State:
        """Return new Gaussians of one round, whose Adam moments are 0.

        raw: raw parameters, by the names of the fields of State. They are arrays, or one number for
        all shapes. A parameter that is not passed is 0.
        """
        count = len(mean)
        # The arrays are copied to C order, because the kernels are compiled for it.
        stepped = {f.name: np.full(p.shape(count), raw.get(f.name, 0.0)) for p, f in STEPPED}
        moments = np.zeros((2, count, COLUMN_COUNT))
        return cls(
            mean=np.array(mean, order="C"), factor=np.array(factor, order="C"), **stepped,
            round_index=np.full(count, round_index, np.int32),
            drawn=np.full(count, SOFT, np.int8),
            adam_m=moments[0], adam_v=moments[1], age=np.zeros(count),
        )  # fmt: skip

    @classmethod
    def of_scene(cls, scene: Scene) -> State:
        """Return the shapes of an alpha-composited scene, with Adam's moments of 0."""
        # Opacities 0 and 1 have infinite logits. NumPy need not warn, because they are clipped.
        with np.errstate(divide="ignore"):
            raw: dict[str, Any] = {
                form.name: np.clip(form.inverse(getattr(scene, p.name)), form.least, form.most)
                for p, form in STEPPED
            }
        state = cls.of(scene.mean, scene.cholesky, 0, **raw)
        state.round_index, state.drawn = scene.round_index.copy(), scene.drawn.copy()
        return state

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
        state = self.copy()
        state.factor, state.drawn = scene.cholesky, scene.drawn.copy()
        for parameter, raw in STEPPED:
            if parameter.shared:
                columns = COLUMNS[parameter.name]
                state.adam_m[:, columns] = state.adam_v[:, columns] = 0.0
                setattr(state, raw.name, raw.inverse(getattr(scene, parameter.name).copy()))
        return state

    def scaled(self, scale_x: float, scale_y: float) -> State:
        """Return the state on a working image whose sides are scaled by scale_x and scale_y."""
        mean = self.mean * [scale_x, scale_y]
        factor = self.factor * [scale_x, scale_y, scale_y]
        return dataclasses.replace(self, mean=mean, factor=factor)

    def _activated(self) -> dict[str, Any]:
        return {p.name: raw.activated(getattr(self, raw.name)) for p, raw in STEPPED}

    def splats(self, background: Floats, blend: str = OVER) -> Splats:
        """Return the Gaussians as the arrays that the kernels read.

        The raw parameters are converted, for example logits to opacities.
        """
        sigma, rho, whitening = _activate(self.factor)
        return splats_from(
            self.mean, sigma, rho, whitening, background=background, additive=blend == ADD,
            is_plain=self.drawn == PLAIN, **self._activated(),
        )  # fmt: skip

    def scene(self, background: Floats, width: float, height: float, blend: str = OVER) -> Scene:
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
            width, height, mean=self.mean, sigma=sigma, rho=rho, background=background, blend=blend,
            round_index=self.round_index, drawn=self.drawn, **clipped,
        )  # fmt: skip


def _activate(factor: Floats) -> tuple[Floats, Floats, Floats]:
    """Return sigma (n, 2), rho (n,) and the whitening w11, w21, w22 (n, 3) of Cholesky factors."""
    l11, l21, l22 = factor.T
    sy = np.sqrt(l21 * l21 + l22 * l22)
    rho = np.clip(l21 / sy, -RHO_LIMIT, RHO_LIMIT)
    whitening = np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=1)
    return np.stack([l11, sy], axis=1), rho, whitening


FIRST_DECAY = 0.9  # decay of Adam's first moment (docs/decisions/adam.md)
SECOND_DECAY = 0.95  # decay of Adam's second moment (docs/decisions/adam.md)
# Steps of mean and shape are multiplied by beta to this power. So crisp shapes take smaller steps,
# as their narrow rims need (docs/decisions/divergence.md).
STEP_BY_BETA = -0.35
# Largest ratio of the major axis to the minor axis. Thinner Gaussians leave visible streaks in flat
# areas (docs/decisions/fit.md).
MOST_ASPECT = 30.0
# Least width of a rim in px of the working image: the distance along the minor axis over which the
# falloff drops from 0.9 to 0.1. Renderers differ in how they draw sharper rims
# (docs/decisions/fit.md).
LEAST_RIM = 0.5

# Least semi-axis in px. Every renderer draws shapes below 0.3 px too faintly
# (docs/decisions/renderers.md).
LEAST_FITTED_SIGMA = 0.35
# Logit of the opacity of opaque and of additive Gaussians. Adam does not step this logit. The
# opacity that it stands for is nearly 1.
OPAQUE_LOGIT = 12.0


def columns_of(options: FitOptions, opaque: bool = False, shares: bool = False) -> Floats:
    """Return the learning rate and the bounds (COLUMN_COUNT, 3) of each column of Adam's arrays.

    opaque  whether all shapes are opaque from the first step to the last
    shares  whether several shapes share a colour and an exponent, which then stays fixed. All rates
            of shared colours from 0.002 to 0.015 give the same PSNR to within 0.01 dB
            (docs/decisions/palette.md)

    The rates of mean and sigma are relative to the Gaussian's own sigma. The rate of opacity refers
    to its logit, and the rate of color to channels in 0..1. Adam does not step a parameter whose
    rate is 0. The bounds are the least and the largest value. Those of signed colours are narrow,
    because renderers of the file keep partial sums of these colours in 8 bits, and large sums would
    not fit.
    """
    columns = np.tile([0.0, -math.inf, math.inf], (COLUMN_COUNT, 1))
    rates = {parameter.name: parameter.rate for parameter in PARAMETERS}
    columns[: len(GEOMETRY), 0] = [rates[name] for name in GEOMETRY]
    for parameter, raw in STEPPED:
        columns[COLUMNS[parameter.name]] = parameter.rate, raw.least, raw.most
    if options.blend == ADD:
        columns[COLOR] = 0.025, -0.5, 0.5  # docs/decisions/fit.md
    is_inked = options.inks is not None
    if is_inked or shares:
        columns[COLOR, 0] = 0.0 if is_inked else 0.006
    if opaque or is_inked or options.blend == ADD:
        columns[COLUMNS["opacity"], 0] = 0.0
    if shares or options.shaped != ADAPTIVE:
        columns[COLUMNS["beta"], 0] = 0.0
    return columns


_step_gaussians = Kernel(
    "step_gaussians",
    "int float64 float64 float64 float64 float64 float64 float64 float64 float64 float64 float64"
    " float64 float64 float float64 float float float float",
)


def step(
    state: State,
    moments: Floats,
    splats: Splats,
    columns: Floats,
    most_sigma: float,
    price: float = 0.0,
    rate: float = 1.0,
    least_sigma: float = LEAST_FITTED_SIGMA,
) -> bool:
    """Take an Adam step with every Gaussian of the state, in place.

    Return whether the step of every Gaussian was finite. A Gaussian whose step would not be finite
    stays as it is, but Adam's moments and its age become 0.

    moments     (n, MOMENTS) from gauss2svg.render.cpu, of the state's Gaussians
    splats      the state as the kernels read it
    columns     from `columns_of`
    most_sigma  largest major axis in px of the working image
    price       a step raises ln beta only if this lowers the loss by more than this amount for each
                unit of ln beta
    rate        factor by which all learning rates are multiplied
    least_sigma  least semi-axis in px of the working image
    """
    return bool(_step_gaussians(
        len(state.age), moments, splats.opacity_color, splats.shape, state.mean, state.factor,
        state.raw_opacity, state.color, state.raw_beta, state.adam_m, state.adam_v, state.age,
        columns, np.array([FIRST_DECAY, SECOND_DECAY]), STEP_BY_BETA,
        np.array([least_sigma, most_sigma, MOST_ASPECT]), RIM_WIDTH / LEAST_RIM,
        1e9,  # px. A step to |x| + |y| + l11 + |l21| + l22 beyond this is not taken
        price, rate,
    ))  # fmt: skip
