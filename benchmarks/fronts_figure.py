"""Tables and plots of what benchmarks/fronts.py measured, beside what an earlier version did.

    python benchmarks/fronts_figure.py AFTER.json [BEFORE.json] [--grid GRID.json] [--figure FILE]

For each family: a Markdown table of means over photos and over drawings for each setting, the steps
down of more than .1 and, with a grid of presets and counts, how far limits of seconds are under
the best of it in as many seconds. The plot has a line for each picture, grey before and blue after.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path
from statistics import fmean
from typing import Any

import matplotlib as mpl
import numpy as np
from fronts import DECIDED_BY_8_BITS, STEP, Run, behind, better_of_both, steps_down
from matplotlib.figure import Figure

PHOTOS = ("coffee", "chelsea", "kodim")
_SHOWN = {"seconds": "s", "bytes": "bytes", "psnr": "target, dB", "ssimulacra2": "target"}
_COLORS = {"before": "#9a9a9a", "after": "#1f5fbf"}

# Runs of a picture and a family, in the order of their settings.
Rows = dict[str, dict[str, list[Run]]]


def read(path: Path) -> Rows:
    """Family, picture, runs."""
    found: Rows = defaultdict(lambda: defaultdict(list))
    for line in json.loads(path.read_text()):
        found[line["family"]][line["picture"]].append(Run(**line))
    return found


def is_photo(picture: str) -> bool:
    """Whether a picture is a photo, else it is a drawing."""
    return picture.startswith(PHOTOS)


def shown(run: Run, most: float = DECIDED_BY_8_BITS) -> float:
    """The score, in dB up to what 8 bits can show."""
    return run.score if run.family == "ssimulacra2" else min(run.score, most)


def mean(runs: list[Run]) -> str:
    """Mean score; how many were refused."""
    scores = [shown(run) for run in runs if not np.isnan(run.score)]
    refused = len(runs) - len(scores)
    return (f"{fmean(scores):.2f}" if scores else "-") + (
        f" ({refused} refused)" if refused else ""
    )


def table(name: str, families: dict[str, dict[str, list[Run]]]) -> None:
    """Print the means of a family over photos and drawings, and its steps down."""
    settings = [run.setting.split()[1] for run in next(iter(families["after"].values()))]
    print(f"| {name} | {' | '.join(settings)} | steps down |")
    print("|---" * (len(settings) + 2) + "|")
    for kind in ("photos", "drawings"):
        for when, rows in families.items():
            kept = [
                runs for picture, runs in rows.items() if is_photo(picture) == (kind == "photos")
            ]
            if not kept:
                continue
            cells = [mean(list(column)) for column in zip(*kept, strict=True)]
            down = [step for runs in kept for step in steps_down([shown(run) for run in runs])]
            count = sum(step > STEP for step in down)
            print(
                f"| {len(kept)} {kind}, {when} | {' | '.join(cells)} "
                f"| {count} of {len(down)}, {max(down, default=0):.2f} at most |"
            )
    print()


def plot(found: dict[str, Rows], path: Path) -> None:
    """A panel for each family and kind of picture."""
    names = [name for name in _SHOWN if name in found["after"]]
    mpl.rcParams.update({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False})
    figure = Figure(figsize=(7.2, 2.6 * len(names)), layout="constrained")
    panels: Any = figure.subplots(len(names), 2, squeeze=False)
    for (left, right), name in zip(panels, names, strict=True):
        for axes, kind in ((left, "photos"), (right, "drawings")):
            for when in ("before", "after"):
                for picture, runs in found.get(when, {}).get(name, {}).items():
                    if is_photo(picture) != (kind == "photos"):
                        continue
                    x = [float(run.setting.split()[1]) for run in runs]
                    axes.plot(
                        x, [shown(run, 60.0) for run in runs], color=_COLORS[when], lw=0.7,
                        alpha=0.8, marker=".", ms=2,
                    )  # fmt: skip
            if name in ("seconds", "bytes"):
                axes.set_xscale("log")
            if name == "seconds":
                axes.set_xticks(x := [1, 2, 4, 8, 16, 32], [str(second) for second in x])
                axes.minorticks_off()
            axes.set_xlabel(f"{_SHOWN[name]}, {kind}")
            axes.set_ylabel("SSIMULACRA2" if name == "ssimulacra2" else "dB")
    figure.savefig(path, dpi=100, pil_kwargs={"quality": 50} if path.suffix == ".webp" else {})


def main() -> None:
    """Parse the command line, print the tables, draw the plot."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("after", type=Path)
    parser.add_argument("before", type=Path, nargs="?")
    parser.add_argument("--grid", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    found = {"after": read(given.after)}
    if given.before:
        found = {"before": read(given.before)} | found
    for name in found["after"]:
        families = {when: rows[name] for when, rows in found.items() if name in rows}
        table(name, families)
    grid = read(given.grid)["grid"] if given.grid else found["after"].get("grid", {})
    seconds = found["after"].get("seconds", {})
    for kind in (True, False):
        pairs = [(runs, grid[one]) for one, runs in seconds.items() if one in grid]
        lost = [gap for runs, best in pairs if is_photo(runs[0].picture) == kind
                for gap in behind(runs, best)]  # fmt: skip
        if lost:
            over = sum(gap > 0.4 for gap in lost)
            print(
                f"{'photos' if kind else 'drawings'}: {len(lost)} limits are {fmean(lost):.2f} dB "
                f"under the best of the grid on average, {max(lost):.2f} at most, {over} over .4"
            )
    three = [found["after"].get(name, {}) for name in ("bytes", "minimal", "editable")]
    common = [one for one in three[0] if all(one in rows for rows in three)]
    lost = [gap for one in common for gap in better_of_both(*(rows[one] for rows in three))]
    if lost:
        print(f"auto under the better markup: {max(lost):.2f} dB at most, {fmean(lost):.3f} mean, "
              f"{sum(gap > 0.05 for gap in lost)} of {len(lost)} over .05")  # fmt: skip
    used = [run for runs in three[0].values() for run in runs if run.used]
    for setting in dict.fromkeys(run.setting for run in used):
        shares = [run.used for run in used if run.setting == setting and run.used]
        print(f"{setting}: used {min(shares):.1%} at least, {fmean(shares):.1%} on average")
    if given.figure:
        plot(found, given.figure)


if __name__ == "__main__":
    main()
