"""PyTorch is optional: what needs it says how to get it."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["autograd", "reference"])
def test_a_module_that_needs_it_says_so(module):
    code = "import sys; sys.modules['torch'] = None\n"  # as if it were not installed
    code += f"try:\n    import gauss2svg.render.{module}\n"
    code += "except ImportError as error:\n    print(type(error).__name__, error)\n"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    advice = 'needs PyTorch. Try pip install "gauss2svg[torch]"'
    assert run.stdout == f"TorchMissingError the differentiable renderer {advice}\n"


@pytest.mark.process
def test_photos_are_vectorised_without_it():
    code = (
        "import sys; sys.modules['torch'] = None; import numpy as np, gauss2svg as g; "
        "photo = np.random.default_rng(0).random((20, 20, 3)); "
        "print(len(g.vectorize(photo, gaussians=9, fit=g.FitOptions(iterations=9)).scene))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "9\n"
