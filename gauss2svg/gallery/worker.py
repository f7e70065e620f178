"""A process that makes what it is told: `python -m gauss2svg.gallery.worker`.

Work comes as lines of JSON on standard input; to each a line of JSON is the answer on standard
output: {"record": ..} or {"error": one line}. It ends with its input, and at SIGTERM.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from typing import Any

from gauss2svg.bench.worker import one_line
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.gallery.work import make_photo, make_variant

_MAKERS = {"photo": make_photo, "variant": make_variant}


def answer_to(work: dict[str, Any]) -> dict[str, Any]:
    """The record of what was made, or why it could not be: no photo stops the others."""
    try:
        return {"record": _MAKERS[work["kind"]](work)}
    except Gauss2SvgError as error:
        return {"error": one_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}); try a smaller --photo-size"}
    except Exception as error:  # told on the page with its type: a fault of ours
        return {"error": one_line(f"{type(error).__name__}: {error}")}


def main() -> None:
    """Answer every line until there are no more."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints is no answer
    for line in sys.stdin:
        answers.write(json.dumps(answer_to(json.loads(line)), allow_nan=False) + "\n")
        answers.flush()


if __name__ == "__main__":
    main()
