"""The parts of a gallery that need no fit: names, variants, records."""

import json
import os
import re
import statistics
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.compare.pages.build import summary_of
from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.run import rounds_of
from gauss2svg.compare.variants import main_variant, variants_of
from gauss2svg.measure.scores import SCORES
from gauss2svg.pipeline.listing import listed_photos, slug_of

names = st.text(
    st.one_of(
        st.characters(codec="utf-8"), st.sampled_from("\udcff\ud800\u202e\u200f🙂/\\.:-x1 A\u0130")
    ),
    max_size=60,
)
DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?$", re.IGNORECASE)


@given(names)
@example("")
@example("../..")
@example("\u202e\u200f")
@example("COM\N{SUPERSCRIPT ONE}")
@example("nul")
@example("\udcff")
@example("🙂")
@example("K" * 300)
@example("-" * 300 + "x")
@example("x" * 47 + "-y")
def test_slug_is_a_safe_name_of_a_folder_on_any_system(name):
    slug = slug_of(name)
    assert re.fullmatch(r"[a-z0-9]([a-z0-9-]*[a-z0-9])?", slug)
    assert len(slug) <= 54
    assert not DEVICE.match(slug)


# Few names, so that they clash in every way, also with one that ends in a digest.
clashing = st.tuples(
    st.sampled_from(["", "a", "a/b"]), st.sampled_from(["x", "X", "x.", "y", "x-2", "con", "é"])
).map("/none/".join)
listed = st.lists(clashing, min_size=1, max_size=12, unique=True)


@given(listed, st.randoms(use_true_random=False))
def test_slugs_are_unique_and_do_not_depend_on_the_order(paths, random):
    slugs = {photo.path: photo.slug for photo in listed_photos(paths)}
    assert len(set(slugs.values())) == len(paths)
    assert all(re.fullmatch("[a-z0-9-]+", slug) for slug in slugs.values())
    mixed = listed_photos(random.sample(paths, len(paths)))
    assert {photo.path: photo.slug for photo in mixed} == slugs


@given(listed, clashing)
def test_photo_of_another_name_moves_no_other(paths, added):
    if slug_of(Path(added).stem) not in {slug_of(Path(path).stem) for path in paths}:
        slugs = [photo.slug for photo in listed_photos(paths)]
        assert [photo.slug for photo in listed_photos([added, *paths])][1:] == slugs


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.posix
def test_photo_named_twice_is_one_where_it_is_named_first(tmp_path, monkeypatch):
    one, other = write(tmp_path / "one.png", "1"), write(tmp_path / "other.png", "2")
    link = tmp_path / "link.png"
    link.symlink_to(one)
    monkeypatch.chdir(tmp_path)
    found = listed_photos(["one.png", other, link, os.fsencode(one), f"{tmp_path}/./one.png"])
    assert [photo.path for photo in found] == ["one.png", str(other)]
    assert [photo.name for photo in found] == ["one.png", "other.png"]


@given(st.sets(st.lists(st.sampled_from("ab"), max_size=3).map(tuple), min_size=1))
def test_name_of_a_photo_is_the_shortest_end_of_its_path_that_no_other_has(folders):
    root = Path.cwd().anchor.replace(os.sep, "/")
    paths = [root + "/".join([*folder, "x"]) for folder in folders]
    found = {photo.path: photo.name for photo in listed_photos(paths)}
    assert len(set(found.values())) == len(found) == len(paths)
    for path, name in found.items():
        assert path.endswith(name)
        shorter = name.partition("/")[2]
        assert not shorter or any(o.endswith(f"/{shorter}") for o in paths if o != path)


def test_photos_of_one_name_keep_their_slugs_when_their_pixels_change(tmp_path):
    paths = [write(tmp_path / f / "x.png", text) for f, text in (("a", "1"), ("b", "2"))]
    slugs = [photo.slug for photo in listed_photos(paths)]
    assert all(re.fullmatch("x-[0-9a-f]{12}", slug) for slug in slugs)
    paths[0].write_text("3")
    assert [photo.slug for photo in listed_photos(paths)] == slugs


def test_a_photo_that_cannot_be_read_renames_no_other(tmp_path):
    path = write(tmp_path / "a" / "x.png", "1")
    (alone,) = listed_photos([path])
    both = listed_photos([path, tmp_path / "b" / "x.png"])
    assert both[0].slug == alone.slug == "x"
    assert both[1].problem
    assert both[1].slug != "x"


def test_a_file_that_is_named_like_another_photos_slug_has_a_slug_of_its_own(tmp_path):
    paths = [write(tmp_path / folder / "x.png", folder) for folder in "ab"]
    like = write(tmp_path / "c" / f"{listed_photos(paths)[0].slug}.png", "c")
    assert len({photo.slug for photo in listed_photos([*paths, like])}) == 3


@given(st.lists(names.filter(lambda name: "/" not in name), min_size=1, max_size=4))
def test_names_are_one_printable_line_and_a_missing_file_is_a_problem(given_names):
    for photo in listed_photos([f"/none/{name}" for name in given_names]):
        assert photo.name.isprintable()
        assert photo.name
        assert photo.digest is None
        assert "Try the path of a photo" in photo.problem
        assert photo.problem.isprintable()


def test_variants_are_presets_counts_and_peers_each_once():
    found, absent = variants_of(["high", "draft", "high"], [2000, 1, np.int64(0), 2000])
    assert absent == []
    assert [(variant.name, variant.slug) for variant in found] == [
        ("high", "high"), ("draft", "draft"), ("2000 Gaussians", "gaussians-2000"),
        ("1 Gaussian", "gaussians-1"), ("0 Gaussians", "gaussians-0"),
    ]  # fmt: skip
    assert json.loads(json.dumps([one.settings for one in found[::2]])) == [
        [["quality", "high"]], [["gaussians", 2000]], [["gaussians", 0]],
    ]  # fmt: skip
    assert [variant.name for variant in variants_of()[0]] == ["draft", "balanced", "high"]
    counts = variants_of(counts=np.array([5, 6]))[0]
    assert [variant.name for variant in counts] == ["5 Gaussians", "6 Gaussians"]


@pytest.mark.posix
def test_styles_of_a_peer_are_variants_of_their_own(monkeypatch, tmp_path):
    fake = write(tmp_path / "primitive", "")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    found, _ = variants_of([], peers=["primitive", "primitive:500", "primitive:100"])
    assert [(one.name, one.slug) for one in found] == [
        ("primitive 100", "primitive-100"),
        ("primitive 500", "primitive-500"),
    ]
    assert all(one.version and not one.is_own for one in found)
    assert {dict(one.settings)["shapes"] for one in found} == {
        style["shapes"] for style in PEERS["primitive"].settings
    }
    assert main_variant(found).name == "primitive 500"
    assert main_variant([*found, *variants_of(counts=[5])[0]]).name == "5 Gaussians"
    assert main_variant([*found, *variants_of(["max", "balanced"])[0]]).name == "balanced"


def row_of(variant, **values):
    usual = dict.fromkeys(
        ("gaussians", "svg_bytes", "svgz_bytes", "total_s", *(a.key for a in SCORES)), 1
    )
    return {"variant": variant.name, **usual, **values}


def test_summary_is_medians_and_sums_of_what_has_a_number():
    own, other, unmade = variants_of(counts=[1, 2, 3])[0]
    rows = [
        row_of(own, psnr_svg=psnr, svg_bytes=count, total_s=count / 8, gaussians=None)
        for psnr, count in ((30.0, 10), (None, 11), (20.0, 13), (31.0, 90))
    ]
    rows += [row_of(other, psnr_svg=None, gaussians=count) for count in (0, 4)]
    first, second = summary_of(rows, [own, other, unmade])
    assert (first["variant"], first["photos"], second["photos"]) == (own.name, 4, 2)
    assert first["median_psnr_svg"] == statistics.median([30.0, 20.0, 31.0]) == 30.0
    assert first["median_svg_bytes"] == statistics.median([10, 11, 13, 90]) == 12
    assert (first["total_svg_bytes"], first["total_total_s"]) == (124, 15.5)
    assert first["median_gaussians"] is None
    assert (second["median_psnr_svg"], second["median_gaussians"]) == (None, 2)


def test_rounds_are_counted_up_to_each():
    shape = '<circle r="1"/>'
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg"><rect/>'
        f'<g id="round-1">{shape * 2}</g><g id="layer"/><g id="round-2"><g>{shape * 3}</g></g>'
        "</svg>"
    )
    assert rounds_of(svg) == [[1, 2], [2, 5]]
