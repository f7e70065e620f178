"""The parts of a gallery that need no fit: names, variants, crops, charts, numbers, records."""

import hashlib
import json
import math
import os
import re
import statistics
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gauss2svg.bench.peers import PEERS
from gauss2svg.errors import InputError, OutputError
from gauss2svg.gallery import numbers
from gauss2svg.gallery.chart import HEIGHT, WIDTH, Point, scatter
from gauss2svg.gallery.crops import worst_and_typical
from gauss2svg.gallery.pages import is_gallery, shown_title
from gauss2svg.gallery.photos import gallery_photos, slug_of, unique_slugs
from gauss2svg.gallery.records import made_of, summary_of
from gauss2svg.gallery.variants import DEFAULT_VARIANTS, main_variant, variants_of
from gauss2svg.gallery.work import finished, rounds_of

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


# Few names and digests, so that they clash in every way, also with a name that ends in a digest.
clashing = st.tuples(
    st.sampled_from(["x", "X", "x.", "y", "x-aaaaaaaa", "x-2", "con", ""]),
    st.sampled_from(["a" * 64, "b" * 64, "a" * 8 + "c" * 56]) | st.none(),
)


@given(st.lists(clashing, max_size=12))
def test_slugs_are_unique(photos):
    slugs = unique_slugs(photos)
    assert len(set(slugs)) == len(slugs) == len(photos)
    assert all(re.fullmatch("[a-z0-9-]+", slug) for slug in slugs)


different = st.lists(
    st.tuples(names, st.binary().map(lambda data: hashlib.sha256(data).hexdigest())),
    max_size=8,
    unique_by=(lambda photo: (slug_of(photo[0]), photo[1])),
)


@given(different, st.randoms(use_true_random=False))
def test_slugs_do_not_depend_on_the_order(photos, random):
    slugs = dict(zip(photos, unique_slugs(photos), strict=True))
    mixed = random.sample(photos, len(photos))
    assert dict(zip(mixed, unique_slugs(mixed), strict=True)) == slugs


@given(different, names, st.booleans())
def test_photo_of_another_name_and_one_that_cannot_be_read_move_no_other(photos, name, readable):
    slugs = unique_slugs(photos)
    if readable and slug_of(name) in {slug_of(other) for other, _ in photos}:
        return
    added = (name, "f" * 64 if readable else None)
    assert unique_slugs([added, *photos])[1:] == slugs


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


def test_photo_named_twice_is_one_where_it_is_named_first(tmp_path, monkeypatch):
    one, other = write(tmp_path / "one.png", "1"), write(tmp_path / "other.png", "2")
    link = tmp_path / "link.png"
    link.symlink_to(one)
    monkeypatch.chdir(tmp_path)
    found = gallery_photos(["one.png", other, link, os.fsencode(one), f"{tmp_path}/./one.png"])
    assert [photo.path for photo in found] == ["one.png", str(other)]
    assert [photo.name for photo in found] == ["one.png", "other.png"]


def test_photos_of_one_name_are_told_apart_by_what_is_in_them(tmp_path):
    paths = [write(tmp_path / f / "x.png", text) for f, text in (("a", "1"), ("b", "2"))]
    slugs = [photo.slug for photo in gallery_photos(paths)]
    assert [photo.slug for photo in gallery_photos(paths[::-1])] == slugs[::-1]
    assert [photo.slug for photo in gallery_photos([tmp_path / "x.jpg", *paths])[1:]] == slugs
    assert all(re.fullmatch("x-[0-9a-f]{8}", slug) for slug in slugs)


@given(st.lists(names.filter(lambda name: "/" not in name), min_size=1, max_size=4))
def test_names_are_one_printable_line_and_what_is_not_there_is_told_so(given_names):
    for photo in gallery_photos([f"/none/{name}" for name in given_names]):
        assert photo.name.isprintable()
        assert photo.name
        assert photo.digest is None
        assert "give the path of a photo" in photo.trouble
        assert photo.trouble.isprintable()


@pytest.mark.parametrize("bad", ["x.png", b"x.png", os, 5, None, [], (), [None], [1.5]])
def test_photos_that_are_no_paths_are_refused(bad, tmp_path):
    with pytest.raises(InputError, match=r"^(photos (is|are) |got no photo)"):
        gallery_photos(bad)
    with pytest.raises(InputError, match=r"needed is a sequence of paths: \["):
        gallery_photos(tmp_path)


def test_variants_are_told_by_presets_counts_and_peers_each_once():
    found, absent = variants_of(["high", "draft", "high"], [2000, 1, np.int64(0), 2000])
    assert absent == []
    assert [variant.name for variant in found] == [
        "high", "draft", "2000 Gaussians", "1 Gaussian", "0 Gaussians",
    ]  # fmt: skip
    assert [variant.slug for variant in found[2:]] == [
        "gaussians-2000",
        "gaussians-1",
        "gaussians-0",
    ]
    assert found[0].settings == (("quality", "high"),)
    assert found[2].settings == (("gaussians", 2000),)
    json.dumps([variant.settings for variant in found])
    assert tuple(variant.name for variant in variants_of()[0]) == DEFAULT_VARIANTS
    assert [variant.name for variant in variants_of(counts=(5,))[0]] == ["5 Gaussians"]
    assert [variant.name for variant in variants_of(counts=np.array([5, 6]))[0]] == [
        "5 Gaussians",
        "6 Gaussians",
    ]


@pytest.mark.parametrize(
    ("given_variants", "message"),
    [
        ({"presets": ["quick"]}, "variant is 'quick'; needed is one of draft, fast, balanced"),
        ({"presets": [["draft"]]}, r"variant is \['draft'\]"),
        ({"presets": "draft"}, r"variants is 'draft'; needed is a sequence, such as \['draft'\]"),
        ({"presets": []}, "got no variant"),
        ({"counts": []}, "got no variant"),
        ({"counts": 5}, "counts is 5; needed is a sequence"),
        ({"counts": "500"}, "counts is '500'"),
        ({"counts": [-1]}, "count is -1; needed is a whole number in 0"),
        ({"counts": [2.5]}, "count is 2.5"),
        ({"counts": [True]}, "count is True"),
        ({"counts": [10**9]}, "count is 1000000000"),
        ({"peers": ["jpeg"]}, "peer is 'jpeg'; needed is one of vtracer, splatthis, primitive"),
        ({"peers": ["vtracer:"]}, "peer is 'vtracer:'; needed is vtracer, or one of vtracer:def"),
        ({"peers": ["vtracer:fine"]}, "peer is 'vtracer:fine'"),
        ({"peers": [None]}, "peer is None"),
    ],
)
def test_variants_that_are_none_are_refused_on_one_line(given_variants, message):
    with pytest.raises(InputError, match=message) as told:
        variants_of(**given_variants)
    assert "\n" not in str(told.value)


def test_absent_peer_is_left_out_and_refused_where_it_is_all(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    found, absent = variants_of(["draft"], peers=["primitive", "primitive:500"])
    assert ([variant.name for variant in found], absent) == (["draft"], ["primitive"])
    with pytest.raises(InputError, match="got no variant; not installed: primitive"):
        variants_of([], peers=["primitive"])


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


def windows(image, other, side):
    """Mean squared error of every window, one by one."""
    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    return {
        (x, y): np.mean(
            (image[y : y + down, x : x + across] - other[y : y + down, x : x + across]) ** 2
        )
        for y in range(height - down + 1)
        for x in range(width - across + 1)
    }, (across, down)


def centred(corner, errors):
    return (corner[0] - max(x for x, _ in errors) / 2) ** 2 + (
        corner[1] - max(y for _, y in errors) / 2
    ) ** 2


@given(
    st.integers(1, 14), st.integers(1, 14), st.integers(1, 6), st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.7, 0.97]),
)  # fmt: skip
@example(1, 1, 6, 0, 0.0)
@example(14, 3, 5, 1, 0.0)
def test_crops_are_those_that_a_search_of_all_windows_finds(height, width, side, seed, equal):
    rng = np.random.default_rng(seed)
    image, other = np.round(rng.random((2, height, width, 3)) * 255).astype(np.float32) / 255
    same = rng.random((height, width)) < equal
    other[same] = image[same]
    errors, size = windows(image.astype(np.float64), other.astype(np.float64), side)
    worst, typical = worst_and_typical(image, other, side)
    for crop in (worst, typical):
        assert (crop.width, crop.height) == size
        error = errors[crop.x, crop.y]
        assert crop.psnr == (pytest.approx(-10 * math.log10(error)) if error else math.inf)
    assert errors[worst.x, worst.y] == pytest.approx(max(errors.values()), abs=1e-12)
    median = statistics.median(errors.values())
    off = {corner: abs(error - median) for corner, error in errors.items()}
    assert off[typical.x, typical.y] == pytest.approx(min(off.values()), abs=2e-12)
    nearest = [centred(corner, errors) for corner in off if off[corner] <= min(off.values())]
    assert centred((typical.x, typical.y), errors) <= min(nearest) + 1e-9


def test_equal_pictures_have_crops_of_no_error_in_the_middle():
    image = np.random.default_rng(0).random((21, 31, 3), np.float32)
    for crop in worst_and_typical(image, image, 11)[1:]:
        assert crop == (10, 5, 11, 11, math.inf)
    other = image.copy()
    other[:4, :4] = 1 - image[:4, :4]  # which reaches few windows
    worst, typical = worst_and_typical(image, other, 11)
    assert (worst.x, worst.y) == (0, 0)
    assert typical == (10, 5, 11, 11, math.inf)


points = st.lists(
    st.builds(
        Point,
        cost=st.floats(1e-2, 1e7) | st.sampled_from([1.27, 3.0, 3.0, 7.0]),
        psnr=st.none() | st.floats(-5, 120) | st.sampled_from([30.0, 35.0]),
        series=st.integers(0, 3),
        group=st.none() | st.integers(0, 2),
        href=st.just("#"),
        text=st.just(""),
    ),
    min_size=1,
    max_size=10,
)


@given(points)
@example([Point(1.27, 30.0, 0, None, "", "")])
@example([Point(7.0, None, 0, 0, "", "")] * 2)
@example([Point(1.0, 30.0, 0, 0, "", ""), Point(1.0, 30.0, 1, 0, "", "")])
def test_points_and_ticks_lie_in_the_frame_in_their_order(given_points):
    chart = scatter(given_points, lambda cost: f"{cost:g}")
    assert (chart.width, chart.height) == (WIDTH, HEIGHT)
    assert [placed.point for placed in chart.points] == given_points
    for placed in chart.points:
        assert chart.left < placed.x < chart.right
        assert chart.top <= placed.y <= chart.bottom
        assert (placed.y == chart.equal_y) == (placed.point.psnr is None)
    assert (chart.equal_y is None) == all(point.psnr is not None for point in given_points)
    by_cost = sorted(chart.points, key=lambda placed: placed.point.cost)
    assert all(one.x <= other.x for one, other in pairwise(by_cost))
    finite = sorted(
        (placed for placed in chart.points if placed.point.psnr is not None),
        key=lambda placed: placed.point.psnr,
    )
    assert all(one.y >= other.y for one, other in pairwise(finite))
    if chart.equal_y is not None:
        assert all(placed.y > chart.equal_y for placed in finite)

    assert chart.x_ticks
    assert len(chart.x_ticks) < 12
    places = [x for x, _ in chart.x_ticks]
    assert places == sorted(set(places))
    assert all(chart.left <= x <= chart.right for x in places)
    assert 2 <= len(chart.y_ticks) <= 9
    assert all(chart.top <= y <= chart.bottom for y, _ in chart.y_ticks)
    levels = [float(text) for _, text in chart.y_ticks]
    assert levels == sorted(set(levels))
    for placed in finite:
        assert levels[0] <= placed.point.psnr <= levels[-1]


@given(points)
def test_points_of_a_group_are_joined_in_their_order(given_points):
    chart = scatter(given_points, str)
    joined = [[tuple(map(float, pair.split(","))) for pair in line.split()] for line in chart.lines]
    groups = {}
    for placed in chart.points:
        if placed.point.group is not None:
            groups.setdefault(placed.point.group, []).append((placed.x, placed.y))
    assert joined == list(groups.values())


def test_point_lies_at_the_tick_of_its_value():
    given_points = [Point(cost, psnr, 0, None, "", "") for cost, psnr in ((10, 30), (1000, 36))]
    chart = scatter(given_points, lambda cost: f"{cost:g}")
    by_text = {text: x for x, text in chart.x_ticks}
    assert [placed.x for placed in chart.points] == [by_text["10"], by_text["1000"]]
    by_text = {text: y for y, text in chart.y_ticks}
    assert [placed.y for placed in chart.points] == [by_text["30"], by_text["36"]]
    assert scatter([], str) is None


NOTHING = "\N{EN DASH}"
NARROW = "\N{NARROW NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("tell", "value", "text"),
    [
        (numbers.size, 0, "0 B"), (numbers.size, 999, "999 B"), (numbers.size, 999.4, "999 B"),
        (numbers.size, 999.5, "1.00 kB"), (numbers.size, 1000, "1.00 kB"),
        (numbers.size, 9994, "9.99 kB"), (numbers.size, 9995, "10.0 kB"),
        (numbers.size, 58_345, "58.3 kB"), (numbers.size, 99_949, "99.9 kB"),
        (numbers.size, 99_950, "100 kB"), (numbers.size, 999_499, "999 kB"),
        (numbers.size, 999_500, "1.00 MB"), (numbers.size, 1_680_000, "1.68 MB"),
        (numbers.size, 1.5e9, "1 500 MB"), (numbers.size, None, NOTHING),
        (numbers.seconds, 0.844, "0.84 s"), (numbers.seconds, 9.994, "9.99 s"),
        (numbers.seconds, 9.995, "10.0 s"), (numbers.seconds, 99.94, "99.9 s"),
        (numbers.seconds, 99.95, "100 s"), (numbers.seconds, 401.4, "401 s"),
        (numbers.seconds, 12_345.6, "12 346 s"), (numbers.seconds, None, NOTHING),
        (numbers.decibels, 31.416, "31.42 dB"), (numbers.decibels, None, "equal"),
        (numbers.ratio, 1.0, "1.000"), (numbers.ratio, 0.6666, "0.667"),
        (numbers.ratio, None, NOTHING),
        (numbers.whole, 0, "0"), (numbers.whole, 1_234_567, "1 234 567"),
        (numbers.whole, None, NOTHING),
        (numbers.short_size, 500, "500 B"), (numbers.short_size, 5e4, "50 kB"),
        (numbers.short_size, 2e6, "2 MB"), (numbers.short_size, 0.5, "0.5 B"),
        (numbers.short_seconds, 0.5, "0.5 s"), (numbers.short_seconds, 20.0, "20 s"),
    ],
)  # fmt: skip
def test_numbers_are_told_so(tell, value, text):
    assert tell(value).replace(NARROW, " ") == text
    assert " " not in tell(value)  # they are not broken in two


@given(st.floats(1, 1e9))
def test_sizes_have_three_digits_and_are_true_to_them(count):
    text, unit = numbers.size(count).split(NARROW)[-2:]
    value = float("".join(numbers.size(count).split(NARROW)[:-1]))
    assert value * {"B": 1, "kB": 1e3, "MB": 1e6}[unit] == pytest.approx(
        count, rel=0.00501, abs=0.5
    )
    if count >= 1000:
        assert len(text.replace(".", "")) == 3


def row_of(variant, **values):
    usual = dict.fromkeys(
        ("gaussians", "svg_bytes", "svgz_bytes", "total_s", "psnr_svg", "ssim_svg"), 1
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


def folder_of(path, files):
    path.mkdir(exist_ok=True)
    for name, text in files.items():
        (path / name).write_text(text)
    record = {"key": "k", "files": {name: len(text) for name, text in files.items()}}
    (path / "record.json").write_text(json.dumps(record))
    return record


def test_folder_counts_as_finished_only_where_it_is_whole_and_of_the_key(tmp_path):
    record = folder_of(tmp_path, {"a": "1234", "b": ""})
    assert finished(tmp_path, "k") == record
    assert finished(tmp_path, "other") is None
    assert finished(tmp_path / "none", "k") is None
    text = (tmp_path / "record.json").read_text()
    for damaged in (text[:-1], text[:5], "", "[]", "null", "5", "{}", '{"key": "k"}', "\x00"):
        (tmp_path / "record.json").write_text(damaged)
        assert finished(tmp_path, "k") is None, damaged
    for name, content in (("a", "123"), ("a", "12345"), ("b", "x")):
        folder_of(tmp_path, {"a": "1234", "b": ""})
        (tmp_path / name).write_text(content)
        assert finished(tmp_path, "k") is None
    folder_of(tmp_path, {"a": "1234", "b": ""})
    (tmp_path / "b").unlink()
    assert finished(tmp_path, "k") is None


def test_report_that_cannot_be_read_is_told_with_what_to_do(tmp_path):
    (variant,) = variants_of(counts=[5])[0]
    with pytest.raises(OutputError, match=r"cannot read .*; delete its folder"):
        made_of(tmp_path, "x", variant, {})


def test_rounds_are_counted_up_to_each():
    shape = '<circle r="1"/>'
    svg = (
        '<svg xmlns="http://www.w3.org/2000/svg"><rect/>'
        f'<g id="round-1">{shape * 2}</g><g id="layer"/><g id="round-2"><g>{shape * 3}</g></g>'
        "</svg>"
    )
    assert rounds_of(svg) == [[1, 2], [2, 5]]


def test_gallery_is_known_by_its_data(tmp_path):
    path = tmp_path / "gallery.json"
    assert not is_gallery(path)
    for text in ("", "[]", "{}", "\udcff", '{"gauss2svg": "0", "rows": []}'):
        path.write_text(text, errors="surrogateescape")
        assert not is_gallery(path)
    path.write_text('{"gauss2svg": "0", "rows": [], "failures": []}')
    assert is_gallery(path)


def test_title_is_any_text_and_nothing_else():
    assert shown_title("<b>\N{ZERO WIDTH JOINER}{{") == "<b>\N{ZERO WIDTH JOINER}{{"
    assert shown_title("\udcff") == "\\udcff"
    for bad in ("", "  ", None, 5, b"x"):
        with pytest.raises(InputError, match="title is"):
            shown_title(bad)
