"""Options: one class each group, from which the call, the command, axes and report are derived."""

import json
import math

import numpy as np
import pytest

import gauss2svg
from gauss2svg.compare.pages import GalleryOptions
from gauss2svg.errors import InputError, RendererError
from gauss2svg.fit import FitOptions
from gauss2svg.options import fields_of
from gauss2svg.pipeline.options import GROUPS, Goal, Options, SvgOptions
from gauss2svg.pipeline.plan import Plan
from gauss2svg.svg import SvgFormat

ALL_GROUPS = [*GROUPS.values(), GalleryOptions, SvgFormat]
ALL_FIELDS = [
    pytest.param(group, field, id=f"{group.__name__}.{field.name}")
    for group in ALL_GROUPS
    for field in fields_of(group)
]
WRONG = (object(), [], b"7", (), {"a": 1}, complex(1, 2), float("nan"))


def valid(field) -> list:
    """Some values that an option takes, with what is stored."""
    found = [(one, one) for one in field.choices]
    found += [(np.int16(one), one) for one in field.words if isinstance(one, int)]
    if field.kind is int:
        least = max(field.least, 1)
        found += [(least, least), (field.most, field.most), (np.int64(least), least)]
        found += [("auto", None)] if field.words else []
    if field.kind is float:
        found += [(np.float32(field.most), float(np.float32(field.most))), (field.most, field.most)]
    return found


def beyond(field) -> list:
    """Values of the right type that an option does not take."""
    if field.kind is bool:
        return [1, 0.0, "no"]
    if field.kind is int:
        return [field.least - 1, field.most + 1, field.least + 0.5, True]
    if field.kind is float:
        below = math.nextafter(field.least, -math.inf)
        return [below, -math.inf, math.inf, math.nextafter(field.most, math.inf), True]
    return ["bogus"] if field.choices else []


@pytest.mark.parametrize(("group", "field"), ALL_FIELDS)
def test_an_option_stores_plain_values_and_refuses_others_by_its_name(group, field):
    for value, stored in valid(field):
        got = getattr(group(**{field.name: value}), field.name)
        assert got == stored or np.float32(got) == np.float32(stored)
        assert type(got) in (bool, int, float, str, type(None))
    for wrong in (*WRONG, *beyond(field)):
        with pytest.raises(InputError) as refusal:
            group(**{field.name: wrong})
        text = str(refusal.value)
        assert text.startswith(f"{field.name} must be ")
        assert "; got " in text
        assert "\n" not in text


def test_flat_options_come_back_and_fit_into_json():
    options = Options.from_flat({"gaussians": 30, "loss": "l1", "animate": 1.5, "gzip": True})
    again = Options.from_flat(json.loads(json.dumps(options.flat())))
    assert (again, hash(again)) == (options, hash(options))
    assert options.changed(title="b", gaussians=5).flat() == {
        **options.flat(), "title": "b", "gaussians": 5,
    }  # fmt: skip
    for name in ("speed", "self"):  # Python uses the second
        with pytest.raises(InputError, match=f"option must be one of quality, .*; got '{name}'"):
            Options.from_flat({name: 1})


def test_options_may_be_given_by_name_or_together(photo):
    small = photo[:24, :24]
    named = gauss2svg.vectorize(small, gaussians=6, iterations=9)
    together = gauss2svg.vectorize(small, Goal(gaussians=6), fit=FitOptions(iterations=9))
    mixed = gauss2svg.vectorize(small, Goal(gaussians=6), iterations=9)
    assert named.svg == together.svg == mixed.svg
    with pytest.raises(InputError, match="fit must be a FitOptions; got SvgOptions"):
        gauss2svg.vectorize(small, fit=SvgOptions())


TOGETHER = [
    ({"portable": True}, "portable must be given with blend add"),
    ({"blend": "add", "renderer": "cairo"}, "renderer must be one of .*resvg.*or --portable"),
    ({"blend": "add", "falloff": "adaptive"}, "falloff must be gaussian.*; got 'adapt"),
    ({"blend": "add", "animate": 2}, "animate must not be given with additive.*--portable"),
    ({"blend": "add", "form": "blur", "renderer": "chromium"}, "form blur must.*--form gradient"),
    ({"count_gzipped": True}, "count_gzipped must be given with max_bytes"),
    ({"target_psnr": 30, "target_ssimulacra2": 50}, "ssimulacra2 must not be .* target_psnr"),
    ({"scores": True, "time_limit": 5}, "scores must not be given with time_limit"),
    *(({"markup": "minimal", **given}, "markup must be editable with")
      for given in ({"animate": 2.0}, {"blend": "add"}, {"form": "blur", "renderer": "chromium"})),
    *(({"inks": "#000,#fff", **given}, "must not be given with inks")
      for given in ({"blend": "add"}, {"falloff": "gaussian"}, {"palette": 6}, {"stops": 8},
                    {"animate": 2.0})),
    *(({"areas": "always", **given}, "must not be given with areas always")
      for given in ({"gaussians": 9}, {"blend": "add"}, {"falloff": "gaussian"})),
]  # fmt: skip


@pytest.mark.parametrize(("given", "match"), TOGETHER)
def test_options_that_exclude_each_other_are_refused_with_a_way_out(given, match):
    with pytest.raises((InputError, RendererError), match=match):
        Plan(Options.from_flat(given))


def test_unknown_keywords_are_refused_with_the_nearest_option():
    for call, arguments in ((gauss2svg.vectorize, [""]), (gauss2svg.vectorize_many, [[], ""])):
        with pytest.raises(InputError, match=r"option must be one of .* got 'gausians'. Try gauss"):
            call(*arguments, gausians=7)
