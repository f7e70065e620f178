"""What a worker answers to a request: a record, or why there is none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from gauss2svg.compare.records import one_line
from gauss2svg.errors import Gauss2SvgError, OutputError


def answered(
    make: Callable[[Mapping[str, Any]], dict[str, Any]], request: Mapping[str, Any]
) -> dict[str, Any]:
    """The record, or {"error": one line}, so that a request that fails stops no other.

    With "fatal" where no other request can succeed.
    """
    try:
        return make(request)
    except OutputError as error:  # of the others as well: a full disk, a deleted folder
        return {"error": one_line(str(error)), "fatal": True}
    except Gauss2SvgError as error:
        return {"error": one_line(str(error))}
    except MemoryError as error:
        return {"error": f"out of memory ({error}). Try smaller photos or fewer Gaussians"}
    except Exception as error:  # a peer may raise anything; a bug of ours is shown with its type
        return {"error": one_line(f"{type(error).__name__}: {error}")}
