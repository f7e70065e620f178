"""PyTorch and what needs it. Tests that import it from here are skipped where it is missing."""

import pytest

torch = pytest.importorskip("torch")

from reference_render import below_one, render_reference  # noqa: E402, F401 (needs torch)
