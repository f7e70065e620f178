"""Fits that are taken up again end at the same bits, and nothing else is taken for one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg import checkpoint as checkpoint_module
from gauss2svg import vectorize
from gauss2svg.checkpoint import packed, unpacked
from gauss2svg.cli import main
from gauss2svg.errors import InputError

RUNS = {
    "count": {"gaussians": 60, "iterations": 30},
    "scene decides": {"quality": "draft", "iterations": 40},
    "sum": {"gaussians": 40, "iterations": 25, "blend": "add"},
    "portable": {"quality": "draft", "iterations": 25, "blend": "add", "portable": True},
    "segments": {"gaussians": 60, "iterations": 30, "segments": 6},
    "target": {"target_psnr": 24.0, "quality": "fast", "iterations": 40},
    "ran away": {"gaussians": 60, "iterations": 30, "learning_rate": 1e4},
    "double, by error": {"gaussians": 40, "iterations": 20, "dtype": "float64", "init": "error"},
}


@pytest.fixture
def small(photo):
    return photo[:64, :80]


def kept(monkeypatch, small, options, stop=None) -> tuple[str, list[bytes]]:
    """The SVG of a run, and a checkpoint after each of its steps."""
    files: list[bytes] = []
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint_module, "write_atomically", lambda _, data: files.append(data))
        svg = vectorize(small, checkpoint="x", checkpoint_every=0, stop=stop, **options).svg
    return svg, files


@pytest.mark.parametrize("name", RUNS)
def test_fit_goes_on_to_the_same_bits_from_any_step(name, small, monkeypatch, tmp_path):
    options = RUNS[name]
    svg, files = kept(monkeypatch, small, options)
    assert svg == vectorize(small, **options).svg
    assert len(files) > options["iterations"]
    for at in sorted({0, len(files) // 4, len(files) // 2, len(files) - 8, len(files) - 1}):
        (tmp_path / "fit").write_bytes(files[at])
        assert vectorize(small, resume=tmp_path / "fit", **options).svg == svg, at


@pytest.mark.parametrize("step", [1, 7, 26])
def test_interrupted_fit_goes_on_to_the_same_bits(step, small, monkeypatch, tmp_path):
    asked = iter(range(1000))  # once before the first step
    early, files = kept(monkeypatch, small, RUNS["count"], stop=lambda: next(asked) >= step)
    assert len(files) == step
    (tmp_path / "fit").write_bytes(files[-1])
    whole = vectorize(small, **RUNS["count"])
    assert early != whole.svg
    again = vectorize(small, resume=tmp_path / "fit", **RUNS["count"])
    assert again.svg == whole.svg
    assert again.report["iterations"] == whole.report["iterations"]


def test_costs_of_both_parts_are_told(small, monkeypatch, tmp_path):
    _, files = kept(monkeypatch, small, RUNS["count"])
    (tmp_path / "fit").write_bytes(files[20])
    whole = vectorize(small, **RUNS["count"]).report
    again = vectorize(small, resume=tmp_path / "fit", **RUNS["count"]).report
    assert again["pixel_pairs"] == whole["pixel_pairs"]
    assert again["fit_s"] > unpacked(files[20])["memory"]["fit"]["wall_s"] > 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gaussians": 61}, "its gaussians was 60, now 61"),
        ({"seed": 1}, "its seed was 0, now 1"),
        ({"loss": "l1"}, "its loss was 'mse', now 'l1'"),
        ({"segments": 4}, "its photo was another"),
        ({"target_psnr": 30.0}, "its targets was"),
    ],
)
def test_checkpoint_of_another_run_is_refused(change, message, small, monkeypatch, tmp_path):
    (tmp_path / "fit").write_bytes(kept(monkeypatch, small, RUNS["count"])[1][3])
    with pytest.raises(InputError, match=message):
        vectorize(small, resume=tmp_path / "fit", **RUNS["count"] | change)


def test_checkpoint_of_another_photo_is_refused(small, monkeypatch, tmp_path):
    (tmp_path / "fit").write_bytes(kept(monkeypatch, small, RUNS["count"])[1][3])
    other = small.copy()
    other[5, 6, 0] += 0.001
    with pytest.raises(InputError, match="its photo was another"):
        vectorize(other, resume=tmp_path / "fit", **RUNS["count"])


def test_every_damage_is_refused(small, monkeypatch, tmp_path):
    good = kept(monkeypatch, small, RUNS["count"])[1][3]
    rng = np.random.default_rng(0)
    bad = [good[:-1], good[: len(good) // 2], b"", b"PK\x03\x04", b"no checkpoint"]
    places = rng.integers(0, len(good), 60).tolist()
    bad += [good[:at] + bytes([good[at] ^ 0x55]) + good[at + 1 :] for at in places]
    whole, refused = vectorize(small, **RUNS["count"]).svg, 0
    for data in bad:
        (tmp_path / "fit").write_bytes(data)
        try:  # what zip does not need may be anything
            assert vectorize(small, resume=tmp_path / "fit", **RUNS["count"]).svg == whole
        except InputError:
            refused += 1
    assert refused > 50


def forged(good: bytes, change) -> bytes:
    """A checkpoint with another memory and the digest that belongs to it."""
    stored = unpacked(good)
    change(stored["memory"]["fit"]["population"]["state"])
    return packed(stored)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.update(mean=s["mean"][:-1]), "is not float64"),
        (lambda s: s.update(factor=s["factor"].astype(np.float32)), "is not float64"),
        (lambda s: s.update(color=s["color"] * np.nan), "is not finite"),
        (lambda s: s.update(factor=-s["factor"]), "no extent"),
        (lambda s: s.pop("age"), "age of a checkpoint"),
    ],
)
def test_forged_arrays_never_reach_the_kernels(change, message, small, monkeypatch, tmp_path):
    good = kept(monkeypatch, small, RUNS["count"])[1][3]
    (tmp_path / "fit").write_bytes(forged(good, change))
    with pytest.raises(InputError, match=message):
        vectorize(small, resume=tmp_path / "fit", **RUNS["count"])


def test_run_against_the_clock_has_no_checkpoint(small, tmp_path):
    for name in ("checkpoint", "resume"):
        with pytest.raises(InputError, match=f"{name} and time_limit are both given"):
            vectorize(small, time_limit=1.0, **{name: tmp_path / "fit"})


@pytest.mark.parametrize("every", [-1.0, np.nan, 1e9, "often"])
def test_seconds_between_checkpoints_have_a_domain(every, small, tmp_path):
    with pytest.raises(InputError, match="checkpoint_every"):
        vectorize(small, gaussians=1, checkpoint=tmp_path / "fit", checkpoint_every=every)


def test_command_goes_on_from_its_checkpoint_and_keeps_it(tmp_path):
    from PIL import Image
    from skimage import data

    photo, svg, fit = (str(tmp_path / name) for name in ("photo.png", "out.svg", "fit"))
    Image.fromarray(data.coffee()[::8, ::8]).save(photo)
    command = [photo, "-o", svg, "--gaussians", "20", "--iterations", "20", "--quiet"]
    keep = ["--checkpoint", fit, "--checkpoint-every", "0"]
    assert main([*command, *keep]) == 0
    first = (tmp_path / "out.svg").read_bytes()
    assert main([*command, *keep, "--resume", fit]) == 0
    assert (tmp_path / "out.svg").read_bytes() == first
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fit", "out.svg", "photo.png"]


@pytest.mark.parametrize("taken", ["photo.png", "out.svg"])
def test_checkpoint_overwrites_nothing_else(taken, tmp_path, capsys):
    (tmp_path / "photo.png").write_bytes(b"precious")
    photo, svg = str(tmp_path / "photo.png"), str(tmp_path / "out.svg")
    assert main([photo, "-o", svg, "--checkpoint", str(tmp_path / taken)]) == 2
    assert "each its own name" in capsys.readouterr().err
    assert (tmp_path / "photo.png").read_bytes() == b"precious"


NUMBERS = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False))
ARRAYS = st.lists(st.floats(), max_size=4).map(lambda v: np.array(v, np.float64))
TREES = st.recursive(
    st.one_of(NUMBERS, ARRAYS),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)


def same(one, other) -> bool:
    if isinstance(one, np.ndarray):
        return one.tobytes() == other.tobytes() and one.shape == other.shape
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other and type(one) is type(other)


@given(TREES)
def test_whatever_is_packed_comes_back_to_the_last_bit(tree):
    assert same({"it": tree}, unpacked(packed({"it": tree})))
