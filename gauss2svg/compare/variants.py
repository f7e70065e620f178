"""The variants of a comparison: presets, numbers of Gaussians, other tools, and axes.

An axis is an option of `vectorize` that a comparison varies. It runs every combination of the
values of all axes.

The files of any other method are in a folder, with a CSV of what they cost. A CSV alone has numbers
without files.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from gauss2svg.batch.inputs import ListedPhoto
from gauss2svg.batch.many import TABLE, text_of_cell
from gauss2svg.compare.records import COSTS, COUNTS, FILE_KEYS, PEERS, TOOL
from gauss2svg.errors import Gauss2SvgError, InputError, brief, quoted, refusal
from gauss2svg.files import SVG_ENDINGS, reading, text_of
from gauss2svg.options import Field, fields_of
from gauss2svg.photo import SUFFIXES
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.plan import PRESETS, Plan
from gauss2svg.version import __version__


def rows_of(path: Path) -> list[tuple[int, dict[str, str]]]:
    """Return the line number and the text of each cell of each row of a CSV.

    Raise InputError if it cannot be read.

    A cell that a row lacks is "". A cell without a column is left out.
    """
    with reading(path, "a CSV file") as file:
        text = text_of(file.read(), str(path))
    rows = csv.DictReader(io.StringIO(text))
    return [
        (rows.line_num, {k: text_of_cell(v or "") for k, v in row.items() if k is not None})
        for row in rows
    ]


def entries_of(files: str, photos: Sequence[ListedPhoto]) -> dict[ListedPhoto, dict[str, Any]]:
    """Return what a method has of each photo: its file, the SHA-256 of that, and its numbers.

    files  "" for a tool that is run, which gives an empty dict. Otherwise a folder of
           SVGs and pictures with the names of the photos. The folder may have a table.csv, or that
           of a batch. Its column `photo` or `input` has the name of the photo, and `output` that of
           the file. `files` may also be a CSV of numbers. If it has a single row without a photo,
           the row holds for every photo.

    The file is None if the folder has none or the CSV has no numbers of the photo, and "" if the
    CSV has some. The numbers are the costs and the counts of a folder's table, or all numbers of a
    CSV, by their names in a report. Raise InputError for one that is neither a number nor empty.
    Raise it also for a CSV without such columns, and for several rows without the column `photo`.
    """
    if not files:
        return {}
    folder, is_table = Path(files), Path(files).is_file()
    tables = [folder] if is_table else [folder / "table.csv", folder / TABLE]
    rows = [row for path in tables if path.is_file() for row in rows_of(path)]
    columns = {*COSTS, *COUNTS, *(FILE_KEYS if is_table else ())} - {"renderer"}
    first = rows[0][1] if rows else {}
    is_named = len(rows) == 1 or {"photo", "input"} & first.keys()
    if is_table and not (is_named and columns & first.keys()):
        needed = "a CSV with columns of a report, and the column photo if there are several rows"
        raise refusal(files, needed, brief(", ".join(first)) or "no row", "photo,psnr_svg")
    by_name: dict[str, tuple[int, dict[str, str]]] = {}
    for line, row in rows:
        name = row.get("photo") or row.get("input") or ""
        by_name |= dict.fromkeys([Path(name).stem, name], (line, row))
    pictures = {
        path.stem: path
        for path in sorted([] if is_table else folder.iterdir())
        if path.name.lower().endswith((*SUFFIXES, *SVG_ENDINGS))
    }
    means = by_name.get("", (0, {})) if len(rows) == 1 else (0, {})
    entries = {}
    for photo in photos:
        stem = Path(photo.path).stem
        line, row = by_name.get(photo.path) or by_name.get(stem) or means
        path = folder / row["output"] if row.get("output") else pictures.get(stem)
        data = path.read_bytes() if path and path.is_file() else None
        place = f"line {line} of {files}"
        numbers = {k: _number(k, place, v) for k, v in row.items() if k in columns and v}
        entries[photo] = {
            "file": "" if is_table and numbers else data and str(path),
            "digest": data and hashlib.sha256(data).hexdigest(),
            "numbers": numbers,
        }
    return entries


def _number(column: str, place: str, cell: str) -> float:
    try:
        return int(cell) if cell.isdecimal() else float(cell)
    except ValueError as error:
        needed = "a number with a point, or empty"
        raise refusal(f"{column} in {place}", needed, quoted(cell)) from error


Settings = tuple[tuple[str, Any], ...]  # (name, value) of each setting, sorted by name


class Variant(NamedTuple):
    """A way to make a file from a photo: a tool and its settings.

    settings  (name, value) of options of gauss2svg or of another tool, sorted by name
    tool      "gauss2svg", the name of a peer, or the label of files
    version   version of the tool, or None if it is not installed
    files     folder or CSV with what another method has made of the photos. "" if a tool is run
    """

    settings: Settings
    tool: str = TOOL
    version: str | None = __version__
    files: str = ""

    @property
    def is_own(self) -> bool:
        """Whether gauss2svg makes the file. Only such files have rounds, a scene and outlines."""
        return self.tool == TOOL

    @property
    def label(self) -> str:
        """Short text of the settings: "draft", "gaussians 500", "jpeg 30"."""
        if not self.is_own:
            return " ".join([self.tool, *(str(value) for _, value in self.settings)])
        is_preset = [name for name, _ in self.settings] == ["quality"]
        return ", ".join(v if is_preset else f"{name} {v}" for name, v in self.settings)

    @property
    def slug(self) -> str:
        """Name of the variant's folder: "draft", "gaussians-500", "vtracer-default"."""
        return re.sub(r"[^\w.-]+", "-", f"files-{self.tool}" if self.files else self.label)

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of a record that describe the variant."""
        version = {"tool": self.tool, "tool_version": self.version}
        return {"label": self.label, **version, "settings": dict(self.settings)}


def peer_variants(texts: Iterable[str], most: int | None = None) -> tuple[list[Variant], list[str]]:
    """Return variants of other tools, each once, and the names of tools that are not installed.

    texts   "vtracer" for all settings of the tool, "vtracer:detailed" for one of them, or
            LABEL=PATH for the folder of files or the CSV of numbers of another method
    most    "vtracer" stands for at most this number of settings, which are the first ones of the
            tool. If it is None, "vtracer" stands for all of them.
    Raise InputError for any other text, and if two paths have the same label.
    """
    by_text: dict[str, list[Variant]] = {}
    for tool, peer in PEERS.items():
        variants = [Variant(tuple(sorted(s.items())), tool, peer.version) for s in peer.settings]
        by_text |= {variant.label.replace(" ", ":"): [variant] for variant in variants}
        by_text[tool] = variants[:most]
    by_path = "LABEL=FOLDER", "LABEL=NUMBERS.csv"
    chosen: dict[Variant, None] = {}  # used as an ordered set
    for text in sequence("peers", texts):
        label, equals_sign, files = str(text).partition("=")
        if equals_sign:
            is_taken = label in {TOOL, *PEERS, *PRESETS, *(one.tool for one in chosen)}
            is_word = re.fullmatch(r"\w[\w.-]*", label)
            if is_taken or not is_word or not files or not Path(files).exists():
                needed = "a word that no preset and no other peer has, and a path that exists"
                raise refusal("a peer with =", needed, quoted(text), " or ".join(by_path))
            chosen[Variant((), label, "", files)] = None
        else:
            name = Field("peer", words=(*by_text, *by_path)).checked(text)
            chosen |= dict.fromkeys(by_text.get(name, []))
    absent = dict.fromkeys(variant.tool for variant in chosen if variant.version is None)
    return [variant for variant in chosen if variant.version is not None], [*absent]


def variants_of(
    presets: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
    axes: Mapping[str, Sequence[Any]] | None = None,
) -> tuple[list[Variant], list[str]]:
    """Return the variants of a gallery, each once, and the peers that are not installed.

    presets  names of PRESETS
    counts   numbers of Gaussians, 0..MOST_GAUSSIANS
    axes     the values of each option that is varied. Every combination is a variant. If there are
             no presets, counts or axes, the presets are draft, balanced and high.
    peers    other tools. "vtracer" stands for VTracer with the first of its settings in
             PEERS, "vtracer:detailed" for VTracer with the settings "detailed",
             and LABEL=FOLDER for the files of another method
    Raise InputError for any other value, and if there is no variant.
    """
    if presets is None and counts is None and not axes:
        presets = ("draft", "balanced", "high")
    lists = {"quality": sequence("variants", presets), "gaussians": sequence("counts", counts)}
    grids = [{name: values} for name, values in lists.items() if values]
    others, absent = peer_variants(peers, 1)
    for variant in others:
        if Path(variant.files).is_file():  # "" is no file
            raise refusal(f"peer {variant.tool}", "a folder", variant.files, "gauss2svg bench")
    variants = [*map(Variant, settings_of(*grids, axes or {})), *others]
    if not variants:
        got = f"only peers that are not installed: {', '.join(absent)}" if absent else "none"
        raise InputError(f"variants must be at least one preset, count, axis or peer; got {got}")
    return variants, absent


# Options that can be an axis: all options of four groups, and also `renderer` and `max_size`. Each
# option gets the name by which error messages call it, such as "axis gaussians".
AXES: dict[str, Field] = {
    field.name: replace(field, name=f"axis {field.name}")
    for key, group in GROUPS.items()
    for field in fields_of(group)
    if key in ("goal", "fit", "svg") or field.name in ("renderer", "max_size")
}


# Settings of the benchmark if no axis is given: first the presets, and then some numbers of
# Gaussians and of iterations with the default preset. On two cores, these runs take about a minute
# for a photo of half a megapixel.
GRIDS: tuple[dict[str, tuple[Any, ...]], ...] = (
    {"quality": tuple(PRESETS)},
    {"gaussians": (500, 2000, 8000), "iterations": (100, 300)},
)


def parse_axes(texts: Iterable[str]) -> dict[str, tuple[Any, ...]]:
    """Return the values of each axis, from texts such as NAME or NAME=v1,v2 of a command line.

    If a value contains commas, such as a list of inks, semicolons must separate it from other
    values. If several texts name the same axis, the axis has the values of all of them. Raise
    InputError for an unknown axis or an invalid value.
    """
    axes: dict[str, tuple[Any, ...]] = {}
    # Other values of these two options need programs that may not be installed, such as a browser.
    usual = {"form": ("gradient",), "renderer": ("resvg", "cairo")}
    for text in texts:
        name, equals_sign, listed = text.partition("=")
        axis = _axis(name := name.strip().replace("-", "_"))
        values = _parsed(axis, listed) if equals_sign else usual.get(name, axis.choices)
        axes[name] = axes.get(name, ()) + values
    return axes


def _parsed(axis: Field, text: str) -> tuple[Any, ...]:
    try:
        return (axis.parsed(text.strip()),)
    except InputError:  # the text is not a single valid value, so it is taken as a list
        values = text.split(";" if ";" in text else ",")
        return tuple(axis.parsed(value.strip()) for value in values)


def settings_of(*grids: Mapping[str, Sequence[Any]]) -> list[Settings]:
    """Return every combination of the values of the axes of each grid, each once.

    An empty grid has no combination. Raise InputError for an unknown axis, an axis without values,
    an invalid value, and options that exclude each other.
    """
    combinations: dict[Settings, None] = {}  # used as an ordered set
    for grid in filter(None, grids):
        columns = []
        for name, values in grid.items():
            axis = _axis(name := name.replace("-", "_"))
            columns.append([(name, axis.checked(value)) for value in sequence(axis.name, values)])
            if not columns[-1]:
                raise refusal(axis.name, "given with values", "none", f"--axis {name}=VALUE,VALUE")
        combinations |= {tuple(sorted(pairs)): None for pairs in itertools.product(*columns)}
    for settings in combinations:
        try:
            Plan(Options.from_flat(dict(settings)))
        except Gauss2SvgError as error:
            raise InputError(f"axes: {error}") from error
    return list(combinations)


def sequence(name: str, values: Any) -> list[Any]:
    """Return the values of an argument as a list. Raise InputError for text and other objects."""
    if isinstance(values, (str, bytes)) or not isinstance(values, Iterable | None):
        raise refusal(name, "a sequence", quoted(values), f"[{quoted(values)}]")
    return [] if values is None else list(values)


def _axis(name: str) -> Field:
    """Return the Field of an option. Raise InputError for any other name."""
    return AXES[Field("axis", words=tuple(AXES)).checked(name)]
