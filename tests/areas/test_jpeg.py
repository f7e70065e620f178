"""Properties of what JPEG changes of a drawing."""

import numpy as np
import pytest
from test_clean import as_jpeg, enlarged
from test_find import DRAWINGS, drawn

from gauss2svg.areas.clean import coded, decoded, quality_of

PICTURE = drawn(DRAWINGS["discs in discs"])


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
@pytest.mark.parametrize("quality", [60, 75, 85, 90, 95])
def test_the_quality_of_a_jpeg_is_found(quality, subsampling):
    assert quality_of(as_jpeg(PICTURE, quality, subsampling)) == pytest.approx(quality, abs=2)


@pytest.mark.parametrize("name", DRAWINGS)
def test_other_pictures_have_no_quality(name):
    clean = drawn(DRAWINGS[name])
    for picture in (clean, enlarged(as_jpeg(clean, 75), 0.5), enlarged(as_jpeg(clean, 75), 1.25)):
        assert quality_of(picture) is None


@pytest.mark.parametrize("subsampling", ["4:2:0", "4:4:4"])
def test_the_source_explains_all_that_jpeg_changed(subsampling):
    picture = as_jpeg(PICTURE, 75, subsampling)
    assert np.array_equal(coded(PICTURE, 75, picture), picture)
    assert np.abs(decoded(picture, PICTURE, 75) - PICTURE).max() < 1 / 255
