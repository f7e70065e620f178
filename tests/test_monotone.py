"""More is not worse: presets, limits of bytes, and why plain drawings do not diverge."""

import numpy as np
import pytest
from flat import vectorize

from gauss2svg.fit import adam

_SIDE, _FINER = 96, 4


@pytest.fixture(scope="module")
def smile() -> np.ndarray:
    """A face of flat colours, antialiased."""
    y, x = np.mgrid[: _SIDE * _FINER, : _SIDE * _FINER] * (128 / _SIDE / _FINER)
    r = np.hypot(x - 64, y - 64)
    picture = np.ones((*r.shape, 3), np.float32)
    picture[r < 54] = 0.2, 0.15, 0.05
    picture[r < 50] = 1.0, 0.8, 0.2
    for eye in (45, 83):
        picture[np.hypot(x - eye, 0.7 * (y - 50)) < 6] = 0.2, 0.15, 0.05
    mouth = (np.abs(np.hypot(x - 64, y - 66) - 30) < 3) & (y > 74)
    picture[mouth] = 0.7, 0.1, 0.1
    return picture.reshape(_SIDE, _FINER, _SIDE, _FINER, 3).mean(axis=(1, 3))


def test_dearer_preset_is_not_worse(smile):
    found = [
        vectorize(smile, quality=quality).report["psnr_svg"]
        for quality in ("draft", "fast", "balanced")
    ]
    assert found == sorted(found)


def test_larger_limit_of_bytes_is_not_worse(smile):
    limits = "5k", "10k", "20k", "40k"
    found = [vectorize(smile, quality="fast", max_bytes=m).report["psnr_svg"] for m in limits]
    assert found == sorted(found)
    assert found[-1] > found[0] + 10


def test_plain_drawing_does_not_diverge_because_crisp_shapes_move_less(smile, monkeypatch):
    assert vectorize(smile, gaussians=256).report["rollbacks"] == 0
    monkeypatch.setattr(adam, "_STEP_BY_BETA", 0.0)
    assert vectorize(smile, gaussians=256).report["rollbacks"] > 0


def test_interrupted_run_has_the_palette_of_a_finished_one(photo):
    last = []
    whole = vectorize(photo, quality="fast").report
    for share in (0.3, 0.6, 0.9):
        report = vectorize(
            photo, quality="fast",
            progress=lambda progress: last.append(progress.fit),
            stop=lambda: bool(last and last[-1] and last[-1].done >= share),  # noqa: B023
        ).report  # fmt: skip
        assert report["stop_reason"] == "interrupted"
        each, usual = (r["svg_bytes"] / r["gaussians"] for r in (report, whole))
        assert each < 1.3 * usual
        last.clear()
