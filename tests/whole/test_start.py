"""Laws of what a run imports: nothing slow that it does not use; twins give the same bits."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from levels import printed
from scipy.ndimage import gaussian_filter
from scipy.spatial import KDTree
from skimage.measure import label
from skimage.metrics import structural_similarity

from gauss2svg.files import as_png
from gauss2svg.fit.placement import components_of
from gauss2svg.measure import metrics
from gauss2svg.without_scipy import nearest_entry, smoothed


def loaded_by(code, names, *arguments):
    """Which of these packages a process of its own has loaded once it has run the code."""
    code += "; import sys; print(*sorted(set(sys.argv[1].split()) & set(sys.modules)))"
    return printed(code, " ".join(names), *arguments).splitlines()[-1].split()


COMMAND = "import sys; from gauss2svg.cli.main import main; main(sys.argv[2:])"


@pytest.mark.process
@pytest.mark.parametrize(
    ("code", "names"),
    [
        ("from gauss2svg.cli.main import main; main([])", "numpy scipy PIL torch"),
        ("import gauss2svg as g; g.vectorize; g.vectorize_many", "fsspec"),
        ("import gauss2svg.studio, gauss2svg.cli.main as m; m.main(['studio', '-h'])", "fastapi"),
        ("import gauss2svg.compare.records", "numpy PIL gauss2svg.pipeline"),
    ],
    ids=["help", "names of the package", "studio", "process of a peer"],
)
def test_what_is_of_another_part_is_not_loaded(code, names):
    assert loaded_by(code, names.split()) == []


@pytest.mark.process
def test_a_default_run_on_a_small_photo_loads_nothing_slow_and_nothing_of_other_parts(tmp_path):
    photo = tmp_path / "photo.png"
    photo.write_bytes(as_png(np.random.default_rng(0).random((40, 60, 3)).astype(np.float32)))
    command = [str(photo), "-o", str(tmp_path / "photo.svg"), "--quality", "draft", "--quiet"]
    slow = [
        "torch", "skimage", "jinja2", "uvicorn", "gauss2svg.compare",
        *(f"gauss2svg.{n}" for n in ("areas.find", "render.areas", "pipeline.by_areas")),
        *(f"scipy.{n}" for n in ("linalg", "ndimage", "spatial", "special")),
    ]  # fmt: skip
    assert loaded_by(COMMAND, slow, *command) == []


SIDES = st.integers(1, 60)


@given(SIDES, SIDES, st.sampled_from([0.05, 0.5, 1.0, 1.5, 2.0, 4.0]), st.booleans(), st.integers())
def test_smoothing_is_scipys_but_for_the_rounding_of_weights(height, width, sigma, single, seed):
    plane = np.random.default_rng(abs(seed)).standard_normal((height, width))
    plane = plane.astype(np.float32) if single else plane
    for truncate in (3.5, 4.0):
        expected = gaussian_filter(plane, sigma, truncate=truncate)
        found = smoothed(plane, sigma, truncate)
        assert found.dtype == expected.dtype
        assert np.abs(found - expected).max() <= 4 * np.finfo(plane.dtype).eps * np.abs(plane).max()


@pytest.mark.parametrize("shape", [(11, 11, 1), (300, 70, 3)])  # 300 rows are two bands
def test_ssim_is_scikit_images(shape):
    rng = np.random.default_rng(1)
    one = rng.random(shape).astype(np.float32)
    two = np.clip(one + rng.normal(0, 0.1, shape), 0, 1).astype(np.float32)
    expected = structural_similarity(
        one, two, data_range=1.0, use_sample_covariance=False, gaussian_weights=True, sigma=1.5,
        channel_axis=2,
    )  # fmt: skip
    assert metrics.ssim(one, two) == pytest.approx(expected, rel=1e-6)


@given(SIDES, SIDES, st.integers(1, 9), st.integers(), st.booleans())
def test_components_are_scikit_images_with_their_numbers(height, width, levels, seed, coarse):
    plane = np.random.default_rng(abs(seed)).integers(0, levels, (height, width)).astype(np.int32)
    if coarse:
        plane = np.repeat(np.repeat(plane, 3, axis=0), 2, axis=1)
    expected = label(plane, background=0, connectivity=2)
    assert np.array_equal(components_of(plane), expected)


@given(st.integers(1, 40), st.integers(0, 300), st.integers(1, 7), st.integers(), st.booleans())
@example(2000, 3000, 3, 0, False)  # more pairs than are compared one by one
def test_the_nearest_entry_is_as_near_as_that_of_a_tree(few, many, axes, seed, tied):
    rng = np.random.default_rng(abs(seed))
    entries, points = rng.random((few, axes)), rng.random((many, axes))
    if tied:
        entries, points = np.round(entries * 3), np.round(points * 3)
    distance, entry = nearest_entry(entries, points)
    assert np.array_equal(distance, KDTree(entries).query(points)[0])
    np.testing.assert_allclose(np.linalg.norm(points - entries[entry], axis=1), distance)
