"""The options of a run in five groups, and the progress that a run reports.

The command line and the report are derived from the options.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_type_hints

from gauss2svg.errors import InputError, instance, nearest, quoted, refusal
from gauss2svg.fit import MOST_GAUSSIANS, FitOptions, FitProgress
from gauss2svg.measure import TARGETS, Score
from gauss2svg.options import Interval, OptionGroup, Renderer, byte_size, check_color, fields_of
from gauss2svg.photo import DEFAULT_MAX_PIXELS, MOST_PIXELS
from gauss2svg.scene import OVER
from gauss2svg.svg import LEAST_PRECISION, MOST_PRECISION, Document, Form, StopCount

AUTO = "auto"
ALWAYS, NEVER = "always", "never"
# Largest target in dB. At this PSNR, a picture is almost exact: fewer than one value in 100,000 is
# wrong, and only by one level of 255.
_MOST_DECIBELS = 100.0


@dataclass(frozen=True, kw_only=True)
class Goal(OptionGroup):
    """Targets and limits of a run. The first one that is reached ends the run.

    A limit of bytes or seconds that is given alone is a budget: the best picture within the limit
    is written. A preset or a number of Gaussians that is given together with a limit is an upper
    bound. If both bytes and seconds are limited, the file meets both limits.
    """

    quality: Annotated[
        Literal["draft", "fast", "balanced", "high", "max"] | None,
        "high, or --target-psnr 35 for a number",
    ] = None
    """Preset (balanced). With a limit, the maximum."""

    gaussians: Annotated[int, Interval(ge=0, le=MOST_GAUSSIANS)] | Literal["auto"] | None = None
    """Number of shapes. auto adapts it (default). With a target, the maximum."""

    target_psnr: Annotated[
        float | None, Interval(ge=0.01, le=_MOST_DECIBELS), "30 to 40, at which photos look good"
    ] = None
    """PSNR (dB) to reach with the fewest shapes."""

    target_ssimulacra2: Annotated[
        float | None, Interval(ge=0, le=99), "50 for medium, 70 for high quality"
    ] = None
    """SSIMULACRA2 to reach. Needs gauss2svg[scores]."""

    max_bytes: Annotated[int | str | None, byte_size] = None
    """Write the best picture within this size: 150k."""

    time_limit: Annotated[float | None, Interval(ge=0.001, le=1e9)] = None
    """Write the best picture within this time (s)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.gaussians == AUTO:
            object.__setattr__(self, "gaussians", None)
        targets = [one.option for one in TARGETS if getattr(self, one.option) is not None]
        if len(targets) > 1:
            raise InputError(f"{targets[1]} must not be given with {targets[0]}. Try one of them")

    @property
    def target(self) -> Score | None:
        """Score for which a target is given, or None."""
        return next((one for one in TARGETS if getattr(self, one.option) is not None), None)

    @property
    def count(self) -> int | None:
        """Number of Gaussians that the user gave, or None if the number adapts to the image."""
        return self.gaussians if isinstance(self.gaussians, int) else None

    @property
    def byte_limit(self) -> float:
        """`max_bytes` as a number of bytes, infinite without a limit."""
        return self.max_bytes if isinstance(self.max_bytes, int) else math.inf

    @property
    def is_limited(self) -> bool:
        """Whether the bytes of the file or the seconds of the run are limited."""
        return self.max_bytes is not None or self.time_limit is not None

    @property
    def count_adapts(self) -> bool:
        """Whether the number of Gaussians depends on the image, on a target or on a limit."""
        return self.count is None or self.is_limited or self.target is not None


@dataclass(frozen=True, kw_only=True)
class SvgOptions(OptionGroup):
    """Options of the SVG that `vectorize` writes.

    `vectorize` chooses the values that are not given. `write_svg` takes the chosen form, markup,
    stops and precision as an SvgFormat.
    """

    form: Form = "gradient"
    """gradient: ellipses with radial gradients, which every renderer draws. blur: blurred ellipses,
    which make a smaller file for Chromium, Firefox and Inkscape."""

    markup: Literal["auto", "editable", "minimal"] = "auto"
    """How the file is written. editable: named layers, for editors. minimal: only what draws, in
    fewer bytes. auto: editable, or minimal with --max-bytes up to 200k."""

    areas: Literal["auto", "always", "never"] = "auto"
    """always: draw areas with crisp edges as paths, and thin lines as strokes, below the shapes.
    auto: in drawings, logos and icons, but not in photos. never: draw shapes alone."""

    palette: Annotated[int | None, Interval(ge=0, le=2**24)] = None
    """Maximum number of gradients in the file. Fewer make it smaller, and 0 sets no limit. The
    picture still has thousands of colours. For a few colours use --inks."""

    stops: StopCount | None = None
    """Number of stops in each gradient, the points between which its opacity changes evenly. The
    default depends on the preset."""

    precision: Annotated[float | None, Interval(ge=LEAST_PRECISION, le=MOST_PRECISION)] = None
    """Step (px) to which coordinates are rounded, such as 0.05. The default depends on the
    preset."""

    current_color: bool = False
    """Write the colour of a one-colour drawing as currentColor, so that the page in which an icon
    stands may set it by CSS."""

    matte: Annotated[str | None, check_color] = None
    """Background colour for a transparent photo: a name such as white, #fa0 or #ffaa00. If not
    given, the SVG is transparent where the photo is."""

    portable: bool = False
    """Convert the result of --blend add to shapes that every renderer draws."""

    gzip: bool = False
    """Compress the file, as a name that ends in .svgz does. --max-bytes then limits the compressed
    size."""

    count_gzipped: bool = False
    """Let --max-bytes limit the size after gzip at level 9. The file is written uncompressed.
    Servers that use a lower level send some percent more: level 6 up to 5 %."""


@dataclass(frozen=True, kw_only=True)
class RunOptions(OptionGroup):
    """Options for measuring the file of a run, and for the resources that the run may use."""

    renderer: Renderer = "resvg"
    """Renderer that rasterises the SVG to measure it. resvg comes with gauss2svg, cairo needs the
    system library cairo, and the others are programs to install."""

    scores: bool = False
    """Also measure SSIMULACRA2 and FLIP, in some seconds for each megapixel. Needs
    gauss2svg[scores]."""

    max_size: Annotated[int | None, Interval(ge=1)] = None
    """Longest side (px) at which the photo is fitted. Larger photos are reduced first. The default
    depends on the preset."""

    full_size: bool = False
    """Measure the SVG at the size of the photo. Otherwise it is measured at the size of the fit, or
    at 1 megapixel if that is larger, which is faster and gives nearly the same scores."""

    max_pixels: Annotated[int, Interval(ge=1, le=MOST_PIXELS)] = DEFAULT_MAX_PIXELS
    """Maximum number of pixels of a photo. Larger photos are refused before they are decoded."""

    threads: Annotated[int | None, Interval(ge=1)] = None
    """Number of CPU threads. The default is one for each core."""

    max_memory: Annotated[int | str | None, byte_size] = None
    """Maximum memory, such as 500M or 2G. The default is 80 % of the free memory. A fit that is
    estimated to need more runs on fewer pixels."""


# Options that do not change the picture. There is one exception: if max_memory is too small for
# the fit, the fit runs on fewer pixels.
NOT_OF_PICTURE = frozenset({"threads", "max_memory", "max_pixels", "scores"})
# Titles of the groups, in the order of the help.
GROUP_TITLES = {
    "goal": "Goal",
    "svg": "SVG",
    "document": "Document",
    "run": "Measuring and resources",
    "fit": "Fit",
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """All options of a run. None in place of a group stands for its defaults."""

    goal: Goal = Goal()
    fit: FitOptions = FitOptions()
    svg: SvgOptions = SvgOptions()
    document: Document = Document()
    run: RunOptions = RunOptions()

    def __post_init__(self) -> None:
        for key, group in GROUPS.items():
            object.__setattr__(self, key, instance(getattr(self, key), key, group))

    @property
    def written_blend(self) -> str:
        """Blend mode of the shapes in the file."""
        return OVER if self.svg.portable else self.fit.blend

    @classmethod
    def from_flat(cls, values: Mapping[str, Any]) -> Options:
        """Return options with the given values, which are named as in `flat`.

        All other options have their defaults. Raise InputError for an unknown name.
        """
        return cls().changed(**values)

    def flat(self) -> dict[str, Any]:
        """Return the values of all options by the options' names. A function is its name."""
        values = {name: getattr(getattr(self, key), name) for name, key in OPTIONS.items()}
        return {k: getattr(v, "__name__", v) if callable(v) else v for k, v in values.items()}

    def of_picture(self) -> dict[str, Any]:
        """Return the values of the options that may change the picture, by the options' names."""
        return {k: value for k, value in self.flat().items() if k not in NOT_OF_PICTURE}

    def changed(self, /, **values: Any) -> Options:
        """Return the options with these values changed. Raise InputError for an unknown name."""
        groups: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            if name not in OPTIONS:
                needed, advice = f"one of {', '.join(OPTIONS)}", nearest(name, OPTIONS)
                raise refusal("option", needed, quoted(name), advice)
            groups.setdefault(OPTIONS[name], {})[name] = value
        new = {k: dataclasses.replace(getattr(self, k), **given) for k, given in groups.items()}
        return dataclasses.replace(self, **new)


# The key of each group of options, with the class of the group.
GROUPS: dict[str, type[OptionGroup]] = get_type_hints(Options)
# The name of each option, with the key of its group.
OPTIONS = {field.name: key for key, group in GROUPS.items() for field in fields_of(group)}


@dataclass(frozen=True)
class Progress:
    """The phase in which a run of `vectorize` is, and the state of the fit.

    phase  "read", "areas" (only with areas), "additive" (only with the option portable),
           "fit", "write", "correct" or "measure". "correct" and then "write" come again for each
           correction of the number of Gaussians, and so do "areas" and "write" for each file that
           is over the limit of bytes. "measure" comes at the end. If there is a target, it also
           comes after each "write"
    fit    state of the fit during "areas", "additive", "fit" and "correct", otherwise None. It is
           also None in "areas" before any are found
    """

    phase: str
    fit: FitProgress | None = None


ProgressCallback = Callable[[Progress], None]
