"""A process that makes what it is told: `python -m gauss2svg.gallery.worker`.

Work comes as lines of JSON on standard input; to each a line of JSON is the answer on standard
output: {"record": ..} or {"error": one line}, and "fatal" where no other work can succeed. It ends
with its input, at SIGTERM, and when the process that started it is gone.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from typing import Any

from gauss2svg.bench.rows import one_line
from gauss2svg.errors import Gauss2SvgError, OutputError
from gauss2svg.gallery.work import make_photo, make_variant

_LOOK_S = 1.0
_MAKERS = {"photo": make_photo, "variant": make_variant}


def answer_to(work: dict[str, Any]) -> dict[str, Any]:
    """The record of what was made, or why it could not be: no photo stops the others."""
    try:
        return {"record": _MAKERS[work["kind"]](work)}
    except OutputError as error:  # for the others as well: a full disk, a folder that is gone
        return {"error": one_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": one_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}); try a smaller --photo-size"}
    except Exception as error:  # told on the page with its type: a fault of ours
        return {"error": one_line(f"{type(error).__name__}: {error}")}


def main() -> None:
    """Answer every line until there are no more."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a library prints is no answer
    for line in sys.stdin:
        answers.write(json.dumps(answer_to(json.loads(line)), allow_nan=False) + "\n")
        answers.flush()


def _end_with_parent(parent: int) -> None:
    """End this process, and a peer that it runs, once its parent is another: nobody waits."""
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os.kill(os.getpid(), signal.SIGTERM)  # which the main thread takes as it takes the crew's


if __name__ == "__main__":
    main()
