"""Properties of inks: what a list of them may be, and which are chosen for a picture."""

import numpy as np
import pytest

from gauss2svg.errors import InputError
from gauss2svg.fit import FitOptions
from gauss2svg.scene.ink_lists import check_inks
from gauss2svg.scene.inks import ink_colors, inks_of, printed_colors

GIVEN = "#f7c306,#c0322c,#17324d"


@pytest.mark.parametrize("inks", [GIVEN, "F7C306, c0322c ,#17324D", GIVEN.split(",")])
def test_colours_are_read_in_every_form(inks):
    assert FitOptions(inks=inks).inks == check_inks("inks", inks) == GIVEN
    np.testing.assert_array_equal(ink_colors(GIVEN)[1] * 255, [0xC0, 0x32, 0x2C])
    assert check_inks("inks", "#fff,000") == "#ffffff,#000000"
    assert check_inks("inks", "6") == check_inks("inks", 6) == 6


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_palette_files_are_read_as_gimp_and_inkscape_do(end, tmp_path):
    lines = [
        "GIMP Palette", "Name: 12 inks of 2024", "Columns: 3", "# 1 2 3", "  #4",
        "247\t195\t6\t16 / 255 yéllow", "", "  192  50  44", "192 50 44 again", "23 50 77\t", "",
    ]  # fmt: skip
    path = tmp_path / "inks.gpl"
    path.write_bytes(end.join(lines).encode())
    assert check_inks("inks", path) == check_inks("inks", str(path)) == GIVEN
    for other in ("JASC-PAL", "GIMP Palette", "GIMP Palette\n0 0 256"):
        path.write_text(other + end)
        with pytest.raises(InputError, match=r"inks must be (a palette of|1 to 64 different)"):
            check_inks("inks", path)


@pytest.mark.parametrize(
    ("inks", "why"),
    [
        (65, "in 2..64"), (1, "in 2..64; got 1"),
        ([f"#0000{k:02x}" for k in range(65)], "1 to 64 different"), ("", "such as #c0322c"),
        ("red,griin", "such as #c0322c"), ("#f7c30,#000", "such as #c0322c"),
        ("#fff,#000,#ffffff", "different colours; got"), (True, "a number of them"),
        (2.5, "a number of them"), ([1, 2], "a number of them"), ("none.gpl", "none.gpl"),
    ],
)  # fmt: skip
def test_other_inks_are_refused_in_one_line(inks, why):
    with pytest.raises(InputError, match=why) as refusal:
        FitOptions(inks=inks)
    assert "\n" not in str(refusal.value)


def test_paper_is_white_unless_it_is_given_or_an_ink_is_near_white():
    assert printed_colors(GIVEN) == {
        "#ffffff": (0, 0, 0), "#f7c306": (1, 0, 0), "#c0322c": (0, 1, 0), "#17324d": (0, 0, 1),
    }  # fmt: skip
    assert printed_colors("#f0e6d8,#17324d") == {"#f0e6d8": (1, 0), "#17324d": (0, 1)}
    assert printed_colors("#17324d", "#c8a878") == {"#c8a878": (0,), "#17324d": (1,)}
    assert printed_colors("#17324d,#c8a878", "#c8a878") == {"#c8a878": (0, 0), "#17324d": (1, 0)}


@pytest.mark.parametrize("tones", [1, 3])
@pytest.mark.parametrize("paper", ["#f5f0e6", None])
def test_colours_of_overprints_are_products_of_paper_and_inks(paper, tones):
    inks = "#0078bf,#ff48b0"
    colors = printed_colors(inks, paper, tones)
    assert len(colors) == (tones + 1) ** 2
    ground, (first, second) = ink_colors(paper or "#ffffff")[0], ink_colors(inks)
    for color, (a, b) in colors.items():
        product = ground * (1 - a * (1 - first)) * (1 - b * (1 - second))
        np.testing.assert_allclose(ink_colors(color)[0], product, atol=0.51 / 255)
    # Black hides what it is mixed with, which is then not printed.
    assert printed_colors("#000000,#ff48b0", paper, 1)["#000000"] == (1, 0)


@pytest.mark.parametrize("count", [2, 5, 9])
def test_as_many_inks_are_chosen_lightest_first_as_are_asked_for(count):
    pixels = np.random.default_rng(1).random((30, 40, 3)).astype(np.float32)
    inks = inks_of(pixels, count).split(",")
    assert len(set(inks)) == count
    lightness = ink_colors(",".join(inks)) @ [0.3, 0.6, 0.1]
    assert lightness[0] > lightness.max() - 0.02  # Oklab's order is a little different
    assert lightness[-1] < lightness.min() + 0.02
    assert inks_of(pixels, ",".join(inks)) == ",".join(inks)


def test_a_picture_has_no_more_inks_than_visible_colours():
    pixels = np.zeros((6, 6, 4), np.float32)
    pixels[..., 0] = 1  # red, where it is not seen
    pixels[:3] = [0, 0, 1, 1]
    pixels[0] = [0, 1, 0, 1]
    assert set(inks_of(pixels, 2).split(",")) == {"#00ff00", "#0000ff"}
    with pytest.raises(InputError, match=r"at most 2, the number of colours .*; got 3"):
        inks_of(pixels, 3)


def test_antialiasing_and_paper_are_no_inks_and_an_only_colour_is_one():
    at = np.hypot(*np.mgrid[-100:100, -100:100])
    picture = np.full((200, 200, 3), [0.93, 0.91, 0.86])
    for radius, color in ((80, [0.13, 0.13, 0.13]), (30, [0.88, 0.1, 0.14])):
        cover = np.clip(radius - at, 0, 1)[..., None]  # antialiased
        picture = (1 - cover) * picture + cover * color
    assert inks_of(picture, 6) == "#ede8db,#e01a24,#212121"
    assert inks_of(picture, 2, paper="#f5f0e6") == "#e01a24,#212121"
