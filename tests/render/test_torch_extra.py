"""PyTorch is optional: photos are vectorised without it, and what needs it says how to get it."""

import subprocess
import sys

import pytest

# As if it were not installed.
WITHOUT = "import sys; sys.modules['torch'] = None\n"
ADVICE = 'needs PyTorch. Try pip install "gauss2svg[torch]"'


def printed(code: str) -> str:
    run = subprocess.run(
        [sys.executable, "-c", WITHOUT + code], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.mark.sweep
def test_photos_are_vectorised_without_it():
    code = (
        "import numpy as np, gauss2svg\n"
        "from gauss2svg import FitOptions\n"
        "photo = np.random.default_rng(0).random((20, 20, 3))\n"
        "result = gauss2svg.vectorize(photo, gaussians=9, fit=FitOptions(iterations=9))\n"
        "print(result.svg.count('<circle'))"
    )
    assert printed(code).strip() == "9"


def test_a_module_that_needs_it_says_so():
    for module in ("autograd", "reference"):
        code = f"try:\n    import gauss2svg.render.{module}\n"
        code += "except ImportError as error:\n    print(type(error).__name__, error)\n"
        expected = f"TorchMissingError the differentiable renderer {ADVICE}\n"
        assert printed(code) == expected
