"""The scene: an ordered list of 2D Gaussians on a canvas, as arrays."""

from __future__ import annotations

import dataclasses
import io
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
from gauss2svg.scene.parameters import CANVAS, PARAMETERS, PLAIN, RHO_LIMIT

_FORMAT_VERSION = 1  # version of scene files; a new parameter with a default keeps it
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
    rho            (n,) correlation, up to RHO_LIMIT either way: the last number before 1
    color          (n, 3) sRGB in 0..1; signed, up to MOST_SIGNED either way, if blend is "add"
    opacity        (n,) in 0..1; all 1 if blend is "add"
    background     (3,) sRGB in 0..1; in a transparent scene, the colour of the page that shows it
    round_index    (n,) round of the fit that added each, never decreasing; None for all 0
    blend          "over": source-over in sRGB, as in every SVG renderer; "add": as in the paper,
                   image = background + sum f(r_k) color_k in any order, clipped to 0..1 at the end
    beta           (n,) exponent of the falloff in LEAST_BETA..MOST_BETA, 1 for a Gaussian (see
                   gauss2svg.scene.falloff); None for all 1; all 1 if blend is "add"
    drawn          (n,) how a file draws each. SOFT: by a gradient, or by a plain ellipse if that
                   looks the same. PLAIN: by a plain ellipse at any size. BLURRED: as a blurred
                   disc, in the form "blur". None for all SOFT
    transparent    whether the background is left out, so that rendered images have alpha and a
                   file has no background; False if blend is "add"

    A signed colour is the contribution of its Gaussian at its mean. The paper uses coefficients of
    normal densities instead: see `densities` and `peaks_of`.

    Arrays are made read-only and have the dtypes of gauss2svg.scene.parameters: float64, but int32
    for round_index and int8 for drawn. Both renderers draw any scene of this domain with finite
    gradients. write_svg refuses what a file cannot hold. The constructor raises SceneError or
    InputError with the name of the field.
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
        # Copies are constructed anew, because arrays that are copied by themselves are writeable.
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

        A density exp(-r^2 / 2) / (2 pi sqrt(det Sigma)) times these is color exp(-r^2 / 2).
        """
        return self.color * _volume(self.sigma, self.rho)[:, None]

    @property
    def ellipse_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """One-sigma semi-axes (n, 2) in px, larger first, and the larger one's angle_rad (n,).

        The semi-axes are the singular values of the factor, from sums and differences of its
        entries. The angle runs from +x towards +y (downwards) in -pi/2..pi/2.
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

        Raise SceneError if rounds decrease in that order, and NumPy's IndexError if the index is of
        another kind or out of range.
        """
        picked = np.arange(len(self))[index]
        return self.replace(**{p.name: getattr(self, p.name)[picked] for p in PARAMETERS})

    def concatenate(self, top: Scene) -> Self:
        """Return the scene with the Gaussians of another composited over it, as later rounds.

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
        """Return the scene on a canvas scaled by factor_x and factor_y (> 0; the same if None).

        Raise SceneError if the scaled values leave the domain.
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
        except Exception as error:  # NumPy, zipfile and zlib each raise their own
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

    densities / (2 pi sx sy sqrt(1 - rho^2)) with sigma (n, 2) in px and rho (n,), which inverts
    Scene.densities.
    """
    return densities / _volume(sigma, rho)[:, None]
