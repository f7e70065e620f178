import numpy as np
import pytest
from conftest import random_scene

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure import metrics
from gauss2svg.raster import RENDERERS, cairo, rasterize, renderer_version
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.snap import snapped
from gauss2svg.svg.write import write_svg

QUICK = ("resvg", "cairo", "chromium")  # of which none starts a program for each drawing


def test_svg_is_drawn_at_any_size(renderer):
    scene = snapped(random_scene(20, 60, 40, 2, (3.0, 20.0), (1.0, 4.0)), GRADIENT)
    drawn = rasterize(write_svg(scene), 120, 80, renderer)
    assert metrics.psnr(drawn, render(scene, 120, 80)) > 44


def test_background_comes_back_to_the_level(renderer):
    color = np.array([10, 200, 77]) / 255
    drawn = rasterize(write_svg(Scene(7, 5, background=color)), 7, 5, renderer)
    np.testing.assert_allclose(drawn, np.broadcast_to(color, (5, 7, 3)), atol=1e-6)


def test_broken_file_is_an_error_not_a_blank_picture(renderer):
    with pytest.raises(RendererError, match="cannot draw"):
        rasterize("<svg", 5, 5, renderer)


def test_unknown_renderer_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="resvg, cairo"):
        rasterize("<svg/>", 5, 5, "photoshop")


def test_versions_name_their_renderer():
    assert renderer_version("resvg").startswith("resvg ")
    assert renderer_version("cairo").startswith("CairoSVG ")


def test_missing_cairo_library_is_one_line_that_says_what_to_install(monkeypatch):
    import builtins

    real = builtins.__import__

    def without_cairo(name, *rest):
        if name == "cairosvg":
            raise OSError("no library called cairo was found")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without_cairo)
    with pytest.raises(RendererError, match="apt-get install libcairo2") as caught:
        cairo.version()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("renderer", "size"),
    # Enough of one that starts a program.
    [
        (name, size)
        for name in RENDERERS
        for size in ((31, 64), (40, 30), (7, 5))[: 3 if name in QUICK else 1]
    ],
    indirect=["renderer"],
)
def test_any_size_is_filled_whatever_the_proportions(renderer, size):
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg" width="20" height="20" viewBox="0 0 20 20">'
        '<rect width="20" height="20" fill="#00f"/><rect width="10" height="20" fill="#f00"/></svg>'
    )
    drawn = rasterize(svg, *size, renderer)
    width = size[0]
    assert (drawn[:, : width // 2] == [1, 0, 0]).all()
    assert (drawn[:, (width + 1) // 2 :] == [0, 0, 1]).all()
