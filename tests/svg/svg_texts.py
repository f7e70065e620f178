"""Small SVG documents, and what it is for scenes to be the same, for tests of read_svg."""

import numpy as np
import pytest

from gauss2svg.scene import Scene
from gauss2svg.svg.forms import gradient_stops

PER_SHAPE = ("mean", "covariance", "color", "opacity", "beta", "round_index")
SPACES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" '
    'xmlns:sodipodi="http://sodipodi.sourceforge.net/DTD/sodipodi-0.dtd"'
)
AS_PATH = 'd="M 1,0 A 1,1 0 0 1 0,1 1,1 0 0 1 -1,0 1,1 0 0 1 0,-1 1,1 0 0 1 1,0 Z"'
RECT = '<rect width="100%" height="100%" fill="#abc"/>'
CIRCLE = '<circle r="1" transform="matrix(9 2 0 6 20 15)" fill="url(#a)"/>'


def gradient(
    key: str = "a", beta: float = 1.0, color: str = "#f80", count: int = 6, more: str = ""
) -> str:
    rows = zip(*gradient_stops(count, beta), strict=True)
    stops = "".join(
        f'<stop offset="{o}" stop-color="{color}" stop-opacity="{v}"/>' for o, v in rows
    )
    return (
        f'<radialGradient id="{key}" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1" '
        f'fx=".001" {more}>{stops}</radialGradient>'
    )


def document(body: str = CIRCLE, defs: str = "", root: str = "", rect: str = RECT) -> str:
    root = root or 'width="40" height="30" viewBox="0 0 40 30"'
    return f"<svg {SPACES} {root}><defs>{gradient()}{defs}</defs>{rect}{body}</svg>"


def assert_same(scene: Scene, other: Scene, atol: float = 1e-9) -> None:
    assert len(scene) == len(other)
    assert (scene.width, scene.height) == pytest.approx((other.width, other.height))
    np.testing.assert_allclose(scene.background, other.background, atol=1e-9)
    for name in PER_SHAPE:
        np.testing.assert_allclose(getattr(scene, name), getattr(other, name), atol=atol)
