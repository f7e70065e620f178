"""The scene: an ordered list of 2D Gaussians on a canvas, as arrays."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, BinaryIO, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import (
    Gauss2SvgError,
    InputError,
    SceneError,
    brief,
    quoted,
    required,
)
from gauss2svg.files import write_atomically
from gauss2svg.options import file_name
from gauss2svg.scene import ADD, BLENDS, OVER
from gauss2svg.scene.parameters import (
    PARAMETERS,
    PLAIN,
    RHO_LIMIT,
    Parameter,
)

LEAST_CANVAS, MOST_CANVAS = 1e-6, 1e9

_FORMAT_VERSION = 1  # of scene files
# Of two entries that should be one, relative to the variances: single precision's, with some room.
_ASYMMETRY = 1e-5
_FILLED_IN: Any = None  # until the constructor has the number of Gaussians


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Gaussians on a canvas, bottom first; immutable and validated.

    The covariance of a Gaussian is [[sx^2, rho sx sy], [rho sx sy, sy^2]], which is
    positive definite for every |rho| < 1 (the parametrisation of "Investigation into
    2D Gaussian Splatting for Image Representation").

    width, height  canvas in px, LEAST_CANVAS..MOST_CANVAS
    mean           (n, 2) x, y in px, up to MOST_MEAN either way; pixel centres lie at +0.5
    sigma          (n, 2) standard deviations along x and y in px, LEAST_SIGMA..MOST_SIGMA each,
                   in whatever proportion
    rho            (n,) correlation, up to RHO_LIMIT either way: the last number before 1
    color          (n, 3) sRGB in 0..1; signed, up to MOST_SIGNED either way, where blend is "add"
    opacity        (n,) in 0..1; all 1 where blend is "add"
    background     (3,) sRGB in 0..1; where the scene is transparent, the page that shows it
    round_index    (n,) round of the fit in which each was added, never decreasing; None for all 0
    blend          "over": source-over in sRGB, what every SVG renderer does; "add": the paper's,
                   image = background + sum f(r_k) color_k in any order, clipped to 0..1 at the end
    beta           (n,) exponent of the falloff in LEAST_BETA..MOST_BETA, 1 for a Gaussian: see
                   gauss2svg.scene.falloff; None for all 1, which they are where blend is "add"
    drawn          (n,) how a file draws each: SOFT by a gradient, or by a plain ellipse where that
                   looks the same; PLAIN by a plain ellipse at any size; BLURRED as a blurred disc,
                   in the form "blur"; None for all SOFT
    transparent    whether the background is not part of the image: a file has none, and rendered
                   images have alpha; False where blend is "add"

    A signed colour is the contribution of its Gaussian at its mean. The paper uses coefficients of
    normal densities instead: see `densities` and `peaks_of`.

    Arrays are converted to the dtypes of gauss2svg.scene.parameters, which declares them and their
    domains (float64, round_index int32, drawn int8), and made read-only. Both renderers draw
    any scene of this domain with finite gradients; write_svg refuses what a file cannot hold.
    Raises SceneError with the name of the field.
    """

    width: float
    height: float
    mean: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    sigma: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    rho: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    color: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    opacity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    background: NDArray[np.float64] = field(default_factory=lambda: np.ones(3))
    round_index: NDArray[np.int32] = _FILLED_IN
    blend: str = "over"
    beta: NDArray[np.float64] = _FILLED_IN
    transparent: bool = False
    drawn: NDArray[np.int8] = _FILLED_IN

    as_html: ClassVar[Callable[[Scene], str] | None] = None  # gauss2svg.svg.notebook says why

    def __post_init__(self) -> None:
        count = len(np.atleast_1d(self._array("mean", np.float64)))
        for name in ("width", "height"):
            object.__setattr__(self, name, self._side(name))
        if self.blend not in BLENDS:
            raise SceneError(
                f"scene blend must be one of {', '.join(BLENDS)}; got {quoted(self.blend)}"
            )
        for parameter in PARAMETERS:
            self._freeze_parameter(parameter, count)
        self._freeze("background", (3,), (0, 1), np.float64, "to clip it")
        if count and np.any(np.diff(self.round_index) < 0):
            raise SceneError(
                "scene round_index must be in painter's order, with later rounds on top; got "
                "numbers that decrease"
            )
        if not isinstance(self.transparent, bool):
            raise SceneError(
                f"scene transparent must be True or False; got {quoted(self.transparent)}"
            )
        if self.blend == ADD and self.transparent:
            raise SceneError(
                f"blend of a transparent scene must be {OVER!r}; got {quoted(self.blend)}. Try "
                "to give a background"
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
        """A scene of Gaussians that are given by their covariance.

        sigma = (sqrt(c11), sqrt(c22)), rho = c12 / (sx sy)

        covariance  (n, 2, 2) in px^2, symmetric and positive definite
        opacity     (n,), or one for all
        others      further fields by their names, such as background or blend
        Raises SceneError with the number of the first matrix that is none of a Gaussian.
        """
        try:
            given = np.asarray(_detached("covariance", covariance), np.float64)
        except (TypeError, ValueError) as error:
            raise SceneError(f"covariance must be real numbers; got {brief(error)}") from None
        if given.ndim != 3 or given.shape[1:] != (2, 2):
            raise SceneError(f"covariance must be of shape (n, 2, 2); got {given.shape}")
        c11, c12, c21, c22 = given.reshape(-1, 4).T
        with np.errstate(all="ignore"):  # of nan and infinity, which the first test refuses
            of_gaussian = {
                "finite": np.isfinite(given).all(axis=(1, 2)),
                "symmetric": np.abs(c12 - c21) <= _ASYMMETRY * np.sqrt(np.abs(c11 * c22)),
                "positive definite": (c11 > 0) & (c22 > 0) & (c12 * c21 < c11 * c22),
            }
        for needed, holds in of_gaussian.items():
            if not holds.all():
                at = int(np.argmin(holds))
                raise SceneError(
                    f"covariance[{at}] must be {needed}; got {quoted(given[at].tolist())}. Try "
                    "(c + c^T) / 2, with some .01 px^2 added on its diagonal"
                )
        sigma = np.sqrt(np.stack([c11, c22], axis=1))
        rho = np.clip(0.5 * (c12 + c21) / sigma.prod(axis=1), -RHO_LIMIT, RHO_LIMIT)
        opacity = np.broadcast_to(opacity, len(given)) if np.ndim(opacity) == 0 else opacity
        return cls(width, height, mean, sigma, rho, color, opacity, **others)  # pyright: ignore[reportArgumentType] (the constructor converts)

    def _side(self, name: str) -> float:
        """Width or height as a number within its range."""
        given = getattr(self, name)
        try:
            value = float(given) if np.ndim(given) == 0 else None
        except (TypeError, ValueError, OverflowError):
            value = None
        if value is None or not LEAST_CANVAS <= value <= MOST_CANVAS:
            raise SceneError(
                f"scene {name} must be a number in {LEAST_CANVAS:g}..{MOST_CANVAS:g} px; got "
                f"{quoted(given)}. Try to scale the scene"
            )
        return value

    def _array(self, name: str, dtype: Any) -> NDArray[Any]:
        """A copy of a field as an array of dtype, if that changes no value."""
        given: ArrayLike = _detached(f"scene {name}", getattr(self, name))
        most = None if dtype is np.float64 else np.iinfo(dtype).max
        try:
            if np.ma.is_masked(given):  # they have no value
                raise ValueError("masked ones")
            array = np.asarray(given)
            if np.iscomplexobj(array):
                raise ValueError("complex numbers")
            array = np.array(array, dtype=np.float64, order="C")
            if most is not None:
                within = np.abs(array) <= most  # false of nan
                if not (within & (array == np.round(array))).all():
                    raise ValueError("others")
        except (TypeError, ValueError, OverflowError) as error:
            needed = f"an array of {'real' if most is None else 'whole'} numbers"
            needed += "" if most is None else f" up to {most}"
            raise SceneError(f"scene {name} must be {needed}; got {brief(error)}") from None
        return array.astype(dtype, copy=False)

    def _freeze_parameter(self, parameter: Parameter, count: int) -> None:
        name, shape, blend = parameter.name, parameter.shape(count), self.blend
        if getattr(self, name) is None and parameter.default is not None:
            object.__setattr__(self, name, np.full(shape, parameter.default))
        self._freeze(name, shape, parameter.domain(blend), parameter.dtype, parameter.advice)

    def _freeze(
        self,
        name: str,
        shape: tuple[int, ...],
        domain: tuple[float, float],
        dtype: type[np.generic],
        advice: str,
    ) -> None:
        """Make a field a read-only array of this shape and dtype, within its domain."""
        array = self._array(name, dtype)
        if array.shape != shape:
            raise SceneError(f"scene {name} must be of shape {shape}; got {array.shape}")
        low, high = domain
        bad = ~(np.isfinite(array) & (array >= low) & (array <= high))
        if bad.any():
            at = tuple(int(i) for i in np.argwhere(bad)[0])
            needed = f"finite and in {_bound(low)}..{_bound(high)}"
            if self.blend == ADD and low == high:
                needed = f"{_bound(low)} in an additive scene"
            # A colour a little above 1 is not one of 8 bits.
            of_8_bits = high == 1 and array.min() >= 0 and 2 <= array.max() <= 255
            if name in ("color", "background") and of_8_bits:
                advice = "to divide by 255"
            raise SceneError(
                f"scene {name}{list(at)} must be {needed}; got {array[at]!s}. Try {advice}"
            )
        array.flags.writeable = False
        object.__setattr__(self, name, array)

    def __reduce__(self) -> tuple[Any, ...]:
        # Arrays that are unpickled or copied by themselves could be written to.
        return type(self), tuple(getattr(self, f.name) for f in dataclasses.fields(self))

    def __len__(self) -> int:
        """Number of Gaussians."""
        return len(self.mean)

    def __repr__(self) -> str:
        blend = ", additive" * (self.blend == ADD) + ", transparent" * self.transparent
        return f"<gauss2svg.Scene {self.width:g}x{self.height:g}, {len(self)} Gaussians{blend}>"

    def _repr_html_(self) -> str | None:
        return None if Scene.as_html is None else Scene.as_html(self)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(n, 2, 2) covariance [[sx^2, rho sx sy], [rho sx sy, sy^2]] in px^2."""
        factor = self.factor
        return factor @ np.swapaxes(factor, 1, 2)

    @property
    def factor(self) -> NDArray[np.float64]:
        """(n, 2, 2) lower Cholesky factor of the covariance in px.

        [[sx, 0], [rho sy, sqrt(1 - rho^2) sy]]: it maps the unit circle to the
        one-sigma ellipse.
        """
        sx, sy = self.sigma.T
        factor = np.zeros((len(self), 2, 2))
        factor[:, 0, 0] = sx
        factor[:, 1, 0] = self.rho * sy
        factor[:, 1, 1] = narrowing_of(self.rho) * sy
        return factor

    @property
    def whitening(self) -> NDArray[np.float64]:
        """(n, 3) entries w11, w21, w22 of the inverse of the factor, in 1/px.

        r^2 = (w11 u)^2 + (w21 u + w22 v)^2 for the offset (u, v) from the mean.
        """
        return whitening_of(self.sigma, self.rho)

    @property
    def conic(self) -> NDArray[np.float64]:
        """(n, 2, 2) inverse covariance in 1/px^2."""
        w11, w21, w22 = self.whitening.T
        conic = np.empty((len(self), 2, 2))
        conic[:, 0, 0] = w11 * w11 + w21 * w21
        conic[:, 0, 1] = conic[:, 1, 0] = w21 * w22
        conic[:, 1, 1] = w22 * w22
        return conic

    @property
    def densities(self) -> NDArray[np.float64]:
        """(n, 3) coefficients of the paper's normal densities, in px^2: 2 pi sqrt(det Sigma) color.

        phi(x) = exp(-r^2 / 2) / (2 pi sqrt(det Sigma)) times these is color exp(-r^2 / 2).
        """
        root = self.factor[:, 0, 0] * self.factor[:, 1, 1]
        return self.color * (2 * np.pi * root)[:, None]

    @property
    def ellipse_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """One-sigma semi-axes (n, 2) in px, larger first, and the larger one's angle_rad (n,).

        Singular values of the factor, from the sums and differences of its entries;
        the angle runs from +x towards +y (downwards) in -pi/2..pi/2.
        """
        factor = self.factor
        l11, l21, l22 = factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]
        far = np.hypot(l11 + l22, l21)
        near = np.hypot(l11 - l22, l21)
        large = 0.5 * (far + near)
        axes = np.stack([large, l11 * l22 / large], axis=1)
        variance_x, variance_y = np.square(self.sigma).T
        return axes, 0.5 * np.arctan2(2 * l11 * l21, variance_x - variance_y)

    @property
    def inks(self) -> NDArray[np.float64] | None:
        """(k, 3) colours of a scene of opaque plain ellipses alone, its background's among them.

        In the order of their numbers; None of a scene with other shapes.
        """
        if not ((self.drawn == PLAIN).all() and (self.opacity == 1).all()):
            return None
        ground = np.zeros((0, 3)) if self.transparent else self.background[None]
        return np.unique(np.round(np.concatenate([ground, self.color]) * 255), axis=0) / 255

    def replace(self, **changes: Any) -> Self:
        """A new scene with some fields replaced; validated again."""
        return dataclasses.replace(self, **changes)

    def select(self, index: NDArray[Any] | slice) -> Self:
        """The Gaussians that a mask, slice or index array picks; rounds must not decrease.

        Raises InputError for an index that is none of these, or out of range.
        """
        try:
            picked = np.arange(len(self))[index]
        except (IndexError, TypeError, ValueError):  # of NumPy, each for another kind of index
            picked = None
        if picked is None or picked.ndim != 1:
            count = len(self)
            raise InputError(
                f"index must be a slice, a mask of {count} or indices in {-count}..{count - 1}; "
                f"got {quoted(index)}"
            )
        return self.replace(**{p.name: getattr(self, p.name)[picked] for p in PARAMETERS})

    def concatenate(self, top: Scene) -> Self:
        """The scene with the Gaussians of another composited over it, as later rounds.

        Canvas, background and transparency are those of this scene. Raises SceneError if the blends
        differ.
        """
        if self.blend != required(top, "upper scene", Scene).blend:
            raise SceneError(
                f"blend of the upper scene must be {self.blend!r}; got {quoted(top.blend)}"
            )
        later = 0
        if len(self) and len(top):
            later = max(0, int(self.round_index[-1]) + 1 - int(top.round_index[0]))
        top = top.replace(round_index=top.round_index + later)
        names = [parameter.name for parameter in PARAMETERS]
        return self.replace(
            **{name: np.concatenate([getattr(self, name), getattr(top, name)]) for name in names}
        )

    def scaled(self, factor_x: float, factor_y: float | None = None) -> Self:
        """The scene on a canvas scaled by factor_x and factor_y (> 0; the same if None).

        Raises SceneError where that leaves the domain.
        """
        scale = np.array([factor_x, factor_x if factor_y is None else factor_y], np.float64)
        if not (np.isfinite(scale).all() and (scale > 0).all()):
            raise SceneError(
                f"scale factors must be finite and above 0; got {quoted(scale.tolist())}"
            )
        followed = {
            p.name: p.followed(getattr(self, p.name), scale) for p in PARAMETERS if p.followed
        }
        width, height = self.width * scale[0], self.height * scale[1]
        return self.replace(width=width, height=height, **followed)

    def save(self, file: str | os.PathLike[str] | BinaryIO) -> None:
        """Write the scene as .npz, without loss; a named file is written atomically.

        Raises InputError for something else than a file, OutputError if it cannot be written.
        """
        if isinstance(file, (str, os.PathLike)):
            whole = io.BytesIO()
            self.save(whole)
            write_atomically(file_name("file", file), whole.getvalue())
            return
        if not hasattr(file, "write"):
            raise InputError(f"file must be a path or a binary file; got {type(file).__name__}")
        fields: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        np.savez_compressed(file, format_version=_FORMAT_VERSION, **fields)

    @classmethod
    def load(cls, file: str | os.PathLike[str] | BinaryIO) -> Self:
        """Read a scene written by save.

        Raises InputError for another file, SceneError for arrays that no scene has.
        """
        try:
            with np.load(file, allow_pickle=False) as stored:
                version = int(stored["format_version"])
                if version != _FORMAT_VERSION:
                    raise InputError(
                        f"format version of a scene file must be {_FORMAT_VERSION}; got {version}"
                    )
                values = {f.name: stored[f.name] for f in dataclasses.fields(cls)}
            for name in ("width", "height", "blend", "transparent"):
                values[name] = values[name].item()
        except Gauss2SvgError:
            raise
        except Exception as error:  # numpy, zipfile and zlib each raise their own
            raise InputError(
                f"scene file must be one written by Scene.save; got {brief(error)}"
            ) from error
        return cls(**values)


def narrowing_of(rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """sqrt(1 - rho^2), (n,), without cancellation where |rho| is nearly 1."""
    return np.sqrt((1 - rho) * (1 + rho))


def whitening_of(sigma: NDArray[np.float64], rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) entries w11, w21, w22 of Scene.whitening, in 1/px, for sigma (n, 2) and rho (n,)."""
    sx, sy = sigma.T
    k = narrowing_of(rho)
    return np.stack([1 / sx, -rho / (sx * k), 1 / (sy * k)], axis=1)


def _detached(name: str, values: ArrayLike) -> ArrayLike:
    """Values, unless they are a torch tensor that numpy may not read."""
    if getattr(values, "requires_grad", False) is True:
        raise SceneError(
            f"{name} must be without a gradient; got a tensor that requires grad. Try "
            "tensor.detach()"
        )
    return values


def _bound(value: float) -> str:
    """Shortest text that is still that number."""
    return f"{value:g}" if float(f"{value:g}") == value else repr(float(value))


def peaks_of(
    densities: NDArray[np.float64], sigma: NDArray[np.float64], rho: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, 3) colours at the mean of normal densities with these coefficients (n, 3).

    densities / (2 pi sx sy sqrt(1 - rho^2)), for sigma (n, 2) in px and rho (n,): the `color` of an
    additive scene, and the inverse of Scene.densities.
    """
    root = sigma.prod(axis=1) * narrowing_of(rho)
    return densities / (2 * np.pi * root)[:, None]
