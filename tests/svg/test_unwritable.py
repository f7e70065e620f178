"""What cannot be written is refused in one line that says what to try."""

import numpy as np
import pytest
from conftest import random_scene, random_sum

from gauss2svg.errors import InputError, SceneError
from gauss2svg.scene import Scene
from gauss2svg.svg.document import Document, SvgFormat
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.write import outline_svg, plate_svg, write_svg

EMPTY, SOFT, SUM = Scene(5, 4), random_scene(5, seed=1), random_sum(5, 20, 20, 1)
INKS = np.array([[0x17, 0x32, 0x4D], [0xC0, 0x32, 0x2C]]) / 255
INKED = Scene(
    9, 9, [[4, 4]], [[2, 2]], [0], INKS[:1], [1], background=INKS[1], beta=[128.0], drawn=[1]
)
MINIMAL, BY_INK = SvgFormat(markup="minimal"), SvgFormat(layers="inks")
ANIMATED, FRAGMENTS = Document(animate=2.0), Document(fragments=True)
REFUSED = {
    "no scene": (lambda: write_svg(3), "scene must be a Scene; got int"),
    "animated sum": (lambda: write_svg(SUM, None, ANIMATED), "animate must .*--portable"),
    "fragments of a sum": (lambda: write_svg(SUM, None, FRAGMENTS), "fragments must .*--portable"),
    "blurs of a sum": (lambda: write_svg(SUM, SvgFormat(form="blur")), "form must be 'gradient'"),
    "outlines of a sum": (lambda: outline_svg(SUM), "scene with outlines must .*--portable"),
    "inks of a sum": (lambda: write_svg(SUM, BY_INK), "of opaque plain ellipses alone"),
    "minimal sum": (lambda: write_svg(SUM, MINIMAL), "blend in minimal markup must be 'over'"),
    "minimal and animated": (lambda: write_svg(SOFT, MINIMAL, ANIMATED), "animate .*editable"),
    "minimal fragments": (lambda: write_svg(SOFT, MINIMAL, FRAGMENTS), "fragments .*editable"),
    "minimal blurs": (
        lambda: write_svg(SOFT, SvgFormat(markup="minimal", form="blur")),
        "form must be gradient in minimal markup; got 'blur'",
    ),
    "unit of nothing": (lambda: minimal_svg(SOFT, 0), "unit must be a number in 0.001..1e"),
    "no unit": (lambda: minimal_svg(SOFT, float("nan")), "unit must be a number in 0.001..1e"),
    "four digits": (lambda: minimal_svg(SOFT, 1, 4), "digits must be 3 or 6; got 4"),
    "layers of no inks": (lambda: write_svg(SOFT, BY_INK), "of opaque plain ellipses alone"),
    "animated inks": (lambda: write_svg(INKED, BY_INK, ANIMATED), "given with layers inks"),
    "plate of no inks": (lambda: plate_svg(SOFT, "#000000"), "of opaque plain ellipses alone"),
    "another plate": (lambda: plate_svg(INKED, "#000"), "one of #17324d, #c0322c; got '#000'"),
    "fragments of pens": (lambda: outline_svg(EMPTY, FRAGMENTS, pens=2), "given with pens"),
    **{
        f"{pens} pens": (lambda pens=pens: outline_svg(EMPTY, pens=pens), "pens must be a whole")
        for pens in (0, 65, 1.5, "three")
    },
    **{
        f"stroke of {width}": (lambda width=width: outline_svg(EMPTY, None, width), "stroke_width")
        for width in (0, -1, float("nan"), 1e9, "thin")
    },
    "no height": (
        lambda: write_svg(Scene(3000, 1), None, Document(size="0.1mm")),
        r"size must be larger; .*3000x1 px 0\.1000 by 0\.0000mm",
    ),
    "no size": (lambda: write_svg(EMPTY, None, Document(size=".00001mm")), "size must be larger"),
    "too far": (lambda: write_svg(SOFT.replace(sigma=np.full((5, 2), 1e9))), "must reach at most"),
    "too small": (lambda: write_svg(SOFT.replace(width=1e-5)), "canvas of an SVG must be"),
    "too small, minimal": (
        lambda: write_svg(SOFT.replace(width=1e-5), MINIMAL),
        "canvas of an SVG must be",
    ),
    "too wide": (lambda: write_svg(SOFT.replace(width=1e8)), "canvas of an SVG must be"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_written_is_refused_in_one_line(case):
    write, line = REFUSED[case]
    with pytest.raises((InputError, SceneError), match=line) as caught:
        write()
    assert "\n" not in str(caught.value)
