"""The parts of a benchmark that need no run: its grid, its fronts, its store, its tables."""

import csv
import json
import math

import numpy as np
import pytest
from flat import BESIDE
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.compare import table
from gauss2svg.compare.grid import Task
from gauss2svg.compare.records import add_row, csv_text, rows_in
from gauss2svg.compare.table import distance_below, front
from gauss2svg.compare.variants import (
    AXES,
    DEFAULT_GRID,
    Variant,
    apply_constants,
    options_in,
    parse_axes,
    settings_of,
)
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline.listing import ListedPhoto
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.pipeline.search import correction
from gauss2svg.raster import DRAW_ROTATED_BLURS, RENDERERS

points = st.lists(
    st.tuples(*[st.integers(0, 6).map(float)] * 3), min_size=1, max_size=12
)  # few values, so that equals are common


def test_later_row_of_a_key_counts_and_damaged_lines_do_not(tmp_path):
    path = tmp_path / "rows.jsonl"
    first, last = {"key": "a", "error": "x"}, {"key": "a", "n": 2}
    lines = [json.dumps(first), "rubbish", "[1]", json.dumps(last), '{"n": 3}', '{"k']
    path.write_text("\n".join(lines))
    assert rows_in(path) == {"a": last}
    add_row(path, first | {"key": "b"})  # after half a line
    add_row(path, last | {"n": 4})
    assert rows_in(path) == {"a": last | {"n": 4}, "b": first | {"key": "b"}}
    assert path.read_text().count("\n") == len(lines) + 2
    assert rows_in(tmp_path / "none") == {}
    with pytest.raises(OutputError, match="cannot read"):
        rows_in(tmp_path)


def test_default_grid_is_the_presets_and_counts_by_iterations():
    settings = [dict(s) for s in settings_of(None)]
    assert [s["quality"] for s in settings if s.keys() == {"quality"}] == list(PRESETS)
    crossed = [s for s in settings if s.keys() == {"gaussians", "iterations"}]
    assert len(crossed) == math.prod(map(len, DEFAULT_GRID[1].values()))
    assert len(settings) == len(crossed) + len(PRESETS)


WITHOUT_VALUES = {"time_limit", "matte", "inks"}
# Axes that are valid only beside another option.
WITH = {name: {k: (v,) for k, v in beside.items()} for name, beside in BESIDE.items()}


@pytest.mark.parametrize("name", sorted(AXES.keys() - WITHOUT_VALUES))
def test_default_values_of_an_axis_are_values_of_it(name):
    values = parse_axes([name])[name]
    assert parse_axes([f"{name}={','.join(map(str, values))}"]) == {name: values}
    found = [dict(s) for s in settings_of({name: values} | WITH.get(name, {}))]
    assert [settings[name] for settings in found] == list(values)
    if name not in WITH:
        assert all(settings.keys() == {name} for settings in found)


@pytest.mark.parametrize("name", sorted(WITHOUT_VALUES))
def test_axis_without_default_values_is_refused_unless_they_are_given(name):
    with pytest.raises(InputError, match=f"axis {name} must be given with values.*Try --axis"):
        parse_axes([name])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("3,6", (3, 6)),
        ("#f7c306,#17324d", ("#f7c306,#17324d",)),
        ("6;#fff,#000; f7c306,17324d", (6, "#ffffff,#000000", "#f7c306,#17324d")),
    ],
)
def test_a_list_of_inks_is_one_value_of_their_axis(text, values):
    assert parse_axes([f"inks={text}"]) == {"inks": values}
    assert [dict(s)["inks"] for s in settings_of({"inks": values})] == list(values)


@pytest.mark.parametrize("text", ["6,#fff,#000", "#fff", "6;#fff", "#fff,blue", "6;"])
def test_values_that_are_no_inks_are_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"^axis inks must be .*Try 6, or") as refusal:
        parse_axes([f"inks={text}"])
    assert "\n" not in str(refusal.value)


def test_axes_span_their_product_whatever_their_order():
    axes = parse_axes(["max-size=64,32,64", "gaussians=auto,5"])
    found = settings_of(axes)
    assert len(found) == 4
    assert set(found) == set(settings_of(dict(reversed(axes.items()))))
    assert (("gaussians", "auto"), ("max_size", 32)) in found
    assert settings_of({"palette": list(np.array([8, 16]))}) == [
        (("palette", 8),),
        (("palette", 16),),
    ]
    for bad in ({"loss": "mse"}, {"loss": ()}, {"loss": ["l3"]}, {"speed": [1]}):
        with pytest.raises(InputError):
            settings_of(bad)


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("form", AXES["form"].choices)
def test_forms_that_a_renderer_does_not_support_are_refused_before_any_run(form, renderer):
    axes = parse_axes([f"form=gradient,{form}", f"renderer=chromium,{renderer}"])
    if form == "gradient" or renderer in DRAW_ROTATED_BLURS:
        assert settings_of(axes)
    else:
        with pytest.raises(InputError, match=f"form must be gradient with the renderer {renderer}"):
            settings_of(axes)
    if form != "gradient":
        with pytest.raises(InputError, match="with the renderer resvg"):
            settings_of({"form": [form]})


def test_key_knows_all_that_changes_a_record_and_no_path():
    def key(path="a.png", digest="d", count=5, others=(0,), **variant):
        photo = ListedPhoto(path, path, path, "a", digest)
        return Task(photo, Variant((("gaussians", count),), **variant), others).key

    assert key() == key(path="b/c.png")
    changes = ({"digest": "e"}, {"count": 6}, {"others": (1,)}, {"version": "0"}, {"tool": "jpeg"})
    others = [key(**change) for change in changes]  # pyright: ignore[reportArgumentType]
    others.append(Task(ListedPhoto("a.png", "a.png", "a.png", "a", "d"), None, (0,)).key)
    assert len({key(), *others}) == len(changes) + 2


def test_other_tools_are_kept_whatever_the_seed_and_the_threads():
    def key(variant, seed, threads):
        photo = ListedPhoto("a.png", "a.png", "a.png", "a", "d")
        return table._task(photo, variant, seed, threads, ()).key

    peer, own = Variant((("quality", 30),), tool="jpeg"), Variant((("gaussians", 5),))
    assert key(peer, 0, None) == key(peer, 3, 1)
    assert len({key(own, 0, None), key(own, 3, None), key(own, 0, 1)}) == 3


@given(points)
def test_front_is_what_nothing_beats(rows):
    psnr, cost, _ = zip(*rows, strict=True)
    on = front(psnr, cost)
    for i in range(len(rows)):
        beaten = any(
            psnr[j] >= psnr[i] and cost[j] <= cost[i] and (psnr[j], cost[j]) != (psnr[i], cost[i])
            for j in range(len(rows))
        )
        assert beaten != any((psnr[i], cost[i]) == (psnr[j], cost[j]) for j in on)
    assert [cost[i] for i in on] == sorted({cost[i] for i in on})
    assert [psnr[i] for i in on] == sorted({psnr[i] for i in on})


@given(points)
def test_distance_below_a_front_is_the_gain_at_no_more_cost(rows):
    psnr, seconds, size = zip(*rows, strict=True)
    both = distance_below(psnr, seconds, size)
    for i, own in enumerate(rows):
        gains = [p - own[0] for p, a, b in rows if a <= own[1] and b <= own[2]]
        assert both[i] == max(gains) >= 0
        # A second cost can only excuse.
        assert both[i] <= min(distance_below(psnr, c)[i] for c in (seconds, size))
    assert all(distance_below(psnr, seconds)[i] == 0 for i in front(psnr, seconds))
    assert distance_below(psnr[::-1], seconds[::-1], size[::-1]) == both[::-1]


def test_csv_has_a_column_for_every_name():
    text = csv_text([{"a": 1, "b": {"c": None}}, {"a": 'x,"\n', "d": 2.5}])
    assert list(csv.reader(text.splitlines(keepends=True))) == [
        ["a", "b.c", "d"], ["1", "", ""], ['x,"\n', "", "2.5"],
    ]  # fmt: skip


FULL = "pipeline.search.correction.FULL"


def test_a_constant_of_the_code_is_an_axis_and_is_replaced_where_it_is_read(monkeypatch):
    assert parse_axes([f"{FULL}=0.5,1"]) == {FULL: (0.5, 1.0)}
    (settings,) = settings_of({FULL: [0.5], "gaussians": [7]})
    assert options_in(dict(settings)) == {"gaussians": 7}
    monkeypatch.setattr(correction, "FULL", correction.FULL)
    apply_constants(dict(settings))
    assert correction.FULL == 0.5


@pytest.mark.parametrize(
    "text", [f"{FULL}=x", f"{FULL}=nan", "pipeline.search.correction.FEW=1.5", FULL, "a.b=1",
             "pipeline.plan.b=1", "pipeline.options.b=1"],
)  # fmt: skip
def test_an_unknown_constant_and_a_value_that_it_cannot_have_are_refused(text):
    with pytest.raises(InputError):
        parse_axes([text])
