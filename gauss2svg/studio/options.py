"""Read options from a request, and write them as page data or a command line."""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Any

from gauss2svg.errors import InputError, quoted
from gauss2svg.measure import SCORES
from gauss2svg.options import Field, byte_size, fields_of, flag_of, texts_of
from gauss2svg.pipeline.options import GROUP_TITLES, GROUPS, Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.processes import command_line
from gauss2svg.scene.ink_lists import PALETTE_SUFFIX
from gauss2svg.studio.jobs import MASK

# Largest number of pixels of a PNG. Drawing so large a PNG takes half a gigabyte of memory.
MOST_DRAWN = 40_000_000
# Options that only the server sets, because all fits share its cores and its memory.
_NOT_OFFERED = ("threads", "max_memory", "max_pixels")
# First choices of the page: {name: (title, options that it sets)}. All others get their defaults.
USES: dict[str, tuple[str, dict[str, Any]]] = {
    "photo": ("Photo", {}),
    "drawing": ("Logo or drawing", {"areas": "always"}),
    "poster": ("Poster in inks", {"inks": 6}),
    "placeholder": ("Placeholder", {"max_bytes": 1000, "markup": "minimal"}),
    "plotter": ("Plotter", {"quality": "fast"}),
}


def options_of(values: dict[str, Any], has_focus: bool = False) -> Options:
    """Return the options of a request. Raise InputError if they are not valid.

    values     {name of an option: value}. The options are not divided into groups.
    has_focus  whether the request has a mask
    """
    for name in _NOT_OFFERED:
        if name in values:
            raise InputError(f"{name} must not be given; it is the server's. Try without it")
    if str(values.get("inks", "")).strip().lower().endswith(PALETTE_SUFFIX):
        raise InputError(f"inks must be colours or a number; got {quoted(values['inks'])}")
    options = Options.from_flat(values)
    Plan(options, has_focus=has_focus).check_renderer()
    return options


def form() -> dict[str, Any]:
    """Return the groups of options, first choices, scores and limits, as data for the page.

    Each option has its range, its default and its help text.
    """
    groups = []
    for key, group in GROUPS.items():
        texts, fields = texts_of(group), fields_of(group)
        options = [_described(f, texts[f.name]) for f in fields if f.name not in _NOT_OFFERED]
        groups.append({"title": GROUP_TITLES[key], "options": options})
    names = ("key", "name", "title", "unit", "digits", "best")
    return {
        "limits": {"png_pixels": MOST_DRAWN},
        "uses": {name: options for name, (_, options) in USES.items()},
        "groups": groups,
        "scores": [{name: getattr(score, name) for name in names} for score in SCORES],
    }


def _described(field: Field, text: str) -> dict[str, Any]:
    kind = "choice" if field.choices else "size" if field.check is byte_size else "text"
    kind = {bool: "boolean", int: "integer", float: "number"}.get(field.kind, kind)
    is_number = field.kind in (int, float)
    unit = re.search(r"\((dB|s|px)\)", text)
    names = {"svg": "SVG"} | {score.slug: score.name for score in SCORES}
    label = " ".join(names.get(word, word) for word in field.name.split("_"))
    if field.name == "count_gzipped":
        label = "count kB after gzip, as servers send them"
    return {
        "name": field.name,
        "label": label[0].upper() + label[1:],
        "flag": flag_of(field.name),
        "type": kind,
        "choices": list(field.choices) if kind == "choice" else None,
        "min": field.least if is_number else None,
        "max": field.most if is_number else None,
        "default": field.default,
        "help": text,
        "unit": unit[1] if unit else "B" if kind == "size" else None,
    }


def command_of(name: str, options: Options, has_focus: bool = False) -> str:
    """Return the command line that makes the same SVG of a photo as the studio.

    name       file name of the photo
    options    all options. Those that have their default value are left out of the line.
    has_focus  whether there is a mask, which is saved as NAME-focus.png
    """
    stem, ending = PurePath(name).stem, "svgz" if options.svg.gzip else "svg"
    words = ["gauss2svg", _as_file_name(name), "-o", _as_file_name(f"{stem}.{ending}")]
    if has_focus:
        words += ["--focus", _as_file_name(f"{stem}-{MASK}")]
    defaults = Options().flat()
    for option, value in options.flat().items():
        if value == defaults[option]:
            continue
        if isinstance(value, bool):
            words.append(flag_of(option if value else f"no_{option}"))
        elif str(value).startswith("-"):
            words.append(f"{flag_of(option)}={value}")
        else:
            words += [flag_of(option), str(value)]
    return command_line(words)


def _as_file_name(name: str) -> str:
    return f"./{name}" if name.startswith("-") else name
