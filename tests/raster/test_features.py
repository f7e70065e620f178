"""Features that renderers draw wrongly, found by their words."""

import pytest

from gauss2svg.raster.features import Feature, uses

SPELT = "".join(f"&#{ord(letter)};" for letter in "rotate")  # by references of XML


@pytest.mark.parametrize(
    ("svg", "feature", "expected"),
    [
        ('<g filter="none"/>', Feature.FILTER, False),
        ('<g style="mix-blend-mode: normal"/>', Feature.BLEND, False),
        ('<g style="mix-blend-mode/**/:multiply"/>', Feature.BLEND, True),
        ("<text><![CDATA[<!--]]></text><feGaussianBlur/>", Feature.BLUR, True),
        (f'<feGaussianBlur/><g transform="{SPELT}(30)"/>', Feature.TURNED_BLUR, True),
        ('<feGaussianBlur/><g transform="matrix (.7 .7 -.7 .7 0 0)"/>', Feature.TURNED_BLUR, True),
        ('<feGaussianBlur/><g transform="matrix(2 0 0 2 0 0)"/>', Feature.TURNED_BLUR, False),
    ],
)
def test_a_feature_is_found_however_it_is_written_and_where_it_has_an_effect(
    svg, feature, expected
):
    assert uses(f"<svg>{svg}</svg>", feature) == expected
