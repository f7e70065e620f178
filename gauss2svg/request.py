"""A run as it was asked for, checked before anything slow begins."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property

from gauss2svg.alpha import matte_color
from gauss2svg.checks import whole_number
from gauss2svg.errors import InputError, RendererError
from gauss2svg.finish import FINISHES, renderers_of
from gauss2svg.fit.options import MOST_GAUSSIANS, FitOptions, check_blend
from gauss2svg.image import Photo
from gauss2svg.quality import Quality, quality_named
from gauss2svg.raster import DRAW_BLENDS, DRAW_TURNED_BLURS, renderer_version
from gauss2svg.scene import ADD, OVER
from gauss2svg.svg import GRADIENT, Page, SvgOptions
from gauss2svg.targets import Targets

AUTO = "auto"
# Mean squared error that a palette may add, however bad the rest: 38 dB, some three levels.
# With eight, which a coarse fit of foliage would allow, sky and leaves change their hue.
LARGEST_COLOR_ERROR = 1.6e-4
# dB that a palette of a stated count may cost at once by having fewer colours than that.
_UNSEEN_COLOR_LOSS = 0.03


@dataclass(frozen=True)
class Request:
    """What `vectorize` was called with; see there. Raises InputError for what is not valid."""

    gaussians: int | str | None
    quality: str
    iterations: int | None
    init: str
    schedule: str
    loss: str
    blend: str
    max_size: int | None
    form: str
    palette: int | None
    stops: int | None
    precision: float | None
    seed: int
    dtype: str
    falloff: str | None
    renderer: str
    finish: str | None
    targets: Targets
    portable: bool = False
    per_round: int | None = None
    round_iterations: int | None = None
    ssim_weight: float | None = None
    relocate: bool = True
    gzip: bool = False
    learning_rate: float = 1.0
    matte: str | None = None
    page: Page = field(default_factory=Page)

    def __post_init__(self) -> None:
        if isinstance(self.gaussians, str):
            if self.gaussians != AUTO:
                raise InputError(
                    f"gaussians is {self.gaussians!r}; needed is a whole number >= 0 or {AUTO}"
                )
            object.__setattr__(self, "gaussians", None)
        elif self.gaussians is not None:
            count = whole_number("gaussians", self.gaussians, 0, MOST_GAUSSIANS)
            object.__setattr__(self, "gaussians", count)
        check_blend(self.blend)
        if self.matte is not None:
            matte_color(self.matte)
        for name in ("gzip", "portable", "relocate"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(f"{name} is {getattr(self, name)!r}; needed is True or False")
        self._check_blending()
        self._check_rounds()
        whole_number("max_size", self.side, 1, 2**31 - 1)
        if self.form != GRADIENT and self.renderer not in DRAW_TURNED_BLURS:
            raise RendererError(
                f"{self.renderer} does not draw the form {self.form}, in which turned shapes are "
                f"blurred; needed is one of {', '.join(DRAW_TURNED_BLURS)}: try --renderer "
                f"{DRAW_TURNED_BLURS[0]}, or --form {GRADIENT}"
            )
        renderer_version(self.renderer)
        self._check_finish()
        _ = self.fit_options, self.svg_options(0, None)

    def check_alpha(self, photo: Photo) -> None:
        """Refuse what a transparent photo cannot have, before the fit."""
        if photo.alpha is not None and self.writes == ADD:
            raise InputError(
                f"the photo is transparent, and blend is {ADD}, whose signed colours cover "
                "nothing; needed is a colour under it: --matte white, or blend it over: --portable"
            )

    def _check_blending(self) -> None:
        """Refuse what a sum cannot have, unless it is written in the portable form."""
        if self.portable and self.blend != ADD:
            raise InputError(
                f"portable is asked for with blend {self.blend}, portable as it is; needed is "
                f"blend {ADD}"
            )
        if self.writes != ADD:
            return
        if self.renderer not in DRAW_BLENDS:
            raise RendererError(
                f"{self.renderer} does not draw sums, which need mix-blend-mode; needed is one of "
                f"{', '.join(DRAW_BLENDS)}: try --renderer {DRAW_BLENDS[0]}, or --portable"
            )
        page = self.page
        for name, given in {
            f"form {self.form}": self.form != GRADIENT,
            f"finish {self.finish}": self.finish is not None,
            "segments": page.segments is not None,
            "animate": page.animate is not None,
            "fragments": page.fragments,
        }.items():
            if given:
                raise InputError(
                    f"{name} is asked for with blend {ADD}, whose file has neither layers in "
                    "painter's order nor opacities; leave it out, or write the sum in the portable "
                    "form: --portable"
                )

    def _check_rounds(self) -> None:
        for name in ("per_round", "round_iterations"):
            value = getattr(self, name)
            if value is not None and self.scene_decides:
                raise InputError(
                    f"{name} is {value}, of a schedule to a given count; needed is a number of "
                    "gaussians, and no target"
                )

    def _check_finish(self) -> None:
        if self.finish is None:
            return
        if self.finish not in FINISHES:
            raise InputError(f"finish is {self.finish!r}; needed is one of {', '.join(FINISHES)}")
        if self.targets.time_limit_s is not None:
            raise InputError(
                "finish and time_limit are both given; needed is one of them, for a fit takes all "
                "the time that there is: give --iterations in place of the limit"
            )
        for name in renderers_of(self.finish):
            renderer_version(name)
            if self.form != GRADIENT and name not in DRAW_TURNED_BLURS:
                raise RendererError(
                    f"finish {self.finish} draws by {name}, which does not draw the form "
                    f"{self.form}; needed is --finish {DRAW_TURNED_BLURS[0]}, or --form {GRADIENT}"
                )

    @cached_property
    def preset(self) -> Quality:
        """The quality's numbers."""
        return quality_named(self.quality)

    @property
    def count(self) -> int | None:
        """Gaussians asked for, None where the scene decides."""
        return self.gaussians if isinstance(self.gaussians, int) else None

    @property
    def scene_decides(self) -> bool:
        """Whether the count follows from the scene or from a target."""
        return self.count is None or self.targets != Targets()

    @property
    def palette_is_counted(self) -> bool:
        """Whether the palette has a stated size, and not one that follows from its loss."""
        return self.palette is not None or not self.scene_decides

    @property
    def side(self) -> int:
        """Longest side in px of the picture that the fit runs on."""
        return self.preset.max_size if self.max_size is None else self.max_size

    @property
    def writes(self) -> str:
        """How the shapes of the file blend."""
        return OVER if self.portable else self.blend

    @cached_property
    def sum_options(self) -> FitOptions:
        """How to fit the sum that a portable form begins with."""
        return dataclasses.replace(self.fit_options, blend=ADD, falloff=None)

    @cached_property
    def fit_options(self) -> FitOptions:
        """How to fit what is written: a time limit alone takes the place of the iterations."""
        iterations, targets = self.iterations, self.targets
        only_time = targets == Targets(time_limit_s=targets.time_limit_s) != Targets()
        if iterations is None and not only_time:
            iterations = self.preset.iterations
        return FitOptions(
            gaussians=self.count or 0,
            iterations=iterations,
            placement=self.init,
            schedule=self.schedule,
            loss=self.loss,
            seed=self.seed,
            dtype=self.dtype,
            falloff=self.falloff,
            blend=self.writes,
            per_round=self.per_round,
            round_iterations=self.round_iterations,
            ssim_weight=self.ssim_weight,
            relocate=self.relocate,
            learning_rate=self.learning_rate,
        )

    def svg_options(self, gaussians: int, error: float | None) -> SvgOptions:
        """How to write a scene of so many Gaussians and, if known, mean squared error."""
        preset = self.preset
        colors, loss = self.palette, 0.0
        if colors is None:
            colors = 0 if self.scene_decides else preset.palette_for(gaussians)
            loss = preset.color_loss if self.scene_decides else _UNSEEN_COLOR_LOSS
        color_error = 0.0
        if error is not None and self.palette is None:
            color_error = min(error * (10 ** (loss / 10) - 1), LARGEST_COLOR_ERROR)
        return SvgOptions(
            form=self.form,
            palette=colors,
            color_error=color_error,
            stops=preset.stops if self.stops is None else self.stops,
            precision=preset.precision if self.precision is None else self.precision,
            opacity_decimals=preset.opacity_decimals,
        )
