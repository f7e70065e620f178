"""The pictures that examples/drawings.py measures on."""

import importlib
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def drawings(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "examples")
    return importlib.import_module("drawings").drawings


def test_drawings_are_ten_pictures_on_8_bits_the_same_every_time(drawings):
    first, second = dict(drawings()), dict(drawings())
    assert len(first) == 10
    for name, pixels in first.items():
        assert pixels.dtype == np.float32
        assert pixels.ndim == 3
        assert pixels.shape[2] == 3
        assert pixels.min() >= 0
        assert pixels.max() <= 1
        levels = np.round(pixels * 255).astype(np.uint8)
        np.testing.assert_array_equal(pixels, levels / np.float32(255))
        np.testing.assert_array_equal(pixels, second[name])
