"""What a worker of a gallery does with a request."""

from __future__ import annotations

from typing import Any

from gauss2svg.bench.rows import one_line
from gauss2svg.errors import Gauss2SvgError, OutputError
from gauss2svg.gallery.artifacts import make_photo, make_variant
from gauss2svg.photo.stderr import own_standard_error

_MAKERS = {"photo": make_photo, "variant": make_variant}


def answer_to(request: dict[str, Any]) -> dict[str, Any]:
    """{"record": ..} of what was made or {"error": one line}, so that a bad photo stops no other.

    With "fatal" where no other request can succeed.
    """
    try:
        with own_standard_error():
            return {"record": _MAKERS[request["kind"]](request)}
    except OutputError as error:  # of the others as well: a full disk, a deleted folder
        return {"error": one_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": one_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try a smaller --photo-size"}
    except Exception as error:  # a bug of ours: the page shows it with its type
        return {"error": one_line(f"{type(error).__name__}: {error}")}
