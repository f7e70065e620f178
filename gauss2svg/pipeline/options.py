"""The options of a run, in six groups, from which all other forms are derived."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from gauss2svg.errors import InputError, quoted
from gauss2svg.fit.options import MOST_GAUSSIANS, DensifyOptions, FitOptions
from gauss2svg.measure import color_name
from gauss2svg.measure.scores import TARGETS, Score
from gauss2svg.options import (
    Field,
    Number,
    OneOf,
    OptionGroup,
    Renderer,
    Whole,
    byte_size,
    fields_of,
)
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.scene import OVER
from gauss2svg.svg.document import LEAST_PRECISION, MOST_PRECISION, STOP_COUNTS, Document, Form

AUTO = "auto"
_MOST_DECIBELS = 100.0  # 8-bit images that differ have less up to 65 megapixels


@dataclass(frozen=True, kw_only=True)
class Goal(OptionGroup):
    """Targets and limits of a run, the first of which ends it.

    A limit of bytes or seconds that is given alone is a budget, and the best picture within it is
    wanted; a preset or a number of Gaussians beside it is a cap, and two limits hold both.
    """

    quality: Literal["draft", "fast", "balanced", "high", "max"] | None = None
    """Preset (balanced); a cap beside a limit."""

    gaussians: Annotated[int | Literal["auto"] | None, Whole(0, MOST_GAUSSIANS)] = None
    """Number of Gaussians, with a target the largest; auto adapts it to the image."""

    target_psnr: Annotated[
        float | None,
        Number(0, _MOST_DECIBELS, above=True, advice="30 to 40, at which photos look good"),
    ] = None
    """Target PSNR (dB) of the rasterised SVG."""

    target_ssimulacra2: Annotated[
        float | None, Number(0, 99, advice="50 for medium, 70 for high quality")
    ] = None
    """Target SSIMULACRA2 of the SVG (extra scores)."""

    max_bytes: Annotated[int | str | None, byte_size] = None
    """Maximum file size, such as 150k or 1.5M."""

    time_limit: Annotated[float | None, Number(0, 1e9, above=True)] = None
    """Time limit (s) of the run; the best in it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gaussians == AUTO:
            object.__setattr__(self, "gaussians", None)
        for other in self._targets[1:]:
            raise InputError(
                f"{other.option} must be given without {self._targets[0].option}; got "
                f"'{getattr(self, other.option):g}'"
            )

    @property
    def _targets(self) -> list[Score]:
        return [score for score in TARGETS if getattr(self, score.option) is not None]

    @property
    def target(self) -> Score | None:
        """The score that has a target."""
        return next(iter(self._targets), None)

    @property
    def count(self) -> int | None:
        """The given number of Gaussians, None if it adapts to the image."""
        return self.gaussians if isinstance(self.gaussians, int) else None

    @property
    def byte_limit(self) -> int | None:
        """`max_bytes` as a number, which it is once it is checked."""
        return self.max_bytes if isinstance(self.max_bytes, int) else None

    @property
    def has_target(self) -> bool:
        """Whether there is a target or limit besides the preset."""
        limited = self.max_bytes is not None or self.time_limit is not None
        return limited or self.target is not None

    @property
    def count_adapts(self) -> bool:
        """Whether the number of Gaussians depends on the image or on a target."""
        return self.count is None or self.has_target

    @property
    def is_budget(self) -> bool:
        """Whether bytes or seconds are limited and nothing else is asked for: the best in them."""
        limited = self.max_bytes is not None or self.time_limit is not None
        others = (self.quality, self.gaussians, self.target)
        return limited and all(other is None for other in others)


@dataclass(frozen=True, kw_only=True)
class SvgOptions(OptionGroup):
    """How the SVG is written.

    A caller of vectorize gives these, of which many are by default found out; write_svg takes what
    they come to, an SvgFormat.
    """

    form: Form = "gradient"
    """gradient: radial gradients, for every renderer; blur: blurred ellipses, a smaller file for
    Chromium, Firefox and Inkscape."""

    markup: Literal["auto", "editable", "minimal"] = "auto"
    """editable: layers with names, for editors; minimal: nothing that does not draw; auto: with
    --max-bytes the better file, else editable. The better file is the one that is closer at its
    own size, or, if a drawing is within 41 dB there, the one that is closer enlarged."""

    palette: Annotated[int | None, Whole(0, 2**24)] = None
    """Maximum number of gradients in the file; fewer make it smaller, 0 writes all. The picture
    still has thousands of colours: for a few see --inks."""

    stops: Annotated[int | None, OneOf(STOP_COUNTS)] = None
    """Stops of each gradient: 5, 6, 8, 10 or 12; the preset's if not given."""

    precision: Annotated[float | None, Number(LEAST_PRECISION, MOST_PRECISION)] = None
    """Precision of coordinates (px), such as 0.05; the preset's if not given."""

    matte: Annotated[str | None, color_name] = None
    """Background colour to composite a transparent photo over: white, black, #fa0 or #ffaa00. If
    not given the SVG is transparent where the photo is."""

    portable: bool = False
    """Convert an additive fit to alpha-composited shapes, for every renderer."""

    gzip: bool = False
    """Compress the SVG, also where its name does not end in .svgz; --max-bytes applies to the
    compressed file."""

    count_gzipped: bool = False
    """Apply --max-bytes to the gzipped bytes of a plain SVG, which are what a web server sends."""


@dataclass(frozen=True, kw_only=True)
class RunOptions(OptionGroup):
    """Resources and the measuring renderer."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG to measure it; the last four must be installed."""

    scores: bool = False
    """Also measure SSIMULACRA2 and FLIP, with some seconds more for each megapixel; needs the extra
    scores."""

    max_size: Annotated[int | None, Whole(1)] = None
    """Longest side (px) of the image that the fit runs on; the preset's if not given."""

    full_size: bool = False
    """Measure the SVG at the size of the photo, and not of the fit or 1 megapixel: slower, and
    hardly another score."""

    max_pixels: Annotated[int, Whole(1, MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of the photo, checked before it is decoded."""

    threads: Annotated[int | None, Whole(1)] = None
    """CPU threads; one for each core if not given."""

    max_memory: Annotated[int | str | None, byte_size] = None
    """Maximum memory, by an estimate: 500M or 2G; 80 % of what is free if not given. A fit that
    would need more runs on fewer pixels."""


GROUPS: dict[str, type[OptionGroup]] = {
    "goal": Goal,
    "fit": FitOptions,
    "densify": DensifyOptions,
    "svg": SvgOptions,
    "document": Document,
    "run": RunOptions,
}


def unknown_option(name: str) -> TypeError:
    """The error of a keyword that vectorize does not have, with where the option belongs."""
    for keyword, group in GROUPS.items():
        if name in {field.name for field in fields_of(group)}:
            where = f"{keyword}={group.__name__}({name}=...)"
            return TypeError(f"{name} belongs to {where}; got {name}=... for vectorize itself")
    return TypeError(f"option must be one of vectorize or of its classes; got {quoted(name)}")


# Options that change no picture; max_memory only where there is too little of it.
NOT_OF_PICTURE = frozenset({"threads", "max_memory", "max_pixels", "scores"})
GROUP_TITLES = {
    "goal": "Goal",
    "fit": "Fit",
    "densify": "Densification",
    "svg": "SVG",
    "document": "Document",
    "run": "Resources",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """All options of a run."""

    goal: Goal = Goal()
    fit: FitOptions = FitOptions()
    densify: DensifyOptions = DensifyOptions()
    svg: SvgOptions = SvgOptions()
    document: Document = Document()
    run: RunOptions = RunOptions()

    @property
    def written_blend(self) -> str:
        """Blend of the shapes in the file."""
        return OVER if self.svg.portable else self.fit.blend

    @classmethod
    def from_flat(cls, values: Mapping[str, Any]) -> Options:
        """The options of these names and values; raises InputError for an unknown name."""
        groups: dict[str, dict[str, Any]] = {key: {} for key in GROUPS}
        for name, value in values.items():
            found = field_named(name)
            if found is None:
                raise InputError(
                    f"option must be one of {', '.join(option_names())}; got {quoted(name)}"
                )
            groups[found[0]][name] = value
        return cls(**{key: GROUPS[key](**given) for key, given in groups.items()})  # pyright: ignore[reportArgumentType]

    def flat(self) -> dict[str, Any]:
        """Every option's value by its name."""
        return {
            field.name: getattr(getattr(self, key), field.name)
            for key, group in GROUPS.items()
            for field in fields_of(group)
        }

    def changed(self, **values: Any) -> Options:
        """The options with other values, by their names."""
        groups: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            found = field_named(name)
            assert found is not None, name
            groups.setdefault(found[0], {})[name] = value
        new = {k: dataclasses.replace(getattr(self, k), **given) for k, given in groups.items()}
        return dataclasses.replace(self, **new)


def field_named(name: str) -> tuple[str, Field] | None:
    """Return the key of an option's group and its field, or None where no group has the option."""
    for key, group in GROUPS.items():
        for field in fields_of(group):
            if field.name == name:
                return key, field
    return None


def option_names() -> list[str]:
    """Names of all options, in the order of their groups."""
    return [field.name for group in GROUPS.values() for field in fields_of(group)]
