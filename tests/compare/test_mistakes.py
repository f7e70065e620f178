"""Mistakes on the command line of `bench` and `gallery`."""

import pytest

BENCH = [
    (["--axis", "speed"], "axis must be one of quality, gaussians"),
    (
        ["--axis", "loss=mse,l3"],
        "axis loss must be one of mse, l1",
    ),
    (["--axis", "gaussians=many"], "got 'many'"),
    (
        ["--axis", "gaussians="],
        "axis gaussians must be a whole number in 0..10000000 or auto; got ''",
    ),
    (["--axis", "precision=0"], "axis precision must be a number in 0.001..1; got 0"),
    (["--axis", "schedule"], "schedule must be given with a number of Gaussians"),
    (["--axis", "schedule"], "; got linear. Try --axis gaussians=1000"),
    (["--axis", "renderer=cairo", "--axis", "blend=add"], "renderer=resvg, or --axis portable"),
    (["--peers", "vtracer,tracer"], "peer must be one of vtracer, vtracer:default"),
    (["--peers", "jpeg:30,jpeg:31"], "avif:90; got 'jpeg:31'"),
    (["--peer-timeout", "0"], "--peer-timeout must be a number in 0.001..1e+06; got 0"),
    (["--peer-timeout", "inf"], "--peer-timeout must be a number in 0.001..1e+06; got inf"),
    (["--threads", "0"], "threads must be"),
    (["no.png"], "cannot read no.png"),
    (["-o", "PHOTO"], "cannot create"),
]
GALLERY = [
    (
        ["--variants", "", "--counts", ""],
        "at least one preset, count or peer; got none",
    ),
    (["--variants", "quick"], "variant must be one of draft, fast"),
    (["--counts", "many"], "counts must be whole numbers separated by commas; got 'many'"),
    (["--counts", "2.5"], "counts must be whole numbers separated by commas; got '2.5'"),
    (["--counts=-5"], "counts must be whole numbers separated by commas; got '-5'"),
    (["--counts", "1" * 5000], "counts must be whole numbers separated by commas; got '111"),
    (
        ["--counts", "999999999999"],
        "a whole number in 0..10000000; got 999999999999",
    ),
    (["--peers", "jpeg"], "peer must be one of vtracer"),
    (["--peers", "vtracer:best"], "got 'vtracer:best'"),
    (["--jobs", "0"], "jobs must be a whole number in 1..256; got 0"),
    (["--jobs", "many"], "jobs"),
    (["--threads", "0"], "threads must be"),
    (["--seed", "-1"], "seed"),
    (["--photo-size", "0"], "--photo-size must be"),
    (["--max-pixels", "0"], "--max-pixels must be"),
    (["--peer-timeout", "0"], "--peer-timeout must be a number in 0.001..1e+06; got 0"),
    (["--peer-timeout", "nan"], "--peer-timeout must be a number in 0.001..1e+06; got nan"),
    (["--title", " "], "title must be text that is not empty; got ' '"),
    (["-o", "PHOTO"], "cannot create"),
    (["-o", "PHOTO/x"], "cannot create"),
]


@pytest.mark.parametrize(
    ("command", "arguments", "message"),
    [("bench", *row) for row in BENCH] + [("gallery", *row) for row in GALLERY],
)
def test_mistake_is_one_line_and_status_two_before_any_work(
    command, arguments, message, two, tmp_path, refusal
):
    given = [word.replace("PHOTO", str(two[0])) for word in arguments]
    target = [] if "-o" in given else ["-o", str(tmp_path / "out")]
    before = sorted(tmp_path.rglob("*"))
    assert message in refusal(command, two[1], *given, *target)
    assert sorted(tmp_path.rglob("*")) == before
