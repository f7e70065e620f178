"""The parts of a benchmark that need no run: its settings, its fronts, its store, its tables."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.batch.listing import ListedPhoto
from gauss2svg.compare.grid import Task, add_row, rows_in
from gauss2svg.compare.table import below
from gauss2svg.compare.variants import (
    AXES,
    Variant,
    apply_constants,
    options_in,
    parse_axes,
    settings_of,
)
from gauss2svg.errors import InputError
from gauss2svg.measure import SCORES
from gauss2svg.pipeline import limits
from gauss2svg.raster import DRAW_ROTATED_BLURS, RENDERERS

FULL = "pipeline.limits.FULL"


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


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("inks=3,6", (3, 6)),
        ("inks=#f7c306,#17324d", ("#f7c306,#17324d",)),
        ("inks=6;#fff,#000; f7c306,17324d", (6, "#ffffff,#000000", "#f7c306,#17324d")),
        ("max-size=64,32,64", (64, 32, 64)),
        ("gaussians=auto, 5", ("auto", 5)),
        (f"{FULL}=0.5,1", (0.5, 1.0)),
    ],
)
def test_values_of_an_axis_stand_between_commas_or_semicolons(text, values):
    ((name, parsed),) = parse_axes([text]).items()
    assert parsed == values
    assert {dict(s)[name] for s in settings_of({name: values})} == set(values)


@pytest.mark.parametrize(
    ("axes", "line"),
    [
        (["speed"], "axis must be an option: one of quality, gaussians"),
        (["gaussians"], "axis gaussians must be given with values; got none. Try --axis gaussians"),
        (["inks=6,#fff,#000"], "axis inks must be .*Try 6, or"),
        (["gaussians=many"], "axis gaussians must be .*; got 'many'"),
        ([f"{FULL}=x"], f"axis {FULL} must be a number in .*; got 'x'"),
        ([FULL], f"axis {FULL} must be given with values"),
        (["a.b=1"], "axis must be a number that a module has in capitals; got 'a.b'"),
        ({"loss": "mse"}, "axis loss must be a sequence; got 'mse'"),
        ({"loss": ()}, "axis loss must be given with values"),
        ({"loss": ["l3"]}, "axis loss must be one of mse"),
        ({"speed": [1]}, "axis must be an option: one of quality"),
        ({"form": ["linear-rgb"]}, "for form|axis form must be one of"),
    ],
)
def test_axes_that_no_run_could_have_are_refused_on_one_line(axes, line):
    with pytest.raises(InputError, match=f"^ax[ie]s:?.*{line.removeprefix('axis')}") as refusal:
        settings_of(axes if isinstance(axes, dict) else parse_axes(axes))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("renderer", RENDERERS)
@pytest.mark.parametrize("form", AXES["form"].choices)
def test_forms_that_a_renderer_does_not_support_are_refused_before_any_run(form, renderer):
    axes = parse_axes([f"form=gradient,{form}", f"renderer=chromium,{renderer}"])
    if form == "gradient" or renderer in DRAW_ROTATED_BLURS:
        assert settings_of(axes)
    else:
        with pytest.raises(InputError, match=f"for form {form}; got {renderer!r}"):
            settings_of(axes)


def test_a_constant_of_the_code_is_replaced_where_it_is_read(monkeypatch):
    (settings,) = settings_of({FULL: [0.5], "gaussians": [7]})
    assert options_in(dict(settings)) == {"gaussians": 7}
    monkeypatch.setattr(limits, "FULL", limits.FULL)
    apply_constants(dict(settings))
    assert limits.FULL == 0.5


def test_key_knows_all_that_changes_a_record_and_no_path():
    def key(path="a.png", digest="d", count=5, others=(0,), **variant):
        photo = ListedPhoto(path, path, path, "a", digest)
        made = None if count is None else Variant((("gaussians", count),), **variant)
        return Task(photo, made, {}, others, {}).key

    assert key() == key(path="b/c.png")
    changes = [{"digest": "e"}, {"count": 6}, {"count": None}, {"others": (1,)}]
    changes += [{"version": "0"}, {"tool": "jpeg"}]
    assert len({key(), *(key(**change) for change in changes)}) == len(changes) + 1


# Few values, so that equals are common.
rows = st.lists(
    st.fixed_dictionaries({name: st.integers(0, 6) for name in ("s", "b", "psnr_svg", "flip_svg")}),
    min_size=1,
    max_size=12,
)


@given(rows, st.sampled_from([score for score in SCORES if score.slug in ("psnr", "flip")]))
def test_distance_below_a_front_is_the_gain_at_no_more_cost(rows, score):
    for one in rows:
        both = below(one, rows, score, "s", "b")
        gains = [
            score.sign * (other[score.key] - one[score.key])
            for other in rows
            if other["s"] <= one["s"] and other["b"] <= one["b"]
        ]
        assert both == max(gains) >= 0
        # A second cost can only excuse.
        assert both <= min(below(one, rows, score, cost) for cost in ("s", "b"))
