"""What the page is told of options, and the command that makes the same file."""

import re
import shlex

import pytest
from flat import BESIDE
from studio_server import answer_of

from gauss2svg.cli import vectorize as command
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError
from gauss2svg.pipeline.options import Options
from gauss2svg.studio.options import USES, command_of, form, options_of
from gauss2svg.studio.service import create_app

OPTIONS = [option for group in form()["groups"] for option in group["options"]]
# A value of each option that is not its default.
CHANGED = {
    "quality": "fast", "gaussians": 700, "target_psnr": 31.5, "max_bytes": 40_000,
    "time_limit": 9.5, "iterations": 77, "loss": "l1+ssim", "tune": "psnr",
    "focus_strength": 6.0,
    "learning_rate": 0.5, "blend": "add", "falloff": "gaussian", "seed": 5,
    "current_color": True, "inks": "#0078bf,#ff48b0", "paper": "#f5f0e6", "overprint": 3,
    "init": "random", "relocate": False, "form": "blur", "markup": "minimal", "palette": 12,
    "stops": 8, "precision": 0.1, "matte": "#fa0", "portable": True, "gzip": True,
    "count_gzipped": True, "title": "A 'quoted' title", "alt": "-starts like an option",
    "size": "120mm", "aspect": "xMidYMid slice", "animate": 2.5, "fragments": True,
    "renderer": "cairo", "scores": True, "max_size": 200, "full_size": True, "areas": "always",
}  # fmt: skip
# Options that those exclude.
OTHERS = {"gaussians": 100, "target_ssimulacra2": 55}


def test_every_option_is_described_except_the_servers_own():
    names = [option["name"] for option in OPTIONS]
    own = {"threads", "max_memory", "max_pixels"}
    assert names == [name for name in Options().flat() if name not in own]
    assert CHANGED.keys() | OTHERS.keys() == set(names)
    for option in OPTIONS:
        assert option["help"]
        assert option["default"] == Options().flat()[option["name"]]
        if option["max"] is not None:  # an end is in the range, but for a number that is above it
            Options.from_flat({option["name"]: option["max"]} | BESIDE.get(option["name"], {}))
            with pytest.raises(InputError):
                Options.from_flat({option["name"]: option["max"] + 1})


def test_palette_files_of_the_server_are_not_read(tmp_path):
    (tmp_path / "two.gpl").write_text("GIMP Palette\n0 0 0\n255 255 255\n")
    with pytest.raises(InputError, match="inks must be colours or a number"):
        options_of({"inks": str(tmp_path / "two.gpl")})


@pytest.mark.parametrize("use", USES)
def test_first_choices_set_options_of_the_page_that_go_together(use):
    options = form()["uses"][use]
    assert options.keys() <= {option["name"] for option in OPTIONS}
    assert options.items() <= options_of(options).flat().items()


@pytest.mark.parametrize("given", [CHANGED, OTHERS], ids=["most", "others"])
def test_the_command_is_read_back_as_the_same_options(given, monkeypatch):
    options = Options.from_flat(given)
    read = []
    monkeypatch.setattr(command, "_run", lambda photo, _, o, files: read.append((photo, o)) or 0)
    words = shlex.split(command_of("-my photo's.jpg", options))
    assert words[words.index("-o") + 1].endswith(".svgz") == bool(given.get("gzip"))
    main(words[1:])
    assert read[0][0] == "./-my photo's.jpg"
    assert read[0][1].flat() == options.flat()


@pytest.mark.parametrize("is_local", [True, False])
def test_the_page_says_where_photos_go(is_local):
    text = answer_of(create_app(is_local=is_local), "GET", "/").text
    assert ("Photos stay on this machine" in text) == is_local
    assert ("Photos go to this server only" in text) != is_local
    # Files that are refused may be chosen too, so that the page says why.
    assert {".png", ".tif", ".heic"} <= set(re.search('accept="([^"]+)"', text)[1].split(","))
