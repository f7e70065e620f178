"""The command as a person uses it, most of it in its own process."""

import json
import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from names import possible
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.cli.streams import counting_bar
from gauss2svg.pipeline.options import OPTIONS
from gauss2svg.scene import Scene

QUICK = ["--gaussians", "40", "--iterations", "20"]


@pytest.fixture
def picture(photo, tmp_path):
    path = tmp_path / "a photo's «name».png"
    Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8)).save(path)
    return path


def run(*arguments, **options):
    """A command whose output is read as UTF-8, although Windows has a code page of its own."""
    command = [sys.executable, "-m", "gauss2svg", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True, **options)


def test_photo_becomes_svg_with_all_that_was_asked_for(picture, tmp_path):
    out, report, preview, scene = (tmp_path / n for n in ("o.svg", "r.json", "p.png", "s.npz"))
    done = run(
        picture, "-o", out, *QUICK, "--report", report, "--preview", preview, "--save-scene", scene
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == b""
    summary = done.stderr.decode()
    for word in ("shapes", "gzipped", "PSNR", "SSIM"):
        assert word in summary
    assert sum(not line.startswith(" ") for line in summary.splitlines()) <= 5
    numbers = json.loads(report.read_text())
    assert numbers["svg_bytes"] == out.stat().st_size
    with Image.open(preview) as raster:
        assert raster.size == (64, 48)
    assert len(Scene.load(scene)) == numbers["gaussians"]


COMMANDS = {
    "check photo.png o.svg --report r.json --heatmap h.png": ("r.json", "h.png"),
    "placeholder photo.png --format html -o page.html": ("page.html",),
    "batch photo.png -o many --gaussians 9 --workers 1": ("many/photo.svg",),
    "bench photo.png -o bench --axis gaussians=5,9": ("bench/summary.md", "bench/bench.csv"),
    "gallery photo.png -o site --counts 9": ("site/index.html",),
}


@pytest.mark.process
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_writes_its_files_and_says_what_it_did(command, picture, tmp_path):
    picture.rename(tmp_path / "photo.png")
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"><path d="M0 0h2v3"/></svg>'
    (tmp_path / "o.svg").write_text(svg)
    done = run(*command.split(), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, b""), done.stderr
    assert done.stderr
    for name in COMMANDS[command]:
        assert (tmp_path / name).stat().st_size > 100


def test_quiet_is_quiet(picture, tmp_path, capfd):
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *QUICK, "--quiet"]) == 0
    assert capfd.readouterr() == ("", "")


def test_missed_target_is_one_line_and_status_zero(picture, tmp_path, capfd):
    asked = ["--target-psnr", "60", "--max-bytes", "9k", "--iterations", "30", "--quiet"]
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *asked]) == 0
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "target of 60 dB not reached" in err
    assert "stopped by max bytes" in err
    assert 7000 < (tmp_path / "o.svg").stat().st_size <= 9000


def test_report_has_the_time_limit_that_was_asked_for(picture, tmp_path):
    report = tmp_path / "r.json"
    options = ["--time-limit", "1.5", "--report", str(report), "--quiet"]
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *options]) == 0
    assert json.loads(report.read_text())["time_limit"] == 1.5


@pytest.mark.process
def test_standard_input_and_output_are_streams(picture, tmp_path):
    done = run("-", "-o", "-", *QUICK, "--quiet", input=picture.read_bytes())
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.startswith(b"<?xml")
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *QUICK, "--quiet"]) == 0
    assert (tmp_path / "o.svg").read_bytes() == done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no.png", "-o", "OUT"], "cannot read no.png: No such file or directory"),
        (["PHOTO", "-o", "FOLDER"], "it is a folder"),
        (["PHOTO", "-o", "FOLDER/no/x.svg"], "No such file or directory"),
        (["PHOTO", "-o", "PHOTO"], "is also the photo"),
        (["PHOTO", "-o", "OUT", "--report", "OUT"], "is also another output"),
        (["PHOTO", "-o", "OUT", "--quality", "best"], "best"),
        (["PHOTO", "-o", "OUT", "--gaussians", "many"], "many"),
        (
            ["PHOTO", "-o", "OUT", "--gaussians", "-3"],
            "--gaussians must be a whole number in 0..10000000 or auto; got -3",
        ),
        (["PHOTO", "-o", "OUT", "--treads", "2"], "--treads"),
        (
            ["PHOTO", "-o", "OUT", "--target-psnr", "0"],
            "number above 0 and at most 100; got 0",
        ),
        (
            ["PHOTO", "-o", "OUT", "--max-bytes", "12x"],
            "got '12x'. Try 150k or 1.5M",
        ),
        (
            ["PHOTO", "-o", "OUT", "--time-limit", "-1"],
            "number above 0 and at most 1e+09; got -1",
        ),
        (["PHOTO", "-o", "OUT", "--time-limit", "nan"],
         "--time-limit must be a number above 0 and at most 1e+09; got nan"),
        (
            ["PHOTO", "-o", "OUT", "--gaussians", "99999999999"],
            "; got 99999999999",
        ),
        (["PHOTO", "-o", "--quiet"], "got --quiet, which reads like an option. Try ./--quiet"),
        (["-o", "OUT"], "the photo must be one file; got none. Try gauss2svg --help"),
        (["check", "a.svg"], "SVG must be given; got none. Try gauss2svg check"),
        (["PHOTO", "b.png", "-o", "OUT"], "must be one file; got"),
        (["PHOTO", "--treads", "2"], "must be an option; got an unknown one. Try --threads"),
        (["PHOTO", "-q"], "-q must be an option; got an unknown one. Try --help, or ./-q for a"),
        (["PHOTO", "--colors", "6"], "--colors must be an option; got an unknown one. Try --help"),
        (["placeholder", "PHOTO", "--threads", "2"], "--threads must be an option; got an"),
        (["placeholder", "PHOTO", "--max-byte", "1k"], "unknown one. Try --max-bytes"),
        (["batch", "PHOTO", "--treads", "2", "-o", "FOLDER/x"], "unknown one. Try --threads"),
        (["batch", "PHOTO", "--worker", "2", "-o", "FOLDER/x"], "unknown one. Try --workers"),
        (["bench", "PHOTO", "--peer", "jpeg", "-o", "FOLDER/x"], "unknown one. Try --peers"),
        (["gallery", "PHOTO", "--variant", "max", "-o", "FOLDER/x"], "one. Try --variants"),
        (["check", "-x", "-y"], "-x must be an option; got an unknown one. Try --help"),
        (["check", "PHOTO", "--previw"], "unknown one. Try --preview"),
        (["PHOTO", "-o", "FOLDER/o.png"], "--output must be a name that ends in .svg or .svgz"),
        (["PHOTO", "-o", "FOLDER/x/"], "--output must be the name of a file, not of a folder"),
        (["PHOTO", "-o", ""], "--output must be the name of a file; got ''"),
        (["PHOTO", "-o", "OUT", "--preview", "FOLDER/a.jpg"], "a name that ends in .png"),
        (["PHOTO", "-o", "OUT", "--report", "FOLDER/a.png"], "a name that ends in .json"),
        (["PHOTO", "-o", "OUT", "--outline", "FOLDER/a.pdf"], "ends in .svg or .svgz"),
        (["-"], "--output must be given if the photo is standard input"),
        (["batch", "PHOTO"], "--output must be given; got none. Try gauss2svg batch"),
        (["PHOTO", "--max-bytes"], "--max-bytes must be given with a value; got none. Try"),
        (["PHOTO", "-o", "OUT", "-o", "OUT"], "-o specified multiple times. Try"),
        (
            ["PHOTO", "-o", "OUT", "--target-psnr", "30", "--target-ssimulacra2", "60"],
            "--target-ssimulacra2 must not be given with --target-psnr. Try",
        ),
        (
            ["PHOTO", "-o", "OUT", "--inks", "3", "--falloff", "gaussian"],
            "--falloff gaussian must not be given with --inks, because a picture in inks",
        ),
        (
            ["PHOTO", "-o", "OUT", "--loss", "l1", "--ssim-weight", "0.3"],
            "--loss must be one with ssim if --ssim-weight is given; got 'l1'. Try --loss l1+ssim",
        ),
    ],
)  # fmt: skip
def test_mistake_is_one_line_status_two_and_no_file(arguments, message, picture, tmp_path, refusal):
    before = sorted(tmp_path.iterdir())
    names = {"PHOTO": str(picture), "OUT": str(tmp_path / "o.svg")}
    given = [names.get(a, a.replace("FOLDER", str(tmp_path))) for a in arguments]
    assert message.lower() in refusal(*given).lower()
    assert sorted(tmp_path.iterdir()) == before


def test_without_a_name_the_svg_goes_beside_the_photo(picture, refusal):
    beside = picture.with_suffix(".svg")
    assert main([str(picture), *QUICK, "--quiet"]) == 0
    ours = beside.read_bytes()
    assert ours.startswith(b"<?xml")
    assert main([str(picture), *QUICK, "--quiet", "--seed", "1"]) == 0  # it is ours
    beside.write_text("<svg/>")
    assert "gauss2svg did not write it" in refusal(picture, *QUICK, "--quiet")
    assert beside.read_text() == "<svg/>"
    assert main([str(picture), *QUICK, "--quiet", "--overwrite"]) == 0
    assert beside.read_bytes() == ours


def test_without_arguments_the_short_help_is_shown(capsys):
    assert main([]) == 0
    assert "--help-all" in capsys.readouterr().out


@pytest.mark.posix
def test_link_stays_a_link(picture, tmp_path):
    real, link = tmp_path / "real.svg", tmp_path / "link.svg"
    real.write_text("old")
    link.symlink_to(real)
    assert main([str(picture), "-o", str(link), *QUICK, "--quiet"]) == 0
    assert link.is_symlink()
    assert real.read_text().startswith("<?xml")


@pytest.mark.posix
def test_pipe_is_written_to_not_replaced(picture, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", pipe], stdout=subprocess.PIPE) as reader:
        assert main([str(picture), "-o", str(pipe), *QUICK, "--quiet"]) == 0
        out, _ = reader.communicate(timeout=60)
    assert out.startswith(b"<?xml")
    assert pipe.is_fifo()


def test_what_goes_to_a_pipe_is_utf8_whatever_the_system_encodes(tmp_path):
    done = run("ä中.png", env={**os.environ, "PYTHONIOENCODING": "latin-1"}, cwd=tmp_path)
    assert done.returncode == 2
    assert "cannot read ä中.png" in done.stderr.decode()


@pytest.mark.parametrize(
    "name", ["a[/b].svg", "out[red].svg", "ä ö 中.svg", possible('it\'s "it".svg')]
)
def test_any_file_name_is_written_and_shown_as_it_is(name, picture, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    out = tmp_path / name
    out.parent.mkdir(exist_ok=True)
    assert main([str(picture), "-o", name, *QUICK]) == 0
    assert out.exists()
    assert name in capsys.readouterr().err


def test_full_help_names_every_option(capsys):
    assert main(["--help-all"]) == 0
    text = capsys.readouterr().out
    files = ["output", "preview", "report", "outline", "save_scene", "quiet"]
    for name in [*OPTIONS, *files]:
        assert f"--{name.replace('_', '-')} " in text


def test_a_log_has_a_line_of_progress_a_minute(capsys):
    now = 0.0
    with counting_bar(quiet=False, clock=lambda: now) as update:
        for now in (0.0, 59.0, 60.0, 119.0, 7000.0):
            update("3 failed", int(now), 10_000)
    assert capsys.readouterr().err.splitlines() == [
        "gauss2svg: 60 of 10,000: 3 failed",
        "gauss2svg: 7,000 of 10,000: 3 failed",
    ]
    with counting_bar(quiet=True, clock=iter([0.0, 99.0]).__next__) as update:
        update("3 failed", 1, 2)
    assert capsys.readouterr().err == ""


def test_version_prints_the_block_of_a_fault_report(capsys):
    assert main(["--version"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"gauss2svg {gauss2svg.__version__}"
    heads = [line.partition(":")[0] for line in lines[1:] if line[0] != " "]
    assert heads == ["system", "CPU", "renderers", "packages"]
    text = " ".join(lines)
    assert all(name in text for name in ("resvg 0", "numpy 2", "pyvips", platform.python_version()))
    assert all(len(line) < 80 for line in lines)


@pytest.mark.process
@pytest.mark.parametrize(
    ("file", "reason"),
    [(f"{name}.py", f"{head}: no such library") for name, head in
     {"numpy": "resvg", "psutil": "CPU", "resvg_py": "resvg", "cairosvg": "cairo"}.items()]
    + [("rsvg-convert", "librsvg: rsvg-convert cannot say its version: no such library")],
)  # fmt: skip
@pytest.mark.posix  # a shell script stands in for a program
def test_version_says_which_package_or_renderer_is_broken_and_prints_the_rest(
    file, reason, tmp_path
):
    broken = tmp_path / file
    python = 'raise ImportError("no such library")'
    program = "#!/bin/sh\necho no such library >&2; exit 3"
    broken.write_text(python if broken.suffix else program)
    broken.chmod(0o755)
    python_path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    done = run("--version", env={**os.environ, "PYTHONPATH": python_path, "PATH": path})
    assert (done.returncode, done.stderr) == (0, b"")
    lines = done.stdout.decode().splitlines()
    assert lines[0] == f"gauss2svg {gauss2svg.__version__}"
    assert reason in " ".join(line.strip() for line in lines)
    assert "numpy 2" in done.stdout.decode()
