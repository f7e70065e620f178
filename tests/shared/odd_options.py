"""Random combinations of options, for the Python calls and, as words, for the commands."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import time
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np
from PIL import Image

import gauss2svg
from gauss2svg.cli.check import CheckOutput
from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import Interruption
from gauss2svg.cli.vectorize import MakerFiles, OutputFiles
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Field, byte_size, fields_of
from gauss2svg.pipeline.options import GROUPS, Goal

PIXELS = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
_LONGEST_S = 0.2  # seconds of a fit, which is stopped then
_QUICK = {"quality": "draft", "gaussians": 4, "iterations": 3, "max_memory": "400M"}
_SLOW = ("chromium", "firefox", "inkscape")  # renderers that start programs for seconds
_FILES = ("fit", "new/fit", ".", "", "fit\0", "fit\ud800", "/dev/null", "photo.png", "other.svg")


class Rude:
    """Raises wherever it is asked for a number, a path or a truth."""

    def _raise(self, *_: Any) -> Any:
        raise RuntimeError("rude")

    __eq__ = __hash__ = __bool__ = __len__ = __iter__ = _raise  # type: ignore
    __index__ = __float__ = __int__ = __fspath__ = item = _raise


class Pathless(os.PathLike):
    """A path that is not one."""

    def __fspath__(self) -> Any:
        return 5


class Named:
    """Its repr has several lines, and no end."""

    def __repr__(self) -> str:
        return "a\nb\x1b[31m" * 1000


def odd_values() -> list[Any]:
    """Values that most options refuse, and some that they take."""
    return [
        None, True, False, 0, 1, -1, 5, 2**31, 2**63 - 1, 2**63, 2**64, 10**400, -(10**400),
        0.0, -0.0, 0.5, 1e-320, 1e308, math.inf, -math.inf, math.nan, 1j,
        "", " ", "5", "30", " 5", "0.5", "1e3", "1_0", "\u0663", "\u00b2", "auto", "None", "nan",
        "True", "a\nb", "\0", "\ud800", "x" * 5000, "9" * 5000, "-", "--gzip", "<svg/>",
        b"", b"5", b"fit", b"\xff", bytearray(b"5"), memoryview(b"5"),
        [], [5], [[]], (), (5,), {}, {"a": 1}, {5}, range(3), iter([5]), slice(1),
        Decimal("0.5"), Decimal("5"), Decimal("NaN"), Decimal("sNaN"), Decimal("1e999999"),
        Fraction(1, 2), Fraction(10**400), object(), type, len, print, Rude(), Pathless(), Named(),
        np.int8(5), np.uint64(2**64 - 1), np.float16(0.5), np.float32("nan"), np.float64(1e300),
        np.longdouble("1e4000"), np.bool_(True), np.str_("over"), np.str_("5"), np.bytes_(b"5"),
        np.array(5), np.array(0.5), np.array([5]), np.array([0.5]), np.array([]), np.zeros((3, 0)),
        np.zeros((16, 16)), np.zeros((16, 16), np.uint8), np.zeros((16, 16), bool),
        np.full((16, 16), -1), np.array(["a"]), np.array("over"), np.array(None), np.array(Rude()),
        np.datetime64("2020"), np.ma.masked, np.ma.masked_array([5], [True]), np.void(b"5"),
        Path("fit"), Path(), *(Path(name) for name in _FILES), *_FILES,
    ]  # fmt: skip


def _valid_values(field: Field) -> list[Any]:
    """Return values that an option takes, and both sides of the ends of its range."""
    found: list[Any] = [one for one in (*field.choices, *field.words) if one not in _SLOW]
    if field.kind in (int, float):
        for end in (field.least, field.most):
            beside = [math.nextafter(end, -math.inf), math.nextafter(end, math.inf)]
            found += [end, end - 1, end + 1] if field.kind is int else [end, *beside]
        found += [max(field.least, 1), np.int64(max(field.least, 1)), min(field.most, 30)]
    elif field.check is byte_size:
        found += [300_000_000, "300M", "1k", "1.5 kB", "0.1", "1e9", 1, 0, "9" * 30 + "G"]
    elif field.check is not None and not field.words:  # each of them has its own words
        found += ["white", "#fa0", "#ffaa00", "photo", "120mm", "5in", "1e9mm", "0px", "none"]
        found += ["xMidYMid slice", "xMidYMid", "A title", "30", 30, 10_000, 10_001]
    return found


def _drawn(rng: Random, fields: list[Field], count: int) -> dict[str, Any]:
    """Return values for some options, more often valid ones than not."""
    return {
        field.name: rng.choice((rng.random() < 0.7 and _valid_values(field)) or odd_values())
        for field in rng.sample(fields, count)
    }


def _never_long() -> Any:
    """Return a `stop` that ends a fit after a while."""
    last = time.monotonic() + _LONGEST_S
    return lambda *_: time.monotonic() > last


def _python(rng: Random) -> str:
    fields = [field for group in GROUPS.values() for field in fields_of(group)]
    given = _QUICK | _drawn(rng, fields, rng.randint(0, 4))
    groups = {
        key: {f.name: given[f.name] for f in fields_of(group) if f.name in given}
        for key, group in GROUPS.items()
    }
    others: dict[str, Any] = {"stop": _never_long()}
    if rng.random() < 0.1:
        uncallable = [value for value in odd_values() if not callable(value)]
        others = {rng.choice(["progress", "stop"]): rng.choice([*uncallable, Goal, object])}
    photo = rng.choice([PIXELS, "photo.png", Path("photo.png")])
    if rng.random() < 0.03:
        photo = rng.choice(odd_values())
    path = rng.choice(odd_values()) if rng.random() < 0.5 else "out.svg"
    goal = groups.pop("goal")
    made = {key: GROUPS[key](**values) for key, values in groups.items()}
    result = gauss2svg.vectorize(photo, **{"goal": None, **goal, **made, **others})
    json.dumps(result.report, allow_nan=False)
    if str(path) != "photo.png":  # which would be replaced, as asked for
        before = _files()
        with contextlib.suppress(Gauss2SvgError):
            result.save(path)
            return "result"
        assert _files() == before, "a refused name has changed files"
    return "result"


def _check(rng: Random) -> str:
    sources: list[Any] = [PIXELS, SVG]
    if rng.random() < 0.3:
        sources[rng.randrange(2)] = rng.choice(odd_values())
    report = gauss2svg.check(*sources, **_drawn(rng, fields_of(CheckOptions), 2)).report
    json.dumps(report, allow_nan=False)
    return "result of check"


def _gallery_options(rng: Random) -> str:
    GalleryOptions(**_drawn(rng, fields_of(GalleryOptions), 2))
    return "options of a gallery"


def _command(rng: Random) -> str:
    words, groups = rng.choice(
        [
            *[(["photo.png"], [*GROUPS.values(), OutputFiles, MakerFiles])] * 8,
            (["check", "photo.png", "other.svg"], [CheckOptions, CheckOutput]),
            # Into a file, which is refused once all options are read.
            (["gallery", "photo.png", "-o", "photo.png"], [GalleryOptions]),
        ]
    )
    if words == ["photo.png"]:
        quick = [f"--{name.replace('_', '-')}={value}" for name, value in _QUICK.items()]
        words = [*words, *(["-o", "out.svg"] if rng.random() < 0.7 else []), *quick]
    fields = [field for group in groups for field in fields_of(group)]
    for field in rng.sample(fields, rng.randint(0, 4)):
        words = [*words, *_words_of(rng, field)]
    if words[0] != "gallery" and rng.random() < 0.2:
        at = rng.randrange(len(words))
        words[at : at + rng.randrange(2)] = rng.choice([[], [rng.choice(_texts())]])
    # A process can be given neither.
    words = [word.replace("\0", "").replace("\ud800", "") for word in words]
    out, err = io.TextIOWrapper(io.BytesIO()), io.StringIO()
    with (
        mock.patch.object(Interruption, "asked", _never_long()),
        mock.patch("sys.stdin", io.TextIOWrapper(io.BytesIO())),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        status = main(words)
    lines = err.getvalue().splitlines()
    missed = words[0] == "check" and status == 1 and "below --min-psnr" in lines[-1]
    assert status == 0 or missed or (status, len(lines)) == (2, 1), (words, status, lines)
    return "refused by the command" if status == 2 else "done by the command"


def _words_of(rng: Random, field: Field) -> list[str]:
    name = f"--{field.name.replace('_', '-')}"
    if field.kind is bool:
        no = name.replace("--", "--no-", 1)
        return [rng.choice([name, name, no, f"{name}=", f"{name}=maybe", f"{name}=false"])]
    valid = [str(value) for value in _valid_values(field)]
    value = rng.choice(valid if valid and rng.random() < 0.7 else _texts())
    return [name, value] if rng.random() < 0.5 else [f"{name}={value}"]


def _texts() -> list[str]:
    """Return words of a command line that few options take."""
    return [value for value in odd_values() if isinstance(value, str)] + [
        "--", "-o", "--help", "--version", "--no-such-option", "-x", "--quiet", "+5", "0x10",
        "1e400", "[1,2]", '{"a": 1}', "--fit.seed=1", "--preview", "out.svg", "out.png", "out.svgz",
        "a.tar.gz", "/", "./", "~", "*", "%s", "{}", "null", "photo.png", "fit", "check", "\udcff",
    ]  # fmt: skip


def _files() -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path().rglob("*") if path.is_file()}


def outcome(rng: Random) -> str:
    """Return what becomes of a combination in the current folder, which must be empty.

    It is a result, whose report is JSON, or a refusal, which changes no file.
    """
    Image.fromarray(PIXELS).save("photo.png")
    Path("other.svg").write_text(SVG)
    before = _files()
    run = rng.choice([*[_python] * 9, *[_command] * 10, rng.choice([_check, _gallery_options])])
    try:
        said = run(rng)
    except Gauss2SvgError:
        said = "refused"
    if said.startswith("refused"):
        assert _files() == before
    assert _files()["photo.png"] == before["photo.png"]
    return said
