"""PyTorch, which only some functions need, is an optional dependency."""

from typing import Any

from gauss2svg.errors import InputError


class TorchMissingError(InputError, ImportError):
    """PyTorch is needed and not installed."""

    def __init__(self, what: str) -> None:
        super().__init__(f"{what} needs PyTorch. Try pip install 'gauss2svg[torch]'")


def require_torch(what: str) -> Any:
    """The module torch; raises TorchMissingError, which names what needs it."""
    try:
        import torch
    except ImportError as error:
        raise TorchMissingError(what) from error
    return torch
