"""Properties of the kernels: which are loaded, what they refuse, and which memory they use."""

import os
import shutil
import subprocess
import sys

import pytest
from levels import LEVELS, PACKAGE, printed

# Prints a digest of pictures, gradients, costs, steps and areas. Scenes have all forms of shapes,
# some of them far off the canvas and thin.
DRAWING = """
import hashlib, sys
import numpy as np
from gauss2svg.areas.outlines import merged_path
from gauss2svg.areas.find import find_areas
from gauss2svg.fit import FitOptions
from gauss2svg.fit.state import columns_of, step
from gauss2svg.fit.placement import components_of
from gauss2svg.fit.state import State
from gauss2svg.render import cpu, render
from gauss2svg.scene import ADD, OVER, PLAIN, SOFT, Scene

digest = hashlib.sha256()
for seed in range(int(sys.argv[1])):
    rng = np.random.default_rng(seed)
    n, width, height = int(rng.integers(0, 40)), *rng.integers(1, 70, 2).tolist()
    blend = (OVER, ADD)[seed % 3 == 2]
    scene = Scene(
        width, height, rng.uniform(-20, 90, (n, 2)), np.exp(rng.uniform(-7, 4, (n, 2))),
        rng.uniform(-0.999, 0.999, n), rng.random((n, 3)),
        np.ones(n) if blend == ADD else rng.random(n),
        beta=np.ones(n) if blend == ADD else rng.choice([1.0, 0.6, 3.0, 60.0], n),
        drawn=np.full(n, SOFT) if blend == ADD else rng.choice([SOFT, PLAIN], n), blend=blend,
    )
    splats = cpu.splats_of(scene)
    for dtype in (np.float32, np.float64):
        target = rng.random((3, height, width)).astype(dtype)
        image, loss, moments, _ = cpu.squared_error(splats, target, target[0] + 0.5)
        image, cost = cpu.removal_cost(splats, target)
        for result in (image, moments, cost):
            digest.update(result.tobytes())
    state = State.of_scene(scene)
    step(state, moments, splats, columns_of(FitOptions(blend=blend)), 40.0)
    components = components_of(rng.integers(0, 3, (9, 8)).astype(np.int32))
    for result in (state.mean, state.factor, state.color, components):
        digest.update(result.tobytes())
y, x = np.mgrid[:48, :64] + 0.5
disc, line = np.clip(15.5 - np.hypot(x - 20, y - 22), 0, 1), np.clip(2 - np.abs(x - y - 9), 0, 1)
picture = np.ones((48, 64, 3)) - disc[..., None] * [0.9, 0.2, 0.1] - 0.8 * line[..., None]
areas = find_areas(np.clip(picture, 0, 1).astype(np.float32)).areas
digest.update(render(Scene(64, 48, areas=areas)).tobytes())
# Joins of a disc, of which the first moves to before the first point.
angle, start = np.arange(60) * np.pi / 30, np.array([0, 8, 34, 60])
points = 10 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
run = points, np.ones(60), start, None, True, 1 / 32, 0.0, 1e-4
digest.update(merged_path(*run).segments.tobytes())
print(digest.hexdigest())
"""


@pytest.mark.process
@pytest.mark.skipif(len(LEVELS) < 2, reason="the CPU has one level")
def test_all_levels_give_the_same_bits():
    assert len({printed(DRAWING, 60, GAUSS2SVG_CPU=level) for level in LEVELS}) == 1


@pytest.mark.sweep
@pytest.mark.skipif(sys.platform != "linux", reason="needs GCC's library of checks")
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs GCC")
def test_nothing_is_read_or_written_beside_arrays_and_nothing_is_undefined(tmp_path):
    tree = tmp_path / "tree"
    shutil.copytree(PACKAGE, tree / "gauss2svg", ignore=shutil.ignore_patterns("kernels-*"))
    build = [sys.executable, str(tree / "gauss2svg" / "core" / "build.py")]
    checks = "gcc -g -fsanitize=undefined,address -fno-sanitize-recover=undefined"
    subprocess.run(build, check=True, env={**os.environ, "CC": checks})
    library = subprocess.run(["gcc", "-print-file-name=libasan.so"], capture_output=True, text=True)
    variables = {"ASAN_OPTIONS": "detect_leaks=0", "LD_PRELOAD": library.stdout.strip()}
    printed(DRAWING, 100, tree=tree, **variables)
