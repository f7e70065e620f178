"""Fits that continue from a checkpoint end at the same bits; anything else is refused."""

import io
import os

import numpy as np
import pytest
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, OutputError
from gauss2svg.pipeline import checkpoint as checkpoint_module
from gauss2svg.pipeline.checkpoint import packed, unpacked

RUNS = {
    "count": {"gaussians": 60, "iterations": 30},
    "adaptive count": {"quality": "draft", "iterations": 40},
    "additive": {"gaussians": 40, "iterations": 25, "blend": "add"},
    "portable": {"quality": "draft", "iterations": 25, "blend": "add", "portable": True},
    "segments": {"gaussians": 60, "iterations": 30, "segments": 6},
    "target": {"target_psnr": 24.0, "quality": "fast", "iterations": 20},
    "bytes": {"markup": "editable", "max_bytes": "6k", "quality": "fast", "iterations": 20},
    "diverged": {"gaussians": 60, "iterations": 30, "learning_rate": 1e4},
    "by error": {"gaussians": 40, "iterations": 20, "init": "error"},
}


@pytest.fixture(scope="module")
def small(photo):
    return photo[:48, :56]


@pytest.fixture(scope="module")
def checkpoints(small) -> list[bytes]:
    """Of the run to a count, one after each of its steps."""
    with pytest.MonkeyPatch.context() as patch:
        return kept(patch, small, RUNS["count"])[1]


def kept(monkeypatch, small, options, stop=None) -> tuple[str, list[bytes]]:
    """The SVG of a run, and a checkpoint after each of its steps."""
    files: list[bytes] = []
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint_module, "write_atomically", lambda _, data: files.append(data))
        svg = vectorize(small, checkpoint="x", checkpoint_every=0, stop=stop, **options).svg
    return svg, files


@pytest.mark.sweep
@pytest.mark.parametrize("name", RUNS)
def test_fit_continues_to_the_same_bits_from_any_step(name, small, monkeypatch, tmp_path):
    options = RUNS[name]
    svg, files = kept(monkeypatch, small, options)
    assert svg == vectorize(small, **options).svg
    assert len(files) > options["iterations"]
    for at in sorted({0, len(files) // 2, len(files) - 8, len(files) - 1}):
        (tmp_path / "fit").write_bytes(files[at])
        assert vectorize(small, resume=tmp_path / "fit", **options).svg == svg, at


@pytest.mark.parametrize("step", [1, 7, 26])
def test_interrupted_fit_continues_to_the_same_bits(step, small, monkeypatch, tmp_path):
    asked = iter(range(1000))  # once before the first step
    early, files = kept(monkeypatch, small, RUNS["count"], stop=lambda: next(asked) >= step)
    assert len(files) == step
    (tmp_path / "fit").write_bytes(files[-1])
    whole = vectorize(small, **RUNS["count"])
    assert early != whole.svg
    again = vectorize(small, resume=tmp_path / "fit", **RUNS["count"])
    assert again.svg == whole.svg
    assert again.report["iterations"] == whole.report["iterations"]


def test_costs_of_both_parts_are_reported(small, checkpoints, tmp_path):
    files = checkpoints
    (tmp_path / "fit").write_bytes(files[20])
    whole = vectorize(small, **RUNS["count"]).report
    again = vectorize(small, resume=tmp_path / "fit", **RUNS["count"]).report
    assert again["pixel_pairs"] == whole["pixel_pairs"]
    assert (
        again["fit_s"] > unpacked(io.BytesIO(files[20]))["state"]["fit"]["stopwatch"]["wall_s"] > 0
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gaussians": 61}, "with gaussians 61; got one with gaussians 60"),
        ({"seed": 1}, "with seed 1; got one with seed 0"),
        ({"loss": "l1"}, "with loss 'l1'; got one with loss 'mse'"),
        ({"title": "b"}, "with title 'b'; got one with title 'Vectorised photo'"),
        ({"size": "5mm"}, "with size '5mm'; got one with size None"),
        ({"segments": 4}, "of this photo; got one of another photo"),
        ({"target_psnr": 30.0}, "with target_psnr 30.0; got one with target_psnr None"),
    ],
)
def test_checkpoint_of_another_run_is_refused(change, message, small, checkpoints, tmp_path):
    (tmp_path / "fit").write_bytes(checkpoints[3])
    with pytest.raises(InputError, match=message):
        vectorize(small, resume=tmp_path / "fit", **RUNS["count"] | change)


def test_checkpoint_of_another_photo_is_refused(small, checkpoints, tmp_path):
    (tmp_path / "fit").write_bytes(checkpoints[3])
    other = small.copy()
    other[5, 6, 0] += 0.001
    with pytest.raises(InputError, match="of this photo; got one of another photo"):
        vectorize(other, resume=tmp_path / "fit", **RUNS["count"])


@pytest.mark.sweep
def test_every_damage_is_refused(small, checkpoints, tmp_path):
    good = checkpoints[3]
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
    """A checkpoint with another state, as whole as the good one."""
    stored = unpacked(io.BytesIO(good))
    change(stored["state"])
    return packed(stored)


def put(*path_and_value):
    """A change of a state: another value at a path of keys that it has."""
    *path, key, value = path_and_value

    def change(state):
        for step in path:
            state = state[step]
        assert key in state
        state[key] = value(state[key]) if callable(value) else value

    return change


STATE, SHARED = ("fit", "population", "state"), ("fit", "shared")
FORGERIES = {
    "means of fewer": put(*STATE, "mean", lambda a: a[:-1]),
    "single precision": put(*STATE, "factor", lambda a: a.astype(np.float32)),
    "no numbers": put(*STATE, "color", lambda a: a * np.nan),
    "no extent": put(*STATE, "factor", lambda a: -a),
    "far away": put(*STATE, "mean", lambda a: a + 1e300),
    "negative squares": put(*STATE, "second", lambda a: a - 1),
    "a list for a state": put("fit", "population", "state", [1, 2]),
    "colours out of reach": put(*SHARED, "entry", lambda a: a + 10**9),
    "colours before the first": put(*SHARED, "entry", lambda a: a - 10**6),
    "colours of one": put(*SHARED, "entry", lambda a: a[:1]),
    "no colours": put(*SHARED, "color", lambda a: a[:0]),
    "colours that are none": put(*SHARED, "color", lambda a: a * np.nan),
    "shared age": put(*SHARED, "age", -1),
    "colours below what is drawn": put(*SHARED, "least_color", -1.0),
    "bounds of colours that are text": put(*SHARED, "most_color", "1"),
    "text for colours": put("fit", "shared", "all of them"),
    "reduced by nothing": put("fit", "population", "reduction", 0),
    "reduced to nothing": put("fit", "population", "reduction", 10**9),
    "another generator": put("fit", "population", "rng", {"bit_generator": "MT19937"}),
    "rounds": put("fit", "population", "round_index", 10**30),
    "steps to come": put("fit", "clock", "iteration", -(10**12)),
    "steps of a stage": put("fit", "clock", "stage_steps", 10**12),
    "more steps of a stage than of the run": put("fit", "clock", "stage_steps", 10**6),
    "reduced by text": put("fit", "clock", "reduced", "no"),
    "text for steps": put("fit", "clock", "iteration", "x"),
    "stage": put("fit", "stage", "name", "bogus"),
    "rate": put("fit", "guard", "rate", float("nan")),
    "errors": put("fit", "errors", ["a", -1]),
    "bytes of each": put("growth", "bytes_each", 0),
    "bounds": put("growth", "cap", []),
    "additive": put("additive", {"a": 1}),
    "which fit": put("stage", "nothing"),
    "the other fit": put("stage", "additive"),
    "nothing": dict.clear,
}


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_values_are_refused_in_one_line(name, small, checkpoints, tmp_path):
    good = checkpoints[27]  # colours are shared by then
    (tmp_path / "fit").write_bytes(forged(good, FORGERIES[name]))
    with pytest.raises(InputError) as refused:
        vectorize(small, resume=tmp_path / "fit", **RUNS["count"])
    assert "\n" not in str(refused.value)


def test_what_unpacks_to_more_than_it_is_is_refused_unread(small, tmp_path):
    np.savez_compressed(tmp_path / "bomb.npz", format=1, text=np.zeros(10**8, np.uint8))
    with pytest.raises(InputError, match="compressed"):
        vectorize(small, resume=tmp_path / "bomb.npz", **RUNS["count"])


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices have other names")
def test_pipes_and_devices_hold_no_checkpoint(small, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="pipe or a device"):
            vectorize(small, resume=name, **RUNS["count"])
        with pytest.raises(InputError, match="not a regular file"):
            vectorize(small, checkpoint=name, **RUNS["count"])


def test_checkpoint_that_cannot_be_written_costs_nothing_but_itself(small, monkeypatch, tmp_path):
    def full(*_):
        raise OutputError("cannot write fit: No space left on device; Try another folder")

    whole = vectorize(small, **RUNS["count"])
    monkeypatch.setattr(checkpoint_module, "write_atomically", full)
    result = vectorize(small, checkpoint=tmp_path / "fit", checkpoint_every=0, **RUNS["count"])
    assert result.svg == whole.svg
    assert "No space left" in result.report["checkpoint_trouble"]
    assert whole.report["checkpoint_trouble"] is None


def test_run_against_the_clock_has_no_checkpoint(small, tmp_path):
    for name in ("checkpoint", "resume"):
        with pytest.raises(InputError, match=f"time_limit must not be given with {name}"):
            vectorize(small, time_limit=1.0, **{name: tmp_path / "fit"})


def test_command_continues_from_its_checkpoint_and_keeps_it(tmp_path):
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
    assert "must be a file of its own" in capsys.readouterr().err
    assert (tmp_path / "photo.png").read_bytes() == b"precious"


NUMBERS = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False))
ARRAYS = st.lists(st.floats(), max_size=4).map(lambda v: np.array(v, np.float64))
LEAVES = st.one_of(NUMBERS, ARRAYS)
BRANCHES = st.one_of(
    LEAVES, st.lists(LEAVES, max_size=3), st.dictionaries(st.text(max_size=5), LEAVES, max_size=3)
)
TREES = st.one_of(
    BRANCHES,
    st.lists(BRANCHES, max_size=3),
    st.dictionaries(st.text(max_size=5), BRANCHES, max_size=3),
)


def same(one, other) -> bool:
    if isinstance(one, np.ndarray):
        return one.tobytes() == other.tobytes() and one.shape == other.shape
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[k], other[k]) for k in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other and type(one) is type(other)


@pytest.mark.sweep
@given(TREES)
def test_whatever_is_packed_comes_back_to_the_last_bit(tree):
    assert same({"it": tree}, unpacked(io.BytesIO(packed({"it": tree}))))
