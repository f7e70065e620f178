"""The scene: an ordered list of 2D Gaussians on a canvas, as arrays.

Each parameter is declared once, as a record in CANVAS or PARAMETERS. The code that checks, selects,
concatenates, scales and saves scenes reads these records and names no parameters. The records also
tell fits the raw form and the learning rate of each parameter, and its columns of Adam's arrays. To
add a parameter of shapes, add a record to PARAMETERS and a field to Scene. If fits step the
parameter, add a field to gauss2svg.fit.state.State too. Renderers, writers and readers must be
changed as well, because they name the parameters that they use (docs/development.md).
"""

from __future__ import annotations

import dataclasses
import io
import math
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg import portable
from gauss2svg.errors import InputError, SceneError, brief, plain_scalar, quoted, required, several
from gauss2svg.files import write_atomically
from gauss2svg.options import Field, file_name
from gauss2svg.scene import ADD, BLENDS, OVER
from gauss2svg.scene.areas import Area, areas_from_json, areas_to_json, checked_array
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA

LEAST_CANVAS, MOST_CANVAS = 1e-6, 1e9  # bounds in px of a side of the canvas
# Largest absolute value of a signed colour. Sums of larger colours would lose too much accuracy
# when they are rounded to 8 bits.
MOST_SIGNED = 100.0
# Largest |rho|: the largest float below 1. At it, sqrt((1 - rho)(1 + rho)) is 1.5e-8 and not 0.
RHO_LIMIT = math.nextafter(1, 0)
# Bounds of sigma and of the mean in px. A Gaussian with a smaller sigma would be invisible, because
# pixels are sampled at their centres. Renders in float64 and gradients in float32 stay finite even
# at 1000 times the upper bounds.
LEAST_SIGMA, MOST_SIGMA = 1e-9, 1e9
MOST_MEAN = 1e12

# Ways in which a file draws a shape. SOFT: by a gradient, or by a plain ellipse if that looks the
# same. PLAIN: always by a plain ellipse. BLURRED: as a blurred disc.
SOFT, PLAIN, BLURRED = range(3)
ABOVE = -1  # level of a Gaussian above all areas

# Bounds of ln beta in a fit. At the lower bound a shape is nearly a Gaussian. If this bound were 0,
# the kernels would leave out the gradient of the exponent of such a shape. If it were below 0, fits
# would be worse (docs/decisions/adam.md).
LEAST_RAW_BETA, MOST_RAW_BETA = 1e-6, 7 * 0.6931471805599453

_Values = NDArray[Any]


@dataclass(frozen=True)
class Raw:
    """The raw form of a parameter, which a fit changes. Mean, sigma and rho have no raw form.

    name         field of gauss2svg.fit.state.State with the raw values
    activated    function from raw values to those of a scene
    inverse      function from values of a scene to raw values
    least, most  bounds of the raw values
    """

    name: str
    activated: Callable[[_Values], _Values]
    inverse: Callable[[_Values], _Values]
    least: float
    most: float


@dataclass(frozen=True)
class Parameter:
    """A parameter of each shape of a scene, or of its canvas.

    name             field of the scene with its array
    width            how many numbers it has for each shape. Its array is (n,) if width is 1, else
                     (n, width)
    least, most      least and largest value in a scene
    additive_domain  least and largest value in an additive scene, if they differ from these
    default          value in a scene for which none is passed; None if a value is required
    dtype            NumPy type of its array in a scene
    scaled           whether it is in px, so that it is scaled with the canvas
    raw              raw form in a fit; None if it is mean, sigma or rho, or never changes in a fit
    rate             learning rate in the frame of gauss2svg.fit.state; 0 if it is not stepped
    shared           whether all shapes that share a gradient in a file must have the same value. In
                     the last steps of a fit, Population.step keeps such values equal
    advice           text that follows "Try" in the error for a value out of the domain
    once             whether a scene has a single value in place of one for each shape
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

        If `values` is None, return the default. If `count` is None, any number of Gaussians is
        accepted. Raise SceneError if the values have another shape or are outside the domain.
        """
        low, high = self.domain(blend)
        if values is None:
            size = 0 if self.default is None else count or 0
            values = np.full(self.shape(size), self.default or 0)
        name, domain = f"scene {self.name}", " in an additive scene" * (blend == ADD)
        shape = self.shape(-1 if count is None else count)
        array = checked_array(name, values, shape, low, high, domain, self.advice)
        whole = array.astype(self.dtype, copy=False)
        if (whole != array).any():
            at = int(np.argmax(whole != array))
            raise SceneError(f"{name}[{at}] must be whole; got {array[at]}. Try to round it")
        whole.flags.writeable = False
        return whole


_COLOR_ADVICE = "to clip it, or to divide by 255 what is in 8 bits"
CANVAS = (
    *(
        Parameter(
            side, 1, LEAST_CANVAS, MOST_CANVAS, advice="to scale the scene", scaled=True, once=True
        )
        for side in ("width", "height")
    ),
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
        # The bounds of the logit stand for opacities of 0.0003 and 0.999994. Opacities beyond these
        # would not change an image of 8 bits.
        raw=Raw(
            "raw_opacity", lambda logit: 1 / (1 + portable.exp(-logit)),
            lambda p: portable.log(p / (1 - p)), -8.0, 12.0,
        ),
        advice="to clip it, and in an additive scene to multiply the colour by it",
    ),
    Parameter(
        "color", 3, 0.0, 1.0, additive_domain=(-MOST_SIGNED, MOST_SIGNED), rate=0.045, shared=True,
        advice=_COLOR_ADVICE, raw=Raw("color", np.asarray, np.asarray, 0.0, 1.0),
    ),
    Parameter(
        "beta", 1, LEAST_BETA, MOST_BETA, additive_domain=(1.0, 1.0), default=1.0, rate=0.05,
        raw=Raw("raw_beta", portable.exp, portable.log, LEAST_RAW_BETA, MOST_RAW_BETA), shared=True,
    ),
    Parameter("round_index", 1, 0, 2**31 - 1, default=0, dtype=np.int32, advice="to count from 0"),
    Parameter("drawn", 1, SOFT, BLURRED, additive_domain=(SOFT, SOFT), default=SOFT, dtype=np.int8),
    Parameter(
        "level", 1, ABOVE, 2**31 - 1, default=ABOVE, dtype=np.int32,
        advice="-1 above all areas, or the number of areas below the Gaussian",
    ),
)  # fmt: skip

# Parameters that Adam steps in their raw forms. In Adam's arrays, the columns of these parameters
# follow those of mean, sigma and rho, in this order.
STEPPED = tuple((parameter, parameter.raw) for parameter in PARAMETERS if parameter.raw)


# Version of scene files. It stays the same when a parameter with a default is added.
_FORMAT_VERSION = 1
# A field that is not passed has this value, until the constructor replaces it by the default.
_DEFAULT: Any = None


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """Gaussians on a canvas, the bottom Gaussian first. A scene is validated and immutable.

    The covariance of a Gaussian is [[sx^2, rho sx sy], [rho sx sy, sy^2]], which is
    positive definite for every |rho| < 1 (the parametrisation of "Investigation into
    2D Gaussian Splatting for Image Representation").

    width, height  canvas in px, LEAST_CANVAS..MOST_CANVAS
    mean           (n, 2) x, y in px, in -MOST_MEAN..MOST_MEAN. Pixel i has its centre at i + 0.5
    sigma          (n, 2) standard deviations along x and y in px, LEAST_SIGMA..MOST_SIGMA each,
                   in any ratio
    rho            (n,) correlation in -RHO_LIMIT..RHO_LIMIT, where RHO_LIMIT is just below 1
    color          (n, 3) sRGB in 0..1; if blend is "add", signed, in -MOST_SIGNED..MOST_SIGNED
    opacity        (n,) in 0..1; all 1 if blend is "add"
    background     (3,) sRGB in 0..1; in a transparent scene, the colour of the page behind it
    round_index    (n,) round of the fit that added each Gaussian. It never decreases from one
                   Gaussian to the next. None for all 0
    blend          "over": source-over in sRGB, as in every SVG renderer; "add": as in the paper,
                   image = background + sum f(r_k) color_k in any order, clipped to 0..1 at the end
    beta           (n,) exponent of the falloff in LEAST_BETA..MOST_BETA, 1 for a Gaussian (see
                   gauss2svg.scene.falloff); None for all 1; all 1 if blend is "add"
    drawn          (n,) how a file draws each shape. SOFT: by a gradient, or by a plain ellipse if
                   that looks the same. PLAIN: by a plain ellipse at any size. BLURRED: as a blurred
                   disc, in the form "blur". None for all SOFT
    level          (n,) how many areas lie below each Gaussian, or ABOVE (-1) for all areas. The
                   areas above a Gaussian hide what they cover of it. It never decreases, and ABOVE
                   counts as the highest. None for all ABOVE
    transparent    whether the background is left out of files and of render_rgba, whose image then
                   has alpha; False if blend is "add"
    areas          areas and lines (gauss2svg.scene.areas) above the background, the bottom one
                   first; none if blend is "add"

    A signed colour is what its Gaussian adds to the image at its mean. The paper uses coefficients
    of normal densities instead, which are 2 pi sqrt(det Sigma) times as large.

    Arrays are copied, read-only and float64, except that round_index and level are int32, and drawn
    is int8. Both renderers draw any scene of this domain, with finite gradients. write_svg refuses
    scenes that a file cannot hold. If a value is wrong, the constructor raises SceneError or
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
    areas: tuple[Area, ...] = ()
    level: NDArray[np.int32] = _DEFAULT

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
            needed = "'over' if transparent"
            raise SceneError(f"scene blend must be {needed}; got 'add'. Try a background")
        areas = tuple(self.areas) if isinstance(self.areas, Iterable) else (self.areas,)
        if others := [area for area in areas if not isinstance(area, Area)]:
            raise SceneError(f"scene areas must be Areas; got {quoted(others[0])}")
        object.__setattr__(self, "areas", areas)
        if self.blend == ADD and self.areas:
            raise SceneError("scene blend must be 'over' if there are areas; got 'add'")
        count = len(self.areas)
        if self.level.max(initial=ABOVE) > count:
            needed = f"at most {count}, the number of areas"
            raise SceneError(f"scene level must be {needed}; got {self.level.max()}")
        if np.any(np.diff(np.where(self.level == ABOVE, count + 1, self.level)) < 0):
            raise SceneError("scene level must not decrease; got lower Gaussians over higher ones")

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

        sigma is (sqrt(c11), sqrt(c22)), and rho is c12 / sqrt(c11 c22).

        covariance  (n, 2, 2) in px^2, symmetric and positive definite
        opacity     (n,), or one number for all Gaussians
        others      further fields by name, such as background or blend
        Raise SceneError with the index of the first matrix that is not a covariance.
        """
        matrices = np.array(covariance, np.float64)
        if matrices.ndim != 3 or matrices.shape[1:] != (2, 2):
            raise SceneError(f"covariance must be of shape (n, 2, 2); got {matrices.shape}")
        c11, c12, c21, c22 = matrices.reshape(-1, 4).T
        with np.errstate(all="ignore"):  # no warnings, because the test refuses NaN and infinity
            valid = (c11 > 0) & (c22 > 0) & (c12 * c21 < c11 * c22) & np.isfinite(c11 * c22)
            # A matrix counts as symmetric if c12 and c21 differ only by rounding to float32.
            valid &= np.abs(c12 - c21) <= 1e-5 * np.sqrt(c11 * c22)
        if not valid.all():
            at = int(np.argmin(valid))
            raise SceneError(
                f"covariance[{at}] must be finite, symmetric and positive definite; got "
                f"{quoted(matrices[at].tolist())}. Try (c + c^T) / 2, with some .01 px^2 added on "
                "its diagonal"
            )
        sigma = np.sqrt(np.stack([c11, c22], axis=1))
        rho = np.clip(0.5 * (c12 + c21) / sigma.prod(axis=1), -RHO_LIMIT, RHO_LIMIT)
        if np.ndim(opacity) == 0:
            opacity = np.broadcast_to(opacity, len(matrices))
        return cls(width, height, mean, sigma, rho, color, opacity, **others)  # pyright: ignore[reportArgumentType] (the constructor converts)

    def __reduce__(self) -> tuple[Any, ...]:
        # The modules copy and pickle must call the constructor, which makes the arrays read-only.
        # Otherwise they would copy the arrays by NumPy, whose copies are writeable.
        return type(self), tuple(getattr(self, f.name) for f in dataclasses.fields(self))

    def __len__(self) -> int:
        """Return the number of Gaussians."""
        return len(self.mean)

    def __repr__(self) -> str:
        blend = ", additive" * (self.blend == ADD) + ", transparent" * self.transparent
        areas = f", {several(len(self.areas), 'area')}" if self.areas else ""
        size = f"{self.width:g}x{self.height:g}"
        return f"<gauss2svg.Scene {size}{areas}, {several(len(self), 'Gaussian')}{blend}>"

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance matrices (n, 2, 2) in px^2, [[sx^2, rho sx sy], [rho sx sy, sy^2]]."""
        return self.factor @ self.factor.mT

    @property
    def factor(self) -> NDArray[np.float64]:
        """Lower Cholesky factors (n, 2, 2) of the covariance, in px.

        [[sx, 0], [rho sy, sqrt(1 - rho^2) sy]] maps the unit circle to the one-sigma ellipse.
        """
        l11, l21, l22 = self.cholesky.T
        return np.stack([l11, np.zeros_like(l11), l21, l22], axis=1).reshape(-1, 2, 2)

    @property
    def cholesky(self) -> NDArray[np.float64]:
        """Entries l11, l21, l22 (n, 3) of `factor`, in px."""
        sx, sy = self.sigma.T
        return np.stack([sx, self.rho * sy, narrowing_of(self.rho) * sy], axis=1)

    @property
    def ellipse_axes(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Semi-axes (n, 2) in px of the one-sigma ellipses, and their directions (n,) in radians.

        The larger semi-axis is first. The semi-axes are the singular values of `factor`. The
        direction is that of the larger semi-axis. It is an angle in -pi/2..pi/2, which is measured
        from +x towards +y. +y points down.
        """
        l11, l21, l22 = self.cholesky.T
        axis_sum = portable.hypot(l11 + l22, l21)
        axis_difference = portable.hypot(l11 - l22, l21)
        major = 0.5 * (axis_sum + axis_difference)
        axes = np.stack([major, l11 * l22 / major], axis=1)
        variance_x, variance_y = np.square(self.sigma).T
        return axes, 0.5 * portable.arctan2(2 * l11 * l21, variance_x - variance_y)

    @property
    def inks(self) -> NDArray[np.float64] | None:
        """The inks (k, 3) of the scene, which are its distinct colours, sorted.

        This is None unless all areas have opaque colours, and all shapes are opaque plain ellipses
        above them. The colour of the background is one of the inks unless the scene is transparent.
        """
        is_plain = (self.drawn == PLAIN).all() and (self.opacity == 1).all()
        if not is_plain or (self.areas and (self.level != ABOVE).any()):
            return None
        paints = [a.paint for a in self.areas if isinstance(a.paint, tuple) and a.opacity == 1]
        if len(paints) < len(self.areas):
            return None
        ground = np.zeros((0, 3)) if self.transparent else self.background[None]
        colors = np.concatenate([ground, np.reshape(paints, (-1, 3)), self.color])
        return np.unique(np.round(colors * 255), axis=0) / 255

    def replace(self, **changes: Any) -> Self:
        """Return a new scene with some fields replaced. Raise what the constructor raises."""
        return dataclasses.replace(self, **changes)

    def select(self, index: Any) -> Self:
        """Return the scene of the Gaussians that `index`, a mask, slice or index array, picks.

        Raise SceneError if round_index or level decreases in the new order, and NumPy's IndexError
        if the index is of another kind or out of range.
        """
        picked = np.arange(len(self))[index]
        return self.replace(**{p.name: getattr(self, p.name)[picked] for p in PARAMETERS})

    def concatenate(self, top: Scene) -> Self:
        """Return a scene with the Gaussians of this scene, and those of `top` above them.

        The rounds of the upper Gaussians come after those of the lower ones. Canvas, background,
        transparency and areas are those of this scene, and the upper Gaussians lie above all areas.
        Raise SceneError if the blends differ, or if the upper scene has areas.
        """
        if self.blend != required(top, "upper scene", Scene).blend:
            needed, got = repr(self.blend), quoted(top.blend)
            raise SceneError(f"blend of the upper scene must be {needed}; got {got}")
        if top.areas:
            raise SceneError(f"the upper scene must have no areas; got {len(top.areas)}")
        later = int(self.round_index.max(initial=-1)) + 1 - int(top.round_index[:1].sum())
        top = top.replace(round_index=top.round_index + max(0, later), level=None)
        both = {p.name: (getattr(self, p.name), getattr(top, p.name)) for p in PARAMETERS}
        return self.replace(**{name: np.concatenate(arrays) for name, arrays in both.items()})

    def scaled(self, factor_x: float, factor_y: float | None = None) -> Self:
        """Return the scene with its canvas, areas and shapes scaled by factor_x and factor_y (> 0).

        If factor_y is None, it is factor_x. Raise SceneError if scaled values leave the domain.
        """
        scale = np.array([factor_x, factor_x if factor_y is None else factor_y], np.float64)
        shapes = {p.name: getattr(self, p.name) * scale for p in PARAMETERS if p.scaled}
        width, height = scale * [self.width, self.height]
        scene = self.replace(width=width, height=height, **shapes)
        areas = tuple(area.scaled(*scale.tolist()) for area in self.areas)
        return scene.replace(areas=areas) if areas else scene

    def save(self, file: str | os.PathLike[str] | BinaryIO) -> None:
        """Write the scene to an .npz file without loss.

        If `file` is a path, an interruption leaves either the old file or the complete new one.
        Raise OutputError if the path cannot be written.
        """
        content = io.BytesIO()
        fields: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        fields["areas"] = areas_to_json(self.areas)
        np.savez_compressed(content, format_version=_FORMAT_VERSION, **fields)
        if isinstance(file, (str, os.PathLike)):
            write_atomically(file_name("file", file), content.getvalue())
        else:
            file.write(content.getvalue())

    @classmethod
    def load(cls, file: str | os.PathLike[str] | BinaryIO) -> Self:
        """Return a scene that `save` has written.

        A field that the file lacks gets its default. Raise InputError if `save` did not write
        the file, and SceneError if its arrays are outside the domain.
        """
        try:
            with np.load(file, allow_pickle=False) as stored:
                values = {name: plain_scalar(stored[name]) for name in stored.files}
            if (version := int(values.pop("format_version"))) != _FORMAT_VERSION:
                raise ValueError(f"format version {version}")
            values["areas"] = areas_from_json(values.get("areas", "[]"))
            return cls(**values)
        except SceneError:
            raise
        except Exception as error:
            # NumPy, zipfile and zlib raise errors of many classes, so all classes are caught. For a
            # file of any other format, NumPy advises to unpickle it, which would run its code.
            got = "another format" if "allow_pickle" in str(error) else brief(error)
            raise InputError(
                f"scene file must be one written by Scene.save, in version {_FORMAT_VERSION}; got "
                f"{got}. Try to fit the photo again, and to save its scene"
            ) from error


def narrowing_of(rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return sqrt(1 - rho^2) (n,), without cancellation if |rho| is nearly 1."""
    return np.sqrt((1 - rho) * (1 + rho))


def whitening_of(sigma: NDArray[np.float64], rho: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the entries w11, w21, w22 (n, 3) of the inverse of `Scene.factor`, in 1/px.

    At the offset (u, v) px from the mean, r^2 is (w11 u)^2 + (w21 u + w22 v)^2.

    sigma, rho  (n, 2) in px, and (n,)
    """
    sx, sy = sigma.T
    k = narrowing_of(rho)
    return np.stack([1 / sx, -rho / (sx * k), 1 / (sy * k)], axis=1)
