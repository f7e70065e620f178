"""Laws of small files, of which every byte is planned."""

from itertools import pairwise

import numpy as np
import pytest
from flat import vectorize

from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.by_bytes import ByBytes
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import BY_BYTES_UP_TO, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.raster import rasterize, rasterize_like


def hills(width=72, height=48):
    """A soft picture of a few colours."""
    y, x = np.mgrid[:height, :width] / height
    red = 0.5 + 0.4 * np.sin(5 * x) * np.cos(4 * y)
    picture = np.stack([red, 0.3 + 0.4 * y, 0.6 - 0.3 * np.cos(6 * x * y)], axis=-1)
    return picture.astype(np.float32)


def shapes(width=64, height=64):
    """A drawing of flat regions with crisp rims."""
    y, x = np.mgrid[:height, :width] + 0.5
    picture = np.full((height, width, 3), 0.9, np.float32)
    picture[(x - 20) ** 2 + (y - 24) ** 2 < 150] = (0.8, 0.1, 0.1)
    picture[np.abs(x - 45) + np.abs(y - 40) < 14] = (0.1, 0.2, 0.7)
    picture[(y > 54) & (x > 6) & (x < 58)] = (0.2, 0.6, 0.2)
    return picture


def search(picture, limit, stop=None, **given):
    """A search for a file of so many bytes."""
    options = Options.from_flat({"max_bytes": limit, **given})
    return ByBytes(Plan(options), Subject(picture, picture, picture.shape[1::-1]), Run(stop=stop))


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["hills", "shapes", "photo"])
def test_more_bytes_are_never_worse_also_across_markups(kind, photo):
    picture = {"hills": hills(), "shapes": shapes(), "photo": photo[::4, ::4]}[kind]
    # Far enough apart that what a fit gains by chance is less than what the bytes bring.
    limits = 150, 400, 1000, 2600, 4000, BY_BYTES_UP_TO, BY_BYTES_UP_TO + 1, 18_000
    found = [
        vectorize(picture, max_bytes=limit, areas="never", tune="psnr").report["psnr_svg"]
        for limit in (limits[4:] if kind == "photo" else limits[:4])
    ]
    assert all(b > a - 0.1 * (kind == "photo") for a, b in pairwise(found))
    assert kind == "photo" or found[-1] > found[0] + 6


def test_a_file_has_gaussians_wherever_one_fits():
    y, x = np.mgrid[:64, :64] - 31.5
    spot = 0.9 - 0.7 * np.exp(-(x**2 + y**2) / 400)
    picture = np.repeat(spot[:, :, None], 3, axis=2).astype(np.float32)
    flat = search(picture, 1000).flat.size
    assert flat < 100
    for more in (0, 45):
        file = search(picture, flat + more, iterations=30).run().file
        assert file.size <= flat + more
        assert (len(file.scene) > 0) == (more > 0)


def test_a_picture_one_pixel_high_is_drawn_by_no_more_shapes_than_it_has_pixels():
    ramp = np.linspace(0.1, 0.9, 300, dtype=np.float32)
    for picture in (np.dstack([ramp[None]] * 3), np.dstack([ramp[:, None]] * 3)):
        run = search(picture, 2000, iterations=15)
        found = run.run().file
        assert psnr(rasterize_like(found.svg, picture), picture) > 35
        assert max(len(fit.scene) for fit in run.fits) <= run.subject.working[..., 0].size


def test_small_files_are_tuned_as_they_are_told_and_else_for_psnr(photo):
    given = {"max_bytes": 400, "iterations": 3}
    found = {t: vectorize(photo[::4, ::4], tune=t, **given) for t in (None, "psnr", "perceptual")}
    assert found[None].svg == found["psnr"].svg != found["perceptual"].svg
    assert [found[t].report["tune"] for t in found] == ["psnr", "psnr", "perceptual"]


def test_a_search_that_is_stopped_early_has_a_file_with_shapes():
    for limit in (400, 3000):
        polls = iter(range(40))
        run = search(hills(), limit, stop=lambda polls=polls: next(polls, None) is None)
        file = run.run().file
        assert len(run.fits) == 1
        assert len(file.scene)
        assert file.size <= limit


def test_growth_goes_on_where_new_shapes_disturb_the_first_few():
    rng = np.random.default_rng(38)
    color = lambda: "#" + rng.bytes(3).hex()  # noqa: E731
    circles = "".join(
        f'<circle cx="{rng.uniform(20, 108):.0f}" cy="{rng.uniform(20, 108):.0f}"'
        f' r="{rng.uniform(14, 44):.0f}" fill="{color()}"/>'
        for _ in range(4)
    )
    icon = f"""<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 128 128"><circle cx="64" cy="64"
    r="62" fill="{color()}"/>{circles}</svg>"""
    picture = rasterize(icon, 40, 40, alpha=True)
    assert vectorize(picture, areas="never", falloff="gaussian").report["psnr_svg"] > 30
