"""More must not be worse: the PSNR of files over rising limits, targets, counts and presets.

    python benchmarks/fronts.py [PHOTOS...] [--families seconds,bytes,...] [--only NAME,...]
        [--scales 1,0.5] [--workers 2] [--tree FOLDER] [--keep FOLDER] [--json FILE]

The pictures are ten drawings, of drawings.py and drawn_pictures.py, coffee and chelsea of
scikit-image, and PHOTOS, each at every scale. With the families "limits" and "gzipped" they are
PHOTOS alone, of which SVGs are drawings: they are rasterised at 256 px and fitted, and the file is
compared with its source at four times that size as well. Every run is the command in a process of
its own, of one thread where there are several workers, so that seconds are those that a user waits.
`--tree` names another checkout to measure, and `--keep` a folder whose finished runs are not run
again. The script prints a Markdown row for each picture and family: the score of the rasterised SVG
for each setting (dB, or SSIMULACRA2) and, for bytes, the share of the limit that is used; and at
the end of each family the number of steps down by more than .1, and of those up to 50 dB. A
drawing's step is down if the file is more than .1 dB worse at its own size and under 41 dB, or
over that more than .3 dB worse enlarged. For seconds the script also runs a grid of presets and
counts, and prints how far each limit is under the best of the grid in as many seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import numpy as np
from drawings import drawings
from drawn_pictures import flat_faces
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from gauss2svg.measure.check import check
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize

_BYTES = (500, 1000, 2000, 5000, 10_000, 20_000, 20_001, 30_000, 50_000, 60_000, 100_000, 200_000)
_COUNTS = (256, 512, 1000, 2000, 4000, 8000)
_PRESETS = ("draft", "fast", "balanced", "high", "max")
FAMILIES: dict[str, list[list[str]]] = {
    "presets": [["--quality", name] for name in _PRESETS],
    "counts": [["--gaussians", str(count)] for count in _COUNTS],
    "seconds": [["--time-limit", str(limit)] for limit in (1, 2, 4, 8, 16, 32)],
    "bytes": [["--max-bytes", str(size)] for size in _BYTES],
    "minimal": [["--max-bytes", str(size), "--markup", "minimal"] for size in _BYTES],
    "editable": [["--max-bytes", str(size), "--markup", "editable"] for size in _BYTES],
    "limits": [["--max-bytes", f"{kb}k"] for kb in (3, 6, 9, 12, 16, 20, 25, 29, 31, 40, 50, 80)],
    "gzipped": [["--max-bytes", f"{kb}k", "--count-gzipped"] for kb in (1, 2, 4, 6, 10, 20)],
    "psnr": [["--target-psnr", str(target)] for target in range(20, 44, 4)],
    "ssimulacra2": [["--target-ssimulacra2", str(target)] for target in (10, 30, 50, 70, 80)],
    "grid": [["--quality", name] for name in _PRESETS]
    + [["--quality", "fast", "--gaussians", str(n)] for n in (1000, 4000, 16_000, 32_000)]
    + [["--quality", "balanced", "--gaussians", str(n)] for n in (4000, 16_000, 50_000)],
}
STEP, DECIDED_BY_8_BITS = 0.1, 50.0  # the step down that counts; dB (docs/decisions/monotone.md)
ENLARGED_STEP, SEEN_UP_TO = 0.3, 41.0  # dB, of drawings (docs/decisions/enlarged.md)
SIDE, UP = 256, 4  # px of a drawing, and times as many of its enlarged raster
LIMITS = ("limits", "gzipped")


@dataclass(frozen=True)
class Run:
    """One command: its score, the share of a limit of bytes, and the seconds it took."""

    picture: str
    family: str
    setting: str
    score: float
    used: float | None
    seconds: float
    cpu: float
    gaussians: int
    stop_reason: str
    kilobytes: float = np.nan
    enlarged: float = np.nan  # dB at four times the size


def pictures(photos: list[Path]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Name and picture (h, w, 3)."""
    drawn = [*drawings(), *flat_faces()]
    for name, pixels in [one for one in drawn if one[0] not in ("coins", "text")]:
        yield name, np.round(255 * pixels).astype(np.uint8)
    for name in ("coffee", "chelsea"):
        yield name, getattr(data, name)()
    for path in photos:
        yield path.stem, np.asarray(Image.open(path).convert("RGB"))


def sources(paths: list[Path], folder: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Yield name and picture (h, w, 3) of photos and SVGs, and copy the SVGs to the folder."""
    for path in paths:
        if path.suffix != ".svg":
            yield path.stem, np.asarray(Image.open(path).convert("RGB"))
            continue
        text = path.read_text()
        (folder / path.name).write_text(text)
        yield path.stem, np.round(255 * rasterize(text, SIDE, SIDE)).astype(np.uint8)


def run(tree: Path, threads: int, folder: Path, name: str, family: str, given: list[str]) -> Run:
    """Run the command on a picture of the folder; refused settings score not a number."""
    stem = folder / f"{name}-{family}-{'-'.join(given)}"
    kept = Path(f"{stem}.run.json")
    if kept.exists():
        return Run(**json.loads(kept.read_text()))
    done = _run(tree, threads, folder, name, family, given, stem)
    kept.write_text(json.dumps(vars(done)))
    return done


def _run(
    tree: Path, threads: int, folder: Path, name: str, family: str, given: list[str], stem: Path
) -> Run:
    report = Path(f"{stem}.json")
    command = [sys.executable, "-m", "gauss2svg", str(folder / f"{name}.png"), "-o", f"{stem}.svg"]
    command += [*given, "--report", str(report), "--quiet", "--overwrite"]
    command += [] if family in LIMITS else ["--tune", "psnr"]
    command += ["--threads", str(threads)] if threads else []
    begun = time.perf_counter()
    with open(f"{stem}.txt", "w+") as errors:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=os.environ | {"PYTHONPATH": str(tree)},
            stderr=errors,
            stdout=errors,
        )
        _, ended, used = os.wait4(process.pid, 0)
        process.returncode = status = os.waitstatus_to_exitcode(ended)
        errors.seek(0)
        said = errors.read()
    seconds, setting = time.perf_counter() - begun, " ".join(given)
    cpu = used.ru_utime + used.ru_stime
    if status == 2:  # such as a file that does not fit into its bytes
        return Run(name, family, setting, np.nan, None, seconds, cpu, 0, "refused")
    if status:
        raise SystemExit(f"{' '.join(command)}: {said}")
    found = json.loads(report.read_text())
    score = found["ssimulacra2_svg"] if family == "ssimulacra2" else found["psnr_svg"]
    if any("measured at" in note for note in found["notes"]):
        score = check(folder / f"{name}.png", Path(f"{stem}.svg")).psnr
    limit, enlarged = found["max_bytes"], np.nan
    size = found["svgz_bytes" if family == "gzipped" else "svg_bytes"]
    if (source := folder / f"{name}.svg").exists():
        truth, svg = source.read_text(), Path(f"{stem}.svg").read_text()
        enlarged = psnr(*(rasterize(text, UP * SIDE, UP * SIDE) for text in (svg, truth)))
    return Run(
        name, family, setting, np.inf if score is None else score,
        None if limit is None else size / limit, seconds, cpu, found["gaussians"],
        found["stop_reason"], size / 1000, enlarged,
    )  # fmt: skip


def steps_down(scores: list[float], most: float = np.inf) -> list[float]:
    """How far each setting is under the best of the cheaper ones, up to `most`."""
    known = np.minimum([score for score in scores if not np.isnan(score)], most)
    return [max(0.0, max(known[: k + 1]) - after) for k, after in enumerate(known[1:])]


def drawing_steps_down(runs: list[Run]) -> list[float]:
    """Return how far each file is under the best smaller one, in dB beyond what is tolerated.

    Under 41 dB files are compared at their own size, and from there on enlarged.
    """
    steps = []
    for k, after in enumerate(runs[1:], 1):
        best = max(min(r.score, SEEN_UP_TO) for r in runs[:k])
        down = best - min(after.score, SEEN_UP_TO) - STEP
        if after.score >= SEEN_UP_TO:
            good = [r.enlarged for r in runs[:k] if r.score >= SEEN_UP_TO]
            down = max(down, max(good, default=-np.inf) - after.enlarged - ENLARGED_STEP)
        steps.append(max(down, 0.0))
    return steps


def row(runs: list[Run]) -> str:
    """The Markdown row of a picture and family."""
    if runs[0].family in LIMITS:
        cells = [
            f"{r.score:.2f}" + ("" if np.isnan(r.enlarged) else f", {r.enlarged:.2f}")
            + f" ({r.kilobytes:.1f} kB, {r.cpu:.0f} s)"
            for r in runs
        ]  # fmt: skip
        return f"| {runs[0].picture} | {runs[0].family} | {' | '.join(cells)} |"
    cells = [
        "-" if np.isnan(r.score) else f"{r.score:.2f}" + (f" ({r.used:.1%})" if r.used else "")
        for r in runs
    ]
    if runs[0].family in ("seconds", "grid"):
        cells = [f"{cell} ({r.seconds:.1f} s)" for cell, r in zip(cells, runs, strict=True)]
    return f"| {runs[0].picture} | {runs[0].family} | {' | '.join(cells)} |"


def summary(family: str, found: list[list[Run]]) -> str:
    """How often more is worse."""
    if family in LIMITS:
        return limits_summary(family, found)
    parts = []
    for most in (np.inf, DECIDED_BY_8_BITS):
        steps = [s for runs in found for s in steps_down([r.score for r in runs], most)]
        count = sum(step > STEP for step in steps)
        parts.append(f"{count} of {len(steps)} steps down over {STEP} (most {max(steps):.2f})")
    used = [r.used for runs in found for r in runs if r.used and r.stop_reason == "max_bytes"]
    share = f"; {min(used):.1%} used at least, {fmean(used):.1%} on average" if used else ""
    return f"{family}: {parts[0]}; up to {DECIDED_BY_8_BITS:g} dB {parts[1]}{share}"


def limits_summary(family: str, found: list[list[Run]]) -> str:
    """Return the means of drawings and photos over each limit, and their steps down."""
    lines = []
    for what, is_drawing in (("drawings", True), ("photos", False)):
        chosen = [runs for runs in found if np.isnan(runs[0].enlarged) != is_drawing]
        if not chosen:
            continue
        lines.append(f"{family}: mean of {len(chosen)} {what}: dB, dB enlarged, kB, CPU s")
        for column in zip(*chosen, strict=True):
            cells = [fmean(getattr(r, name) for r in column)
                     for name in ("score", "enlarged", "kilobytes", "cpu")]  # fmt: skip
            texts = " | ".join(f"{cell:.2f}" for cell in cells)
            lines.append(f"| {column[0].setting} | {texts} |")
        if is_drawing:
            steps = [step for runs in chosen for step in drawing_steps_down(runs)]
            count = sum(step > 0 for step in steps)
        else:
            steps = [step for runs in chosen for step in steps_down([r.score for r in runs])]
            count = sum(step > STEP for step in steps)
        lines.append(f"{count} of {len(steps)} steps down (most {max(steps):.2f} dB)")
    return "\n".join(lines)


def behind(limits: list[Run], grid: list[Run]) -> list[float]:
    """How far each limit of seconds is under the best of the grid in no more seconds, in dB.

    Seconds of a process are those of its CPU where it ran on one core beside other work.
    """
    lost = []
    for limited in limits:
        allowed = float(limited.setting.split()[-1])
        best = max((r.score for r in grid if min(r.seconds, r.cpu) <= allowed), default=-np.inf)
        lost.append(min(best, DECIDED_BY_8_BITS) - min(limited.score, DECIDED_BY_8_BITS))
    return [float(max(gap, 0.0)) for gap in lost if np.isfinite(gap)]


def better_of_both(auto: list[Run], one: list[Run], other: list[Run]) -> list[float]:
    """How far auto is under the better markup, in dB, for each limit."""
    rows = zip(auto, one, other, strict=True)
    gaps = [np.nanmax([a.score, b.score]) - x.score for x, a, b in rows if not np.isnan(x.score)]
    return [float(max(gap, 0.0)) for gap in gaps if np.isfinite(gap)]


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("photos", nargs="*", type=Path)
    parser.add_argument("--families", default=",".join(FAMILIES))
    parser.add_argument("--only")
    parser.add_argument("--scales", default="1")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--tree", type=Path, default=Path(__file__).resolve().parents[1])
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    only = arguments.only and arguments.only.split(",")
    found: dict[str, list[list[Run]]] = {name: [] for name in arguments.families.split(",")}
    with (
        tempfile.TemporaryDirectory() as name,
        ThreadPoolExecutor(arguments.workers) as pool,
    ):
        folder, chosen = arguments.keep or Path(name), []
        folder.mkdir(parents=True, exist_ok=True)
        given = pictures(arguments.photos)
        if found.keys() <= set(LIMITS):
            given = sources(arguments.photos, folder)
        for title, pixels in given:
            for scale in map(float, arguments.scales.split(",")):
                if only and title not in only:
                    continue
                picture = Image.fromarray(pixels)
                size = (round(picture.width * scale), round(picture.height * scale))
                label = title.replace(" ", "-") + ("" if scale == 1 else f"-{scale:g}")
                if scale != 1:
                    picture = picture.resize(size, Image.Resampling.BOX)
                picture.save(folder / f"{label}.png")
                chosen.append(label)
        threads = 1 if arguments.workers > 1 else 0
        ordered = {
            (family, label): [
                pool.submit(run, arguments.tree, threads, folder, label, family, given)
                for given in FAMILIES[family]
            ]
            for label in chosen
            for family in found
        }
        for (family, _), runs in ordered.items():
            found[family].append([one.result() for one in runs])
            print(row(found[family][-1]), flush=True)
            if arguments.json:
                lines = [vars(r) for results in found.values() for runs in results for r in runs]
                arguments.json.write_text(json.dumps(lines, indent=1))
        for family, results in found.items():
            print(summary(family, results), flush=True)
    if {"seconds", "grid"} <= found.keys():
        pairs = zip(found["seconds"], found["grid"], strict=True)
        lost = [gap for limits, grid in pairs for gap in behind(limits, grid)]
        print(f"behind the best of the grid: {max(lost):.2f} dB at most, {fmean(lost):.2f} mean")
    if {"bytes", "minimal", "editable"} <= found.keys():
        rows = zip(*(found[name] for name in ("bytes", "minimal", "editable")), strict=True)
        lost = [gap for three in rows for gap in better_of_both(*three)]
        print(f"auto under the better markup: {max(lost):.2f} dB at most, {fmean(lost):.3f} mean")


if __name__ == "__main__":
    main()
