"""PyTorch is optional: what needs it says how to get it."""

import importlib
import sys

import pytest

from gauss2svg.render import TorchMissingError


def test_modules_that_need_it_say_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)  # as if it were not installed
    for module in ("autograd", "reference"):
        for name in ("autograd", "reference"):
            monkeypatch.delitem(sys.modules, f"gauss2svg.render.{name}", raising=False)
        with pytest.raises(TorchMissingError, match=r'needs PyTorch\. Try pip install "gauss2svg'):
            importlib.import_module(f"gauss2svg.render.{module}")
