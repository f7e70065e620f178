"""The command as a person uses it, most of it in its own process."""

import json
import os
import platform
import re
import subprocess
import sys

import pytest
from flat import vectorize
from galleries import save
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.cli.summary import print_summary
from gauss2svg.pipeline.options import OPTIONS
from gauss2svg.scene import Scene

QUICK = ["--gaussians", "20", "--iterations", "5"]


@pytest.fixture
def picture(photo, tmp_path):
    return save(photo[:48, :64], tmp_path / "a photo's «name».png")


@pytest.fixture(scope="module")
def small(photo):
    return vectorize(photo[:24, :32], gaussians=20, iterations=2)


def run(*arguments, **options):
    """A command whose output is read as UTF-8, although Windows has a code page of its own."""
    command = [sys.executable, "-m", "gauss2svg", *map(str, arguments)]
    return subprocess.run(command, check=False, capture_output=True, **options)


def test_photo_becomes_svg_with_all_that_was_asked_for(picture, tmp_path):
    """What goes to a pipe is UTF-8, whatever the system encodes."""
    words = ["-o", "中.svg", "--report", "r.json", "--preview", "p.png", "--save-scene", "s.npz"]
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    done = run(picture.name, *words, *QUICK, cwd=tmp_path, env=environment)
    assert (done.returncode, done.stdout) == (0, b""), done.stderr
    summary = done.stderr.decode()
    for word in ("中.svg", "shapes", "gzipped", "PSNR", "SSIM"):
        assert word in summary
    assert sum(not line.startswith(" ") for line in summary.splitlines()) <= 5
    numbers = json.loads((tmp_path / "r.json").read_text())
    assert numbers["svg_bytes"] == (tmp_path / "中.svg").stat().st_size
    with Image.open(tmp_path / "p.png") as raster:
        assert raster.size == (64, 48)
    assert len(Scene.load(tmp_path / "s.npz")) == numbers["gaussians"]


COMMANDS = {
    "placeholder photo.png --format html -o page.html": ("page.html",),
    "batch photo.png -o many --gaussians 9 --workers 1": ("many/photo.svg",),
    "bench photo.png -o bench --axis gaussians=5": ("bench/summary.md", "bench/bench.csv"),
    "gallery photo.png -o site --counts 9": ("site/index.html",),
}


@pytest.mark.process
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_writes_its_files_and_says_what_it_did(command, picture, tmp_path):
    picture.rename(tmp_path / "photo.png")
    done = run(*command.split(), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, b""), done.stderr
    assert done.stderr
    for name in COMMANDS[command]:
        assert (tmp_path / name).stat().st_size > 100


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"paint_ms": 3000.0, "markup": "minimal"},
            "3.0 s to paint it; less with --markup editable",
        ),
        ({"gaussians": 1}, "1 shape: set by --gaussians"),
        ({"stop_reason": "max_bytes"}, "20 shapes: the closest file within the size limit"),
        ({"psnr_svg": None}, "PSNR equal, SSIM"),
        ({"inks": "#000,#fff", "paper": "#eee"}, "#000,#fff on paper of #eee"),
        ({"focus_strength": 4.0}, "focus  PSNR 20.00 dB inside of the mask, 25.00 dB outside"),
        ({"transparent": True}, "dB over white, 20.00 dB over black, 25.00 dB of alpha"),
    ],
)
def test_the_summary_says_what_the_report_has(changed, said, small, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    parts = {"inside": 20.0, "outside": 25.0, "black": 20.0, "alpha": 25.0}
    report = small.report | {f"psnr_svg_{part}": psnr for part, psnr in parts.items()}
    print_summary(report | changed, "o.svg")
    assert said in re.sub(" {3,}", "  ", capsys.readouterr().err)


def test_missed_target_is_one_line_and_status_zero(picture, tmp_path, capfd):
    asked = ["--target-psnr", "60", "--max-bytes", "2k", "--iterations", "4", "--quiet"]
    asked += ["--areas", "never"]
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *asked]) == 0
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "target of 60 dB not reached" in err
    assert "stopped by max bytes" in err
    assert 1500 < (tmp_path / "o.svg").stat().st_size <= 2000


@pytest.mark.process
def test_standard_input_and_output_are_streams(picture, tmp_path):
    done = run("-", "-o", "-", *QUICK, "--quiet", input=picture.read_bytes())
    assert (done.returncode, done.stderr) == (0, b"")
    assert main([str(picture), "-o", str(tmp_path / "o.svg"), *QUICK, "--quiet"]) == 0
    assert (tmp_path / "o.svg").read_bytes() == done.stdout
    done = run(
        "-", "-o", str(tmp_path / "o.svg"), *QUICK, "--report", "-", input=picture.read_bytes()
    )
    assert json.loads(done.stdout)["svg_bytes"] == (tmp_path / "o.svg").stat().st_size


MISTAKES = [
    ("PHOTO -o FOLDER/x/", "ends in .svg or .svgz, or a folder that exists; got"),
    ("PHOTO -o --quiet", "-o/--output: expected one argument. Try gauss2svg --help-all"),
    ("PHOTO -o FOLDER/o.png", "--output must be a name that ends in .svg or .svgz"),
    ("PHOTO -o OUT --report FOLDER/a.png", "a name that ends in .json"),
    ("PHOTO -o OUT --quiet=yes", "--quiet: ignored explicit argument 'yes'"),
    ("PHOTO -o OUT --focus-strength 3", "--focus-strength must be given with a mask; got 3"),
    ("-o OUT", "the photo must be one file; got none. Try gauss2svg --help"),
    ("-", "--output must be the name of a file or folder; got none. Try -o out.svg, or -o -"),
    ("check a.svg PHOTO", "files must be one photo and then one SVG; got a.svg"),
    ("check PHOTO a.svg b.svg", "b.svg must be left out; got a file too many"),
    ("check PHOTO a.svg --heatmap h.jpg", "--heatmap must be a name that ends in .png"),
    ("PHOTO -o - --report -", "--report must be given with a file if -o is standard output"),
    ("PHOTO out.svg", "-o out.svg"),
    ("PHOTO -o OUT --trap 0.2", "--trap must be given with --cut"),
    ("PHOTO -o OUT --cut", "--cut must be given with --inks 3 and --separations cut.svg"),
    ("PHOTO -o OUT --hatch 2", "options of plotters must be given with --plot"),
    ("PHOTO -o OUT --quality hgih", "got 'hgih'. Try high"),
    ("PHOTO -o OUT --matte redd", "#fa0 or #ffaa00; got 'redd'. Try red"),
    ("PHOTO --plot p.svg --sheet 300X200", "such as 300x200mm; got '300X200'"),
    ("bacth PHOTO", "bacth must be a photo or a command; got neither. Try gauss2svg batch"),
    ("batch PHOTO -o OUT", "--output must be the name of a folder; got"),
    ("placeholder PHOTO PHOTO no.png -o OUT", "--output must be a folder for several SVGs"),
    ("placeholder PHOTO --format html -o OUT", "a name for the format html; got"),
    ("check a.svg", "SVG must be given; got none. Try gauss2svg check"),
    ("PHOTO --treads 2", "must be an option; got an unknown one. Try --threads"),
    ("PHOTO --scheduler tcp://a", "--scheduler must be an option; got an unknown one"),
    ("bench no.png -o FOLDER/x", "cannot read no.png"),
    ("bench PHOTO -o FOLDER/x --axis count_gzipped", "axes: count_gzipped must be given with max"),
    ("bench PHOTO -o FOLDER/x --peers jpeg:30,jpeg:31", "LABEL=FOLDER, LABEL=NUMBERS.csv; "
     "got 'jpeg:31'"),
    ("bench PHOTO -o FOLDER/x --peers draft=.", "and a path that exists; got 'draft=.'. "
     "Try LABEL=FOLDER or LABEL=NUMBERS.csv"),
    ("gallery PHOTO -o FOLDER/x --peers a=", "and a path that exists; got 'a='. Try"),
    ("gallery PHOTO -o FOLDER/x --peers a=PHOTO", "peer a must be a folder; got"),
    ("bench -o FOLDER/x --from FOLDER", "--from must be the output folder of gauss2svg batch; got"),
    ("gallery PHOTO -o PHOTO/x", "output must be outside of the inputs"),
    ("gallery PHOTO -o FOLDER/x --variants quick", "axis quality must be one of draft, "),
    ("studio a b", "b must be left out; got a file too many. Try gauss2svg studio"),
    ("studio --no-browser none", "FOLDER"),
    ("PHOTO -o OUT --paper red", "--paper must be given with --inks; got #ff0000"),
    ("PHOTO -o OUT --inks red,#00f,lime,#ff0 --overprint 2", "mixes; got 2 for 4 inks. Try 1"),
    ("PHOTO -o OUT --inks white", "--inks must be another colour than the paper; got #ffffff"),
    ("PHOTO -o OUT --separations p.svg", "--separations must be given with --inks"),
    ("PHOTO -o OUT --plot p.svg --sheet 20x20mm", "margin must be smaller for a sheet of 20x20mm"),
    ("check - -", "files must be one photo and then one SVG; got -, -"),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "message"), MISTAKES)
def test_mistake_is_one_line_status_two_and_no_file(arguments, message, picture, tmp_path, refusal):
    before = sorted(tmp_path.iterdir())
    names = {"PHOTO": str(picture), "OUT": str(tmp_path / "o.svg"), "FOLDER": str(tmp_path)}
    given = [re.sub("PHOTO|OUT|FOLDER", lambda m: names[m[0]], a) for a in arguments.split()]
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


def test_a_folder_takes_files_with_names(picture, tmp_path, refusal):
    folder = tmp_path / "out"
    folder.mkdir()
    options = [
        "-o", "--outline", "--preview", "--report", "--save-scene", "--separations", "--plot",
    ]  # fmt: skip
    given = [word for option in options for word in (option, str(folder))]
    command = [picture, *given, *QUICK, "--inks", "black,white", "--quiet", "--pen-width", 3]
    assert main([str(word) for word in command]) == 0
    kinds = [".svg", "-outline.svg", "-plot.svg", "-preview.png", "-report.json", "-scene.npz"]
    kinds += ["-separations-1.svg", "-separations-2.svg"]
    expected = sorted(picture.stem + kind for kind in kinds)
    assert sorted(path.name for path in folder.iterdir()) == expected
    (folder / f"{picture.stem}.svg").write_text("<svg/>")
    assert "gauss2svg did not write it" in refusal(*command)


def test_check_prints_its_notes(picture, tmp_path, capsys, drawn_here):
    (tmp_path / "a.svg").write_text('<svg viewBox="0 0 64 48"/>')
    assert main(["check", str(picture), str(tmp_path / "a.svg")]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "note the root element has no xmlns of SVG, so browsers do not show the file" in said


def test_full_help_names_every_option(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["batch", "--help"]) == 0
    # The lines of this sentence are joined.
    assert "command line replaces the one in the file." in capsys.readouterr().out
    assert main(["--help-all"]) == 0
    text = capsys.readouterr().out
    files = ["output", "preview", "report", "outline", "save_scene", "quiet"]
    for name in [*OPTIONS, *files]:
        assert re.search(rf" --{name.replace('_', '-')}[ ,\n]", text)


def test_version_prints_the_block_of_a_fault_report(capsys):
    assert main(["version"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"gauss2svg {gauss2svg.__version__}"
    heads = [line.partition(":")[0] for line in lines[1:]]
    assert heads == ["system", "CPU", "renderers", "packages"]
    text = " ".join(lines)
    assert all(name in text for name in ("resvg 0", "numpy 2", "pyvips", platform.python_version()))
