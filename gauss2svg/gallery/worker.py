"""A worker process of a gallery: `python -m gauss2svg.gallery.worker`.

It reads requests as lines of JSON from standard input and answers each with a line of JSON on
standard output: {"record": ..} or {"error": one line}, with "fatal" where no other request can
succeed. It ends at the end of its input, at SIGTERM, and when its parent process is gone.
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
from gauss2svg.gallery.artifacts import make_photo, make_variant

_POLL_S = 1.0
_MAKERS = {"photo": make_photo, "variant": make_variant}


def answer_to(request: dict[str, Any]) -> dict[str, Any]:
    """The record of what was made, or the error, so that a bad photo stops no other."""
    try:
        return {"record": _MAKERS[request["kind"]](request)}
    except OutputError as error:  # of the others as well: a full disk, a deleted folder
        return {"error": one_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": one_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try a smaller --photo-size"}
    except Exception as error:  # a bug of ours: the page shows it with its type
        return {"error": one_line(f"{type(error).__name__}: {error}")}


def main() -> None:
    """Answer all requests."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of libraries goes to standard error
    for line in sys.stdin:
        answers.write(json.dumps(answer_to(json.loads(line)), allow_nan=False) + "\n")
        answers.flush()


def _end_with_parent(parent: int) -> None:
    """End this process, and a peer that it runs, once its parent process has changed."""
    while os.getppid() == parent:
        time.sleep(_POLL_S)
    os.kill(os.getpid(), signal.SIGTERM)  # handled by the main thread


if __name__ == "__main__":
    main()
