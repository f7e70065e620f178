"""The same version, pixels and options give the same file at each level of x86-64."""

import pytest
from levels import LEVELS, printed

# Prints the digest of a file of each kind.
FILES = """
import hashlib, sys
import numpy as np
from skimage import data
import gauss2svg
from gauss2svg import FitOptions, RunOptions, SvgOptions, vectorize

photo = data.astronaut()[20:164:3, 180:324:3]
y, x = np.mgrid[:64, :64] + 0.5
disc = np.clip(20.5 - np.sqrt((x - 28) ** 2 + (y - 30) ** 2), 0, 1)[..., None]
line = np.clip(2 - np.abs(x - y - 9), 0, 1)[..., None]
fade = 0.3 + 0.4 * (x / 64)[..., None] * np.array([1, 0.6, 0.2])
drawing = (1 - line * [0.1, 0.7, 0.9]) * (1 - disc) + disc * fade
drawing = np.round(255 * drawing).astype(np.uint8)
alpha = np.dstack([photo, np.round(255 * np.clip(1.4 - np.hypot(x, y)[:48, :48] / 40, 0, 1))])
mask = np.round(255 * (x[:48, :48] < 20)).astype(np.uint8)
run = RunOptions(threads=int(sys.argv[1]) or None)
start = vectorize(photo, gaussians=40, fit=FitOptions(iterations=20), run=run).scene
QUICK = dict(gaussians=60, fit=FitOptions(iterations=30))
KINDS = {
    "photo": (photo, dict(quality="draft")),
    "drawing": (drawing, {}),
    "limit": (photo, dict(max_bytes=1500)),
    "limit of a drawing": (drawing, dict(max_bytes=2000)),
    "target": (photo, dict(target_psnr=24, quality="draft")),
    "inks": (drawing, dict(gaussians=60, fit=FitOptions(iterations=30, inks=3))),
    "additive": (photo, dict(gaussians=60, fit=FitOptions(iterations=30, blend="add"))),
    "alpha": (alpha.astype(np.uint8), QUICK),
    "focus": (photo, dict(QUICK, focus=mask)),
    "start": (photo, dict(start=start, fit=FitOptions(iterations=20))),
    "minimal": (photo, dict(QUICK, svg=SvgOptions(markup="minimal"))),
    "adaptive": (photo, dict(gaussians=60, fit=FitOptions(iterations=30, falloff="adaptive"))),
    "ssim": (photo, dict(gaussians=60, fit=FitOptions(iterations=20, loss="mse+ssim"))),
}
for name, (picture, options) in KINDS.items():
    result = vectorize(picture, run=run, **options)
    digests = result.report["pixels_sha256"], result.report["options_sha256"]
    print(name, hashlib.sha256(result.svg.encode()).hexdigest(), *digests)
"""


@pytest.mark.process
def test_each_level_library_and_number_of_threads_gives_the_same_files():
    """NumPy's loops and OpenBLAS, which take instructions by the CPU, reach no file."""
    from numpy._core._multiarray_umath import __cpu_dispatch__

    plain = {"NPY_DISABLE_CPU_FEATURES": " ".join(__cpu_dispatch__), "OPENBLAS_CORETYPE": "Nehalem"}
    expected = printed(FILES, 1).splitlines()
    for level in LEVELS[:-1] or [""]:
        variables = plain | ({"GAUSS2SVG_CPU": level} if level else {})
        assert printed(FILES, 0, **variables).splitlines() == expected
