"""The gradient stops of all files, which gauss2svg/svg/stops.json holds.

    python benchmarks/stops.py gauss2svg/svg/stops.json

Takes half a minute. Rows are a number of stops, an exponent, offsets and opacities.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg.format import STOP_COUNTS
from gauss2svg.svg.stops import FEWEST_STOPS, optimised_stops


def main(path: str) -> None:
    """Write the table."""
    counts = range(FEWEST_STOPS, max(STOP_COUNTS) + 1)
    rows = [[n, beta, *optimised_stops(n, beta)] for n in counts for beta in BETA_CLASSES]
    Path(path).write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n")


if __name__ == "__main__":
    main(sys.argv[1])
