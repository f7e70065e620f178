"""PyTorch; tests of a module that imports it from here are skipped where it is not installed."""

import pytest

torch = pytest.importorskip("torch")
