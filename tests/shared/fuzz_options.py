"""Laws of options: `python tests/shared/fuzz_options.py --count 5000`; test_fuzz_options is short.

Random combinations of options, drawn from the option classes, for the Python call and, as words,
for the commands. Each gives a result or one refusal: in Python a Gauss2SvgError of one line, as a
command status 2 and one line on standard error. A refusal changes no file, a result's report is
JSON, and no other file than those asked for appears. Anything else is a finding. A combination
follows from the seed and its number, and only stops that fits may have are set beside it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
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
from gauss2svg.cli.main import main as command
from gauss2svg.cli.signals import Interruption
from gauss2svg.cli.vectorize import MakerFiles, OutputFiles
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.measure import CheckOptions
from gauss2svg.options import Field, byte_size, fields_of
from gauss2svg.pipeline.options import GROUPS, Goal

PIXELS = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
LONGEST_S = 0.2  # of a fit, which is stopped then
_QUICK = {"quality": "draft", "gaussians": 4, "iterations": 3, "max_memory": "400M"}
_SLOW = ("chromium", "firefox", "inkscape")  # start programs that take seconds
_SVG = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'
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


def odd_callables() -> list[Any]:
    """What cannot be called, or not as `progress` and `stop` are."""
    uncallable = [value for value in odd_values() if not callable(value)]
    return uncallable + 9 * [lambda a, b: None, lambda *, a: None, Goal, object]


def valid_values(field: Field) -> list[Any]:
    """Values that an option takes, and both sides of the ends of its range."""
    found: list[Any] = [one for one in (*field.choices, *field.words) if one not in _SLOW]
    if field.kind in (int, float):
        for end in (field.least, field.most):
            beside = [math.nextafter(end, -math.inf), math.nextafter(end, math.inf)]
            found += [end, end - 1, end + 1] if field.kind is int else [end, *beside]
        found += [max(field.least, 1), min(field.most, 30)]
        found += [np.int64(max(field.least, 1)), np.float32(max(field.least, 1))]
    elif field.words:
        found += [np.array(one)[()] for one in found]
    elif field.check is byte_size:
        found += [300_000_000, "300M", "1k", "1.5 kB", "0.1", "1e9", 1, 0, "9" * 30 + "G"]
    elif field.check is not None:  # each of them has its own words
        found += ["white", "#fa0", "#ffaa00", "photo", "120mm", "5in", "1e9mm", "0px", "none"]
        found += ["xMidYMid slice", "xMidYMid", "A title", "30", 30, 10_000, 10_001]
    return found


def drawn(rng: Random, field: Field) -> Any:
    """A value for an option, more often than not a valid one."""
    return rng.choice(valid_values(field) if rng.random() < 0.7 else odd_values())


class Stop:
    """Ends a fit after a while."""

    def __init__(self) -> None:
        self.last = time.monotonic() + LONGEST_S

    def __call__(self, *_: Any) -> bool:
        return time.monotonic() > self.last


def _shown(values: Any) -> str:
    """Repr of arguments, whatever these do."""
    if isinstance(values, dict):
        return ", ".join(f"{name}={_shown(value)}" for name, value in values.items())
    try:
        text = repr(values)
    except Exception:  # some arguments are objects whose own methods fail
        text = type(values).__name__
    return (text if len(text) < 100 else text[:100] + "...").encode("unicode_escape").decode()


class Case:
    """A combination: what is called, in the folder that it runs in; `said` are its arguments."""

    def __init__(self, seed: int, number: int, folder: Path) -> None:
        self._rng, self._folder = Random(f"options {seed} {number}"), folder
        self.said = ""
        self._reads_photo = True

    def run(self) -> str:
        """The kind of outcome; AssertionError for a broken law, or what should not be raised."""
        Image.fromarray(PIXELS).save("photo.png")
        Path("other.svg").write_text(_SVG)
        before = _files(self._folder)
        kind = self._rng.choice([self._python, self._python, self._command, self._command])
        outcome = kind()
        for name, data in before.items():
            if outcome.startswith("refused") or (self._reads_photo and name == "photo.png"):
                assert _files(self._folder).get(name) == data, f"{name} has changed"
        if outcome.startswith("refused"):
            left = set(_files(self._folder)) - set(before)
            assert not left, f"a refusal left {sorted(left)}"
        return outcome

    def _python(self) -> str:
        rng, given = self._rng, {key: {} for key in GROUPS}
        if rng.random() < 0.1:
            return rng.choice([self._check, self._gallery_options])()
        for key, group in GROUPS.items():
            for field in fields_of(group):
                if field.name in _QUICK:
                    given[key][field.name] = _QUICK[field.name]
        fields = [(key, field) for key, group in GROUPS.items() for field in fields_of(group)]
        for key, field in rng.sample(fields, rng.randint(0, 4)):
            given[key][field.name] = drawn(rng, field)
        others: dict[str, Any] = {"stop": Stop()}
        if rng.random() < 0.1:
            name = rng.choice(["progress", "stop", *GROUPS])
            others[name] = rng.choice(odd_values() if name in GROUPS else odd_callables())
        photo = rng.choice([PIXELS, "photo.png", Path("photo.png")])
        if rng.random() < 0.03:
            photo = rng.choice(odd_values())
        self._reads_photo = isinstance(photo, (str, Path))
        path = rng.choice(odd_values()) if rng.random() < 0.5 else "out.svg"
        if isinstance(path, (str, Path)) and str(path) == "photo.png":  # replaced where asked for
            path = "out.svg"
        self.said = (
            f"vectorize({_shown(photo)}, {_shown(given)}, {_shown(others)}).save({_shown(path)})"
        )
        try:
            goal = given.pop("goal")
            groups = {key: GROUPS[key](**values) for key, values in given.items()}
            result = gauss2svg.vectorize(photo, **{"goal": None, **goal, **groups, **others})
        except Gauss2SvgError as error:
            return _refused(error)
        json.dumps(result.report, allow_nan=False)
        before = _files(self._folder)
        try:
            result.save(path)
        except Gauss2SvgError as error:
            assert _files(self._folder) == before, "a refused name of save has changed files"
            return "result, save " + _refused(error)
        return "result"

    def _check(self) -> str:
        rng = self._rng
        given = {f.name: drawn(rng, f) for f in rng.sample(fields_of(CheckOptions), 2)}
        sources: list[Any] = [PIXELS, _SVG]
        if rng.random() < 0.3:
            sources[rng.randrange(2)] = rng.choice(odd_values())
        self._reads_photo = True
        self.said = f"check({_shown(sources)}, {_shown(given)})"
        try:
            json.dumps(gauss2svg.check(*sources, **given).report, allow_nan=False)
        except Gauss2SvgError as error:
            return _refused(error)
        return "result of check"

    def _gallery_options(self) -> str:
        fields = self._rng.sample(fields_of(GalleryOptions), 2)
        given = {field.name: drawn(self._rng, field) for field in fields}
        self.said = f"GalleryOptions({_shown(given)})"
        try:
            GalleryOptions(**given)
        except Gauss2SvgError as error:
            return _refused(error)
        return "result"

    def _command(self) -> str:
        rng = self._rng
        which = rng.choice(["vectorize"] * 8 + ["check", "gallery"])
        if which == "vectorize":
            words = ["photo.png", *(["-o", "out.svg"] if rng.random() < 0.7 else [])]
            words += [f"--{name.replace('_', '-')}={value}" for name, value in _QUICK.items()]
            groups = [*GROUPS.values(), OutputFiles, MakerFiles]
        elif which == "check":
            words, groups = ["check", "photo.png", "other.svg"], [CheckOptions, CheckOutput]
        else:  # into a file, which is refused once all options are read
            words, groups = ["gallery", "photo.png", "-o", "photo.png"], [GalleryOptions]
        fields = [field for group in groups for field in fields_of(group)]
        for field in rng.sample(fields, rng.randint(0, 4)):
            words += self._words_of(field)
        if which != "gallery" and rng.random() < 0.1:
            words.insert(rng.randint(0, len(words)), rng.choice(_texts()))
        if which != "gallery" and rng.random() < 0.1:
            words.pop(rng.randrange(len(words)))
        # A process can be given neither.
        words = [word.replace("\0", "").replace("\ud800", "") for word in words]
        self.said = f"main({words})"
        stop = Stop()
        out, err = io.TextIOWrapper(io.BytesIO()), io.StringIO()
        with (
            mock.patch.object(Interruption, "asked", stop),
            mock.patch("sys.stdin", io.TextIOWrapper(io.BytesIO())),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            status = command(words)
        lines = err.getvalue().splitlines()
        missed = which == "check" and status == 1 and "below --min-psnr" in lines[-1]
        assert status in (0, 2) or missed, f"status {status}: {lines}"
        if status == 2:
            assert len(lines) == 1, f"{len(lines)} lines: {lines[:3]}"
            return "refused by the command"
        return "done by the command"

    def _words_of(self, field: Field) -> list[str]:
        name, rng = f"--{field.name.replace('_', '-')}", self._rng
        if field.kind is bool:
            no = name.replace("--", "--no-", 1)
            return [rng.choice([name, name, no, f"{name}=", f"{name}=maybe", f"{name}=false"])]
        valid = [str(value) for value in valid_values(field)]
        value = rng.choice(valid if valid and rng.random() < 0.7 else _texts())
        return [name, value] if rng.random() < 0.5 else [f"{name}={value}"]


def _texts() -> list[str]:
    """Words of a command line that few options take."""
    return [value for value in odd_values() if isinstance(value, str)] + [
        "--", "-o", "--help", "--version", "--no-such-option", "-x", "--quiet", "+5", "0x10",
        "1e400", "[1,2]", '{"a": 1}', "--fit.seed=1", "--preview", "out.svg", "out.png", "out.svgz",
        "a.tar.gz", "/", "./", "~", "*", "%s", "{}", "null", "photo.png", "fit", "check", "\udcff",
    ]  # fmt: skip


def _refused(error: Gauss2SvgError) -> str:
    return f"refused by {type(error).__name__}"


def _files(folder: Path) -> dict[str, bytes]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {os.fspath(path.relative_to(folder)): path.read_bytes() for path in paths}


def outcome_of(seed: int, number: int) -> tuple[str, str]:
    """Kind of the outcome of a combination, beginning with FINDING for one, and the arguments."""
    folder, before = Path(tempfile.mkdtemp()), Path.cwd()
    os.chdir(folder)
    case = Case(seed, number, folder)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", module="gauss2svg")
            return case.run(), case.said
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        frames = traceback.extract_tb(error.__traceback__)
        ours = [f for f in frames if "gauss2svg" in Path(f.filename).parts] or frames
        where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}"
        kind = f"FINDING {type(error).__name__} at {where}"
        return kind, f"{case.said}\n    {_shown(str(error))}"
    finally:
        os.chdir(before)
        shutil.rmtree(folder)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    kinds: Counter[str] = Counter()
    for number in range(given.first, given.first + given.count):
        kind, said = outcome_of(given.seed, number)
        kinds[kind] += 1
        if kind.startswith("FINDING") and kinds[kind] <= 3:
            again = f"--seed {given.seed} --first {number} --count 1"
            print(f"{kind}\n    {said}\n    python {__file__} {again}", flush=True)
    for kind, count in kinds.most_common():
        print(f"{count:7d}  {kind}")
    return 1 if any(kind.startswith("FINDING") for kind in kinds) else 0


if __name__ == "__main__":
    sys.exit(main())
