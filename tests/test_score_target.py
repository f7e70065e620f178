"""A target SSIMULACRA2: reached, or reported, or refused in one line."""

import numpy as np
import pytest
from flat import vectorize
from skimage import data

from gauss2svg.errors import InputError
from gauss2svg.measure.perceptual import ssimulacra2
from gauss2svg.pipeline.aims import aim_of
from gauss2svg.pipeline.options import Goal
from gauss2svg.raster import rasterize_like


@pytest.fixture(scope="module")
def cat() -> np.ndarray:
    return np.asarray(data.chelsea()[:, 60:400], np.float32) / 255


@pytest.mark.sweep
@pytest.mark.parametrize("score", [10.0, 35.0])
def test_score_of_the_rasterised_file_is_the_target(cat, score):
    result = vectorize(cat, target_ssimulacra2=score, quality="draft", iterations=80)
    report = result.report
    assert report["stop_reason"] == "target_ssimulacra2"
    assert score - 0.3 <= report["ssimulacra2_svg"] <= score + 3
    assert report["unreached"] == []
    measured = ssimulacra2(rasterize_like(result.svg, cat, "resvg"), cat)
    assert measured == pytest.approx(report["ssimulacra2_svg"], abs=1e-6)


@pytest.mark.sweep
def test_score_that_few_gaussians_cannot_reach_is_reported(cat):
    report = vectorize(cat, target_ssimulacra2=90, gaussians=20, iterations=10).report
    assert report["gaussians"] <= 20
    assert report["stop_reason"] == "gaussians"
    [line] = report["unreached"]
    assert line.startswith("target of SSIMULACRA2 90 not reached: ")


def test_score_is_refused_beside_psnr_and_a_time_limit_and_for_small_photos(cat):
    with pytest.raises(InputError, match="target_ssimulacra2 must be given without target_psnr"):
        Goal(target_psnr=30, target_ssimulacra2=50)
    with pytest.raises(InputError, match="target_ssimulacra2 must not be given with time_limit"):
        vectorize(cat, target_ssimulacra2=50, time_limit=3)
    with pytest.raises(InputError, match=r"must be at least 225 px.*got 200 px"):
        vectorize(cat[:200], target_ssimulacra2=50)


def test_detail_of_one_file_corrects_its_score():
    for goal in (Goal(target_psnr=30), Goal(target_ssimulacra2=50)):
        aim = aim_of(goal)
        assert aim is not None
        for at_fit, at_photo in ((31.0, 29.0), (48.0, 53.0)):
            detail = aim.detail(at_photo, at_fit)
            assert aim.with_detail(at_fit, detail) == pytest.approx(at_photo, abs=1e-9)
    assert aim_of(Goal()) is None
