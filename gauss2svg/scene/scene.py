"""The scene: an ordered list of 2D Gaussians on a canvas, as arrays.

CANVAS and PARAMETERS declare each parameter once. Scenes are checked, selected, concatenated,
scaled and saved by these records. Fits take raw values, activations, learning rates and the columns
of Adam's arrays from them. A new parameter of shapes is a record of PARAMETERS and a field of
Scene, and also of gauss2svg.fit.state.State if a fit steps it. Renderers, writers and readers name
the parameters that they use (docs/development.md).
"""

from __future__ import annotations

import dataclasses
import io
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, BinaryIO, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import InputError, SceneError, brief, plain_scalar, quoted, required
from gauss2svg.files import write_atomically
from gauss2svg.options import Field, file_name
from gauss2svg.scene import ADD, BLENDS, OVER
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA

LEAST_CANVAS, MOST_CANVAS = 1e-6, 1e9  # px, bounds of a side of the canvas
# Largest absolute value of a signed colour. Sums of larger ones drown in 8-bit rounding.
MOST_SIGNED = 100.0
# Bound of |rho|: the largest float below 1, at which sqrt((1 - rho)(1 + rho)) is still 1.5e-8.
RHO_LIMIT = math.nextafter(1, 0)
# px, bounds of sigma and of the mean. A thinner Gaussian is invisible, because pixels are sampled
# at their centres. Float64 renders and float32 gradients are finite up to 1000 times the upper
# bounds.
LEAST_SIGMA, MOST_SIGMA = 1e-9, 1e9
MOST_MEAN = 1e12

# Ways in which a file draws a shape. SOFT: by a gradient, or by a plain ellipse if that looks the
# same. PLAIN: always by a plain ellipse. BLURRED: as a blurred disc.
SOFT, PLAIN, BLURRED = range(3)

# Bounds of opacity logits: opacities 0.0003 and 0.999994. Beyond, no 8-bit image changes.
LEAST_RAW_OPACITY, MOST_RAW_OPACITY = -8.0, 12.0
# Bounds of ln beta in a fit. At the lower one, a shape is nearly a Gaussian. At 0 the kernels would
# leave out the gradient of the exponent, and a bound below 0 gives worse fits
# (docs/decisions/adam.md).
LEAST_RAW_BETA, MOST_RAW_BETA = 1e-6, math.log(128.0)

_Values = NDArray[Any]


@dataclass(frozen=True)
class Raw:
    """The raw form in which a fit steps a parameter. The geometry is stepped as a whole instead.

    name         field of gauss2svg.fit.state.State with the raw values
    activated    function from raw values to those of a scene
    inverse      function from values of a scene to raw values
    least, most  bounds of the raw values
    first        raw value of a new shape if its placement gives none
    """

    name: str
    activated: Callable[[_Values], _Values]
    inverse: Callable[[_Values], _Values]
    least: float
    most: float
    first: float = 0.0


@dataclass(frozen=True)
class Parameter:
    """A parameter of each shape of a scene, or of its canvas.

    name             field of the scene with its array
    width            numbers for each shape: the array is (n,) for 1, else (n, width)
    least, most      domain of its values
    additive_domain  least and largest value in additive scenes, if they differ
    default          value in a scene that does not give it; None if it must be given
    dtype            NumPy type of its array in a scene
    scaled           whether it is in px, and scales with the canvas
    raw              raw form in a fit; None if it belongs to the geometry or never changes
    rate             learning rate in the frame of gauss2svg.fit.adam; 0 if it is not stepped
    shared           whether shapes with one gradient in a file must have equal values. In the last
                     steps of a fit, SharedColors keeps them equal
    advice           the text after "Try" in the refusal of a value out of the domain
    once             whether a scene has one value, not one for each shape
    """

    name: str
    width: int
    least: float
    most: float
    additive_domain: tuple[float, float] | None = None
    default: float | None = None
    dtype: type[np.generic] = np.float64
    scaled: bool = False
    raw: Raw | None = None
    rate: float = 0.0
    shared: bool = False
    advice: str = "to clip it"
    once: bool = False

    def domain(self, blend: str) -> tuple[float, float]:
        """Return the least and the largest value of the parameter in scenes of this blend."""
        domain = self.additive_domain if blend == ADD else None
        return domain or (self.least, self.most)

    def shape(self, count: int) -> tuple[int, ...]:
        """Return the shape of the parameter's array for `count` Gaussians."""
        each = () if self.width == 1 else (self.width,)
        return each if self.once else (count, *each)

    def checked(self, values: Any, count: int | None, blend: str) -> _Values:
        """Return a read-only copy of `values` in the parameter's dtype, for `count` Gaussians.

        None stands for the default. Any number of Gaussians is accepted if `count` is None.
        Raise SceneError if values have another shape or leave the domain.
        """
        low, high = self.domain(blend)
        if values is None:
            size = 0 if self.default is None else count or 0
            values = np.full(self.shape(size), self.default or 0)
        try:
            values = np.ma.filled(np.asanyarray(values), np.nan)  # NaN is refused below
            array = values.astype(np.float64, "C", "same_kind", subok=False)
        except Exception as error:  # NumPy's errors, and torch's for a tensor with requires_grad
            raise SceneError(f"scene {self.name} must be numbers; got {brief(error)}") from None
        shape = self.shape(len(np.atleast_1d(array)) if count is None else count)
        if array.shape != shape:
            raise SceneError(f"scene {self.name} must be of shape {shape}; got {array.shape}")
        whole = np.issubdtype(self.dtype, np.integer)
        bad = ~((array >= low) & (array <= high)) | (whole & (array != np.rint(array)))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            raise SceneError(
                f"scene {self.name}{list(at) or ''} must be finite{' and whole' * whole} and in "
                f"{low:.16g}..{high:.16g}{' in an additive scene' * (blend == ADD)}; got "
                f"{array[at]!s}. Try {self.advice}"
            )
        array = array.astype(self.dtype, copy=False)
        array.flags.writeable = False
        return array


_COLOR_ADVICE = "to clip it, or to divide by 255 what is in 8 bits"
_SIDE_ADVICE = "to scale the scene"
CANVAS = (
    Parameter("width", 1, LEAST_CANVAS, MOST_CANVAS, advice=_SIDE_ADVICE, scaled=True, once=True),
    Parameter("height", 1, LEAST_CANVAS, MOST_CANVAS, advice=_SIDE_ADVICE, scaled=True, once=True),
    Parameter("background", 3, 0.0, 1.0, default=1.0, advice=_COLOR_ADVICE, once=True),
)
# Parameters of each shape. Learning rates come from the ablations of docs/decisions/fit.md. A fit
# steps mean and sigma in units of the shape's own sigma, rho as the shear of its frame, opacity as
# a logit, and beta as a logarithm.
PARAMETERS = (
    Parameter(
        "mean", 2, -MOST_MEAN, MOST_MEAN, rate=0.3, scaled=True,
        advice="to drop what lies so far off, or to scale the scene down",
    ),
    Parameter(
        "sigma", 2, LEAST_SIGMA, MOST_SIGMA, rate=0.15, scaled=True,
        advice="to clip it, to scale the scene, or to drop the Gaussian",
    ),
    Parameter("rho", 1, -RHO_LIMIT, RHO_LIMIT, rate=0.15, advice="to clip it to RHO_LIMIT"),
    Parameter(
        "opacity", 1, 0.0, 1.0, additive_domain=(1.0, 1.0), rate=0.15,
        raw=Raw(
            "raw_opacity", lambda logit: 1 / (1 + np.exp(-logit)), lambda p: np.log(p / (1 - p)),
            LEAST_RAW_OPACITY, MOST_RAW_OPACITY,
        ),
        advice="to clip it, and in an additive scene to multiply the colour by it",
    ),
    Parameter(
        "color", 3, 0.0, 1.0, additive_domain=(-MOST_SIGNED, MOST_SIGNED), rate=0.045, shared=True,
        advice=_COLOR_ADVICE, raw=Raw("color", np.asarray, np.asarray, 0.0, 1.0),
    ),
    Parameter(
        "beta", 1, LEAST_BETA, MOST_BETA, additive_domain=(1.0, 1.0), default=1.0, rate=0.05,
        raw=Raw("raw_beta", np.exp, np.log, LEAST_RAW_BETA, MOST_RAW_BETA), shared=True,
    ),
    Parameter("round_index", 1, 0, 2**31 - 1, default=0, dtype=np.int32, advice="to count from 0"),
    Parameter("drawn", 1, SOFT, BLURRED, additive_domain=(SOFT, SOFT), default=SOFT, dtype=np.int8),
)  # fmt: skip

# Parameters that Adam steps in their raw forms. Their columns have this order in Adam's arrays,
# after the columns of the geometry.
STEPPED = tuple((parameter, parameter.raw) for parameter in PARAMETERS if parameter.raw)


_FORMAT_VERSION = 1  # version of scene files. A new parameter with a default does not raise it
_REQUIRED = {parameter.name for parameter in (*CANVAS, *PARAMETERS) if parameter.default is None}
_DEFAULT: Any = None  # replaced by the constructor, which knows the number of Gaussians


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Gaussians on a canvas, bottom first; immutable and validated.

    The covariance of a Gaussian is [[sx^2, rho sx sy], [rho sx sy, sy^2]], which is
    positive definite for every |rho| < 1 (the parametrisation of "Investigation into
    2D Gaussian Splatting for Image Representation").

    width, height  canvas in px, LEAST_CANVAS..MOST_CANVAS
    mean           (n, 2) x, y in px, up to MOST_MEAN either way; pixel centres lie at +0.5
    sigma          (n, 2) standard deviations along x and y in px, LEAST_SIGMA..MOST_SIGMA each,
                   in any ratio
    rho            (n,) correlation, up to RHO_LIMIT either way, the largest float below 1
    color          (n, 3) sRGB in 0..1; signed, up to MOST_SIGNED either way, if blend is "add"
    opacity        (n,) in 0..1; all 1 if blend is "add"
    background     (3,) sRGB in 0..1; in a transparent scene, the colour of the page that shows it
    round_index    (n,) round of the fit that added each Gaussian, never decreasing; None for all 0
    blend          "over": source-over in sRGB, as in every SVG renderer; "add": as in the paper,
                   image = background + sum f(r_k) color_k in any order, clipped to 0..1 at the end
    beta           (n,) exponent of the falloff in LEAST_BETA..MOST_BETA, 1 for a Gaussian (see
                   gauss2svg.scene.falloff); None for all 1; all 1 if blend is "add"
    drawn          (n,) how a file draws each shape. SOFT: by a gradient, or by a plain ellipse if
                   that looks the same. PLAIN: by a plain ellipse at any size. BLURRED: as a blurred
                   disc, in the form "blur". None for all SOFT
    transparent    whether the background is left out of files and of render_rgba, whose image then
                   has alpha; False if blend is "add"

    A signed colour is the contribution of its Gaussian at its mean. The paper uses coefficients of
    normal densities instead: see `densities` and `peaks_of`.

    Arrays are made read-only and float64, but round_index int32 and drawn int8. Both renderers draw
    any scene of this domain with finite gradients. write_svg refuses what a file cannot hold. The
    constructor raises SceneError or InputError with the name of the field.
    """

    width: float
    height: float
    mean: NDArray[np.float64] = _DEFAULT
    sigma: NDArray[np.float64] = _DEFAULT
    rho: NDArray[np.float64] = _DEFAULT
    color: NDArray[np.float64] = _DEFAULT
    opacity: NDArray[np.float64] = _DEFAULT
    background: NDArray[np.float64] = _DEFAULT
    round_index: NDArray[np.int32] = _DEFAULT
    blend: str = OVER
    beta: NDArray[np.float64] = _DEFAULT
    transparent: bool = False
    drawn: NDArray[np.int8] = _DEFAULT

    as_html: ClassVar[Callable[[Scene], str] | None] = None  # set by gauss2svg.svg.file

    def __post_init__(self) -> None:
        for name, choices in (("blend", BLENDS), ("transparent", (False, True))):
            value = Field(f"scene {name}", words=choices).checked(getattr(self, name))
            object.__setattr__(self, name, value)
        count = None
        for parameter in (*CANVAS, *PARAMETERS):
            array = parameter.checked(getattr(self, parameter.name), count, self.blend)
            object.__setattr__(self, parameter.name, array if array.ndim else float(array))
            count = len(array) if parameter.name == "mean" else count
        if np.any(np.diff(self.round_index) < 0):
            raise SceneError("scene round_index must not decrease; got later rounds under earlier")
        if self.blend == ADD and self.transparent:
            raise SceneError(
                "scene blend must be 'over' if transparent; got 'add'. Try a background"
            )

    @classmethod
    def from_covariance(
        cls,
        width: float,
        height: float,
        mean: ArrayLike,
        covariance: ArrayLike,
        color: ArrayLike,
        opacity: ArrayLike = 1.0,
        **others: Any,
    ) -> Self:
        """Return a scene of Gaussians with these covariance matrices.

        sigma = (sqrt(c11), sqrt(c22)), rho = c12 / sqrt(c11 c22)

        covariance  (n, 2, 2) in px^2, symmetric and positive definite
        opacity     (n,), or one number for all
        others      further fields by name, such as background or blend
        Raise SceneError with the index of the first matrix that is not a covariance.
        """
        matrices = np.array(covariance, np.float64)
        if matrices.ndim != 3 or matrices.shape[1:] != (2, 2):
            raise SceneError(f"covariance must be of shape (n, 2, 2); got {matrices.shape}")
        c11, c12, c21, c22 = matrices.reshape(-1, 4).T
        with np.errstate(all="ignore"):  # NaN and infinity are refused below
            valid = (c11 > 0) & (c22 > 0) & (c12 * c21 < c11 * c22) & np.isfinite(c11 * c22)
            valid &= np.abs(c12 - c21) <= 1e-5 * np.sqrt(c11 * c22)  # symmetric up to float32
        if not valid.all():
            at = int(np.argmin(valid))
            raise SceneError(
                f"covariance[{at}] must be finite, symmetric and positive definite; got "
                f"{quoted(matrices[at].tolist())}. Try (c + c^T) / 2, with some .01 px^2 added on "
                "its diagonal"
            )
        sigma = np.sqrt(np.stack([c11, c22], axis=1))
        rho = np.clip(0.5 * (c12 + c21) / sigma.prod(axis=1), -RHO_LIMIT, RHO_LIMIT)
        opacity = np.broadcast_to(opacity, len(matrices)) if np.ndim(opacity) == 0 else opacity
        return cls(width, height, mean, sigma, rho, color, opacity, **others)  # pyright: ignore[reportArgumentType] (the constructor converts)

    def __reduce__(self) -> tuple[Any, ...]:
        # Copies are constructed anew, because NumPy's copies of the arrays would be writeable.
        return type(self), tuple(getattr(self, f.name) for f in dataclasses.fields(self))

    def __len__(self) -> int:
        """Return the number of Gaussians."""
        return len(self.mean)

    def __repr__(self) -> str:
        blend = ", additive" * (self.blend == ADD) + ", transparent" * self.transparent
        return f"<gauss2svg.Scene {self.width:g}x{self.height:g}, {len(self)} Gaussians{blend}>"

    def _repr_html_(self) -> str | None:
        return None if Scene.as_html is None else Scene.as_html(self)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance matrices (n, 2, 2) in px^2, [[sx^2, rho sx sy], [rho sx sy, sy^2]]."""
        factor = self.factor
        return factor @ np.swapaxes(factor, 1, 2)

    @property
    def factor(self) -> NDArray[np.float64]:
        """Lower Cholesky factors (n, 2, 2) of the covariance, in px.

        [[sx, 0], [rho sy, sqrt(1 - rho^2) sy]] maps the unit circle to the one-sigma ellipse.
        """
        sx, sy = self.sigma.T
        entries = [sx, np.zeros_like(sx), self.rho * sy, narrowing_of(self.rho) * sy]
        return np.stack(entries, axis=1).reshape(-1, 2, 2)

    @property
    def whitening(self) -> NDArray[np.float64]:
        """Entries w11, w21, w22 (n, 3) of the inverse of the factor, in 1/px.

        r^2 = (w11 u)^2 + (w21 u + w22 v)^2 for the offset (u, v) from the mean.
        """
        return whitening_of(self.sigma, self.rho)

    @property
    def conic(self) -> NDArray[np.float64]:
        """Inverse covariance matrices (n, 2, 2) in 1/px^2."""
        w11, w21, w22 = self.whitening.T
        entries = [w11 * w11 + w21 * w21, w21 * w22, w21 * w22, w22 * w22]
        return np.stack(entries, axis=1).reshape(-1, 2, 2)

    @property
    def densities(self) -> NDArray[np.float64]:
        """Coefficients (n, 3) in px^2 of the paper's normal densities, 2 pi sqrt(det Sigma) color.

        A density exp(-r^2 / 2) / (2 pi sqrt(det Sigma)) times these coefficients is
        color exp(-r^2 / 2).
        """
        return self.color * _volume(self.sigma, self.rho)[:, None]

    @property
    def ellipse_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """One-sigma semi-axes (n, 2) in px, larger first, and angles (n,) of the larger in radians.

        The semi-axes are the singular values of the factor, from sums and differences of its
        entries. An angle runs from +x towards +y (downwards) in -pi/2..pi/2.
        """
        factor = self.factor
        l11, l21, l22 = factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]
        axis_sum = np.hypot(l11 + l22, l21)
        axis_difference = np.hypot(l11 - l22, l21)
        major = 0.5 * (axis_sum + axis_difference)
        axes = np.stack([major, l11 * l22 / major], axis=1)
        variance_x, variance_y = np.square(self.sigma).T
        return axes, 0.5 * np.arctan2(2 * l11 * l21, variance_x - variance_y)

    @property
    def inks(self) -> NDArray[np.float64] | None:
        """Distinct colours (k, 3), sorted, with the background's unless the scene is transparent.

        None unless all shapes are opaque plain ellipses.
        """
        if not ((self.drawn == PLAIN).all() and (self.opacity == 1).all()):
            return None
        ground = np.zeros((0, 3)) if self.transparent else self.background[None]
        return np.unique(np.round(np.concatenate([ground, self.color]) * 255), axis=0) / 255

    def replace(self, **changes: Any) -> Self:
        """Return a new scene with some fields replaced. Raise what the constructor raises."""
        return dataclasses.replace(self, **changes)

    def select(self, index: Any) -> Self:
        """Return the scene of the Gaussians that a mask, slice or index array picks.

        Raise SceneError if round_index decreases in the new order, and NumPy's IndexError if the
        index is of another kind or out of range.
        """
        picked = np.arange(len(self))[index]
        return self.replace(**{p.name: getattr(self, p.name)[picked] for p in PARAMETERS})

    def concatenate(self, top: Scene) -> Self:
        """Return the scene with the Gaussians of `top` above its own, as later rounds.

        Canvas, background and transparency are those of this scene. Raise SceneError if the blends
        differ.
        """
        if self.blend != required(top, "upper scene", Scene).blend:
            raise SceneError(
                f"blend of the upper scene must be {self.blend!r}; got {quoted(top.blend)}"
            )
        later = int(self.round_index.max(initial=-1)) + 1 - int(top.round_index[:1].sum())
        top = top.replace(round_index=top.round_index + max(0, later))
        both = {p.name: (getattr(self, p.name), getattr(top, p.name)) for p in PARAMETERS}
        return self.replace(**{name: np.concatenate(arrays) for name, arrays in both.items()})

    def scaled(self, factor_x: float, factor_y: float | None = None) -> Self:
        """Return the scene on a canvas scaled by factor_x and factor_y (> 0).

        If factor_y is None, it is factor_x. Raise SceneError if the scaled values leave the domain.
        """
        scale = np.array([factor_x, factor_x if factor_y is None else factor_y], np.float64)
        shapes = {p.name: getattr(self, p.name) * scale for p in PARAMETERS if p.scaled}
        width, height = scale * [self.width, self.height]
        return self.replace(width=width, height=height, **shapes)

    def save(self, file: str | os.PathLike[str] | BinaryIO) -> None:
        """Write the scene as .npz without loss, atomically if `file` is a path.

        Raise OutputError if the path cannot be written.
        """
        content = io.BytesIO()
        fields: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        np.savez_compressed(content, format_version=_FORMAT_VERSION, **fields)
        if isinstance(file, (str, os.PathLike)):
            write_atomically(file_name("file", file), content.getvalue())
        else:
            file.write(content.getvalue())

    @classmethod
    def load(cls, file: str | os.PathLike[str] | BinaryIO) -> Self:
        """Read a scene written by save.

        A parameter that the file lacks has its default. Raise InputError if `save` did not write
        the file, and SceneError if its arrays leave the domain.
        """
        try:
            with np.load(file, allow_pickle=False) as stored:
                values = {name: plain_scalar(stored[name]) for name in stored.files}
            if (version := int(values.pop("format_version"))) != _FORMAT_VERSION:
                raise ValueError(f"format version {version}")
            names = {field.name for field in dataclasses.fields(cls)}
            if others := values.keys() - names | _REQUIRED - values.keys():
                raise ValueError(f"one with other fields: {', '.join(sorted(others))}")
        except Exception as error:  # NumPy, zipfile and zlib each raise errors of their own
            raise InputError(
                f"scene file must be one written by Scene.save, in version {_FORMAT_VERSION}; got "
                f"{brief(error)}. Try to fit the photo again, and to save its scene"
            ) from error
        return cls(**values)


def narrowing_of(rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sqrt(1 - rho^2), (n,), without cancellation if |rho| is nearly 1."""
    return np.sqrt((1 - rho) * (1 + rho))


def whitening_of(sigma: NDArray[np.float64], rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Scene.whitening (n, 3) in 1/px of Gaussians with sigma (n, 2) in px and rho (n,)."""
    sx, sy = sigma.T
    k = narrowing_of(rho)
    return np.stack([1 / sx, -rho / (sx * k), 1 / (sy * k)], axis=1)


def _volume(sigma: NDArray[np.float64], rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the integrals (n,) in px^2 of Gaussians with a peak of 1: 2 pi sqrt(det Sigma)."""
    return 2 * np.pi * sigma.prod(axis=1) * narrowing_of(rho)


def peaks_of(
    densities: NDArray[np.float64], sigma: NDArray[np.float64], rho: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the `color` (n, 3) of an additive scene from coefficients of normal densities (n, 3).

    It is densities / (2 pi sx sy sqrt(1 - rho^2)), the inverse of Scene.densities. sigma (n, 2) is
    in px, and rho is (n,).
    """
    return densities / _volume(sigma, rho)[:, None]
