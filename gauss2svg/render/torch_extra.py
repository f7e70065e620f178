"""PyTorch, which only some functions need, is an optional dependency."""

import os
from typing import Any

from gauss2svg.errors import InputError

_process: int | None = None  # which was the first to compute with torch


class TorchMissingError(InputError, ImportError):
    """PyTorch is needed and not installed."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} needs PyTorch. Try pip install 'gauss2svg[torch]'")


def require_torch(what: str) -> Any:
    """The module torch, to compute with; raises TorchMissingError, which names what needs it.

    Raises InputError in a forked child of a process that has computed with torch: its threads do
    not survive a fork, and the child would wait for them for ever.
    """
    global _process
    try:
        import torch
    except ImportError as error:
        raise TorchMissingError(what) from error
    _process = _process or os.getpid()
    if _process != os.getpid():
        raise InputError(
            f"{what} must not be computed in a fork of a process that has used PyTorch. Try "
            "multiprocessing's start method spawn, or the loss mse"
        )
    return torch
