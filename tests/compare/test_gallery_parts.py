"""The parts of a gallery that need no fit: names, variants, records."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.batch.listing import listed_photos, slug_of
from gauss2svg.compare.variants import variants_of

names = st.text(
    st.one_of(
        st.characters(codec="utf-8"), st.sampled_from("\udcff\ud800\u202e\u200f🙂/\\.:-x1 A\u0130")
    ),
    max_size=60,
)
DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?$", re.IGNORECASE)


@given(names)
@example("")
@example("COM\N{SUPERSCRIPT ONE}")
@example("nul")
@example("K" * 300)
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


def test_variants_are_presets_counts_and_peers_each_once():
    found, absent = variants_of(["high", "draft", "high"], [2000, 1, np.int64(0), 2000])
    assert absent == []
    assert [(variant.name, variant.slug) for variant in found] == [
        ("high", "high"), ("draft", "draft"), ("2000 Gaussians", "gaussians-2000"),
        ("1 Gaussian", "gaussians-1"), ("0 Gaussians", "gaussians-0"),
    ]  # fmt: skip
    assert [variant.name for variant in variants_of()[0]] == ["draft", "balanced", "high"]
