"""PyTorch, which only the differentiable renderer needs, is an optional dependency."""

from gauss2svg.errors import InputError


class TorchMissingError(InputError, ImportError):
    """PyTorch is needed and not installed."""

    def __init__(self, what: str) -> None:
        super().__init__(f'{what} needs PyTorch. Try pip install "gauss2svg[torch]"')
