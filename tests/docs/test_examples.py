"""examples/: each script does what its first line says."""

from __future__ import annotations

import base64
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from batches import save_photos
from conftest import random_scene
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.measure.check import check
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.render import render

pytestmark = pytest.mark.example

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(autouse=True)
def _importable(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)  # also for processes that are spawned


@pytest.fixture
def small(photo, tmp_path) -> str:
    path = tmp_path / "photo.png"
    Image.fromarray(np.uint8(255 * photo[40:64, 46:82])).save(path)
    return str(path)


def said(capsys) -> list[str]:
    return capsys.readouterr().out.splitlines()


def test_a_folder_of_photos_becomes_svgs_and_a_bad_one_costs_itself(tmp_path, capsys):
    folder = importlib.import_module("folder")
    photos = save_photos(tmp_path / "photos", ["a.png", "sub/b.png"])
    (photos / "bad.png").write_bytes(b"no picture")
    assert folder.main(str(photos), str(tmp_path / "out"), workers=1) == 1
    lines = sorted(said(capsys))
    assert [line.split()[0] for line in lines] == ["a.svg", "bad.svg", "sub/b.svg"]
    assert lines[0].endswith(f"dB, {(tmp_path / 'out' / 'a.svg').stat().st_size} bytes")
    assert " dB" not in lines[1]


def test_a_cluster_does_what_is_new_and_counts_it(tmp_path, capsys, dask_client):
    cluster = importlib.import_module("cluster")
    photos = save_photos(tmp_path / "photos", ["a.png", "b.png"])
    given = dask_client.scheduler.address, str(photos), str(tmp_path / "out")
    assert cluster.main(*given) == 0
    assert said(capsys)[-1] == "2 written"
    assert cluster.main(*given) == 0
    assert said(capsys)[-1] == "2 skipped"


def test_the_service_answers_svgs_and_refusals(small, tmp_path, monkeypatch):
    testing = pytest.importorskip("fastapi.testclient")
    service = importlib.import_module("service")
    monkeypatch.setattr(service, "WORKERS", 1)
    with testing.TestClient(service.app) as client:
        drawn = client.post("/vectorize", content=Path(small).read_bytes())
        assert (drawn.status_code, drawn.headers["content-type"]) == (200, "image/svg+xml")
        assert check(small, drawn.content).psnr > 20
        refused = client.post("/vectorize", content=b"no picture")
        assert refused.status_code == 422
        assert refused.text
        assert "\n" not in refused.text
        monkeypatch.setattr(service, "MOST_BYTES", 8)
        assert client.post("/vectorize", content=b"no picture").status_code == 413


def test_a_loss_of_ones_own_ends_in_an_svg_that_steps_make_better(small, tmp_path, capsys):
    loss = importlib.import_module("loss")
    out = tmp_path / "out.svg"
    psnr = []
    for steps in (0, 25):
        loss.main(small, str(out), n=30, steps=steps)
        psnr.append(check(small, str(out)).psnr)
    assert psnr[1] > psnr[0] + 3
    assert said(capsys)[-1] == f"{psnr[1]:.2f} dB"


@pytest.mark.parametrize("variant", ["cholesky", "rs"])
def test_a_checkpoint_of_gaussian_image_becomes_its_picture(variant, tmp_path):
    torch = pytest.importorskip("torch")
    checkpoint = importlib.import_module("checkpoint")
    width, height, n = 48, 32, 20
    random = torch.Generator().manual_seed(1)
    tensors = {
        "_xyz": torch.atanh(2 * torch.rand(n, 2, generator=random) - 1),
        "_opacity": torch.ones(n, 1),
        "_features_dc": torch.rand(n, 3, generator=random) - 0.2,
        "bound": torch.tensor([[0.5, 0.5]]),
    }
    if variant == "cholesky":
        tensors["_cholesky"] = 4 * torch.rand(n, 3, generator=random)
        tensors |= {"background": torch.ones(3), "cholesky_bound": torch.tensor([[0.5, 0, 0.5]])}
        l1, l2, l3 = (tensors["_cholesky"] + tensors["cholesky_bound"]).numpy().T
        factor = np.array([[l1, 0 * l1], [l2, l3]]).transpose(2, 0, 1)
    else:
        tensors["_scaling"] = 6 * torch.rand(n, 2, generator=random)
        tensors["_rotation"] = torch.randn(n, 1, generator=random)
        angle = 2 * np.pi * tensors["_rotation"].sigmoid().numpy()[:, 0]
        c, s = np.cos(angle), np.sin(angle)
        # of a matrix that is filled by columns, [c, -s] is the first column
        turn = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
        factor = turn @ (np.eye(2) * (tensors["_scaling"] + 0.5).numpy()[:, None])
    torch.save(tensors, tmp_path / "gaussian_model.pth.tar")
    checkpoint.main(str(tmp_path / "gaussian_model.pth.tar"), width, height, tmp_path / "out.svg")
    # Their picture: pixel (row, column) is at (column, row), colours are summed over black.
    mean = (tensors["_xyz"].tanh().numpy() + 1) / 2 * [width, height]
    offset = np.stack(np.mgrid[:height, :width][::-1], axis=-1)[:, :, None, :] - mean
    inverse = np.linalg.inv(factor @ factor.transpose(0, 2, 1))
    r2 = np.einsum("hwni,nij,hwnj->hwn", offset, inverse, offset)
    theirs = np.clip(np.exp(-r2 / 2) @ tensors["_features_dc"].numpy(), 0, 1)
    # Less than the same: Gaussians end at 3 sigma in a file, and renderers round each layer.
    assert check(np.float32(theirs), tmp_path / "out.svg").psnr > 30


def test_a_checkpoint_of_image_gs_is_fitted_to_its_picture(tmp_path, capsys):
    torch = pytest.importorskip("torch")
    checkpoint = importlib.import_module("checkpoint")
    width, height, n = 40, 30, 40
    random = torch.Generator().manual_seed(2)
    state = {
        "xy": torch.rand(n, 2, generator=random),
        "scale": 1 / (2 + 4 * torch.rand(n, 2, generator=random)),
        "rot": torch.randn(n, 1, generator=random),
        "feat": torch.rand(n, 3, generator=random),
        "vis_feat": torch.rand(n, 3, generator=random),
    }
    file = {"step": 9, "psnr": 1.0, "state_dict": state, "optim_state_dict": {"state": {}}}
    path, out = tmp_path / "ckpt_step-9.pt", tmp_path / "out.svg"
    torch.save(file, path)
    checkpoint.main(str(path), width, height, str(out))
    assert said(capsys)[-1] == "<gauss2svg.Scene 40x30, 40 Gaussians>"
    _, picture = checkpoint.image_gs(checkpoint.loaded(path), width, height)
    assert check(np.float32(picture), out).psnr > 26


class Bomb:
    def __init__(self, folder):
        self.folder = folder

    def __reduce__(self):
        return os.mkdir, (self.folder,)


def test_a_checkpoint_runs_no_code(tmp_path):
    torch = pytest.importorskip("torch")
    checkpoint = importlib.import_module("checkpoint")
    path, folder = tmp_path / "bad.pt", tmp_path / "made"
    torch.save({"state_dict": Bomb(str(folder))}, path)
    with pytest.raises(SystemExit, match="must have tensors and plain numbers alone"):
        checkpoint.main(str(path), 8, 8, str(tmp_path / "out.svg"))
    assert not folder.exists()


def test_a_poster_is_the_scene_in_strips_with_boxes_and_a_profile(tmp_path):
    pikepdf = pytest.importorskip("pikepdf")
    poster = importlib.import_module("poster")
    scene = random_scene(60, 30, 50, sigma=(0.5, 12))
    levels = np.concatenate(list(poster.strips(scene, 40, 600)))
    grown = scene.scaled(12)
    whole = render(grown.replace(width=40, mean=grown.mean - [160, 0]))
    assert np.abs(levels - 255 * np.clip(whole, 0, 1)).max() < 0.6
    poster.DPI = 10
    poster.write_poster(scene, str(tmp_path / "poster.pdf"), 0.5)
    with pikepdf.open(tmp_path / "poster.pdf") as pdf:
        [page] = pdf.pages
        box = np.array([float(one) for one in page.TrimBox]) / 72 * 25.4
        assert box[2:] - box[:2] == pytest.approx([297, 420], abs=2)
        picture = pikepdf.PdfImage(page.Resources.XObject.Picture)
        assert picture.icc.profile.profile_description.startswith("sRGB")
        drawn = np.asarray(picture.as_pil_image().convert("RGB"))
    assert (drawn == np.concatenate(list(poster.strips(scene, 119, 168)))).all()


INKEX = "/usr/share/inkscape/extensions"
DOCUMENT = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
width="90" height="60"><clipPath id="round"><circle cx="50" cy="30" r="18"/></clipPath>
<filter id="far"><feGaussianBlur stdDeviation="2"/></filter>
<image id="photo" {} xlink:href="data:image/png;base64,{}"/><text id="other">!</text></svg>"""
FRAME = 'x="10" y="5" width="72" height="48" transform="rotate(3)" preserveAspectRatio="none"'


@pytest.fixture
def extension(small, tmp_path, monkeypatch):
    """A document with a photo, and an environment in which Inkscape's Python finds gauss2svg."""
    python = "/usr/bin/python3"
    asked = [python, "-c", "import inkex"]
    found = {**os.environ, "PYTHONPATH": INKEX}
    if (
        not os.path.exists(python)
        or subprocess.run(asked, env=found, capture_output=True).returncode
    ):
        pytest.skip("Inkscape's extensions need its inkex, and lxml")
    program = tmp_path / "bin" / "gauss2svg"
    program.parent.mkdir()
    package = EXAMPLES.parent
    run = f'PYTHONPATH="{package}" exec "{sys.executable}" -m gauss2svg "$@"'
    program.write_text(f"#!/bin/sh\n{run}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
    data = base64.b64encode(Path(small).read_bytes()).decode()
    path = tmp_path / "document.svg"
    path.write_text(DOCUMENT.format(FRAME, data))
    return path


def converted(document, *options):
    """Exit status, new document and message of the script as Inkscape starts it."""
    script = str(EXAMPLES / "inkscape" / "photo_to_gaussians.py")
    given = ["--quality=draft", "--kilobytes=5", "--program=gauss2svg", *options, str(document)]
    run = subprocess.run(
        ["/usr/bin/python3", script, *given], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": INKEX},
    )  # fmt: skip
    return run.returncode, run.stdout, run.stderr


def assert_looks_the_same(before, after):
    size = 90, 60
    drawn, wanted = (rasterize(text, *size) for text in (after, before))
    assert psnr(drawn, wanted) > max(20, 6 + psnr(np.ones_like(wanted), wanted))
    assert "<image" not in after
    assert 'id="other"' in after


@pytest.mark.parametrize(
    "attributes",
    [
        FRAME, 'x="10" y="5" transform="scale(2)"', 'x="10%" width="80%" height="50%"',
        'x="10" y="5" width="50" height="50" preserveAspectRatio="xMinYMid slice"',
        'x="10" width="70" height="20" preserveAspectRatio="xMaxYMid"',
        'width="90" height="60" clip-path="url(#round)" transform="rotate(9)"',
        'width="90" height="60" style="opacity:.4;filter:url(#far);stroke:#000;fill-opacity:.1"',
    ],
)  # fmt: skip
def test_gaussians_are_as_large_as_cut_and_as_styled_as_the_photo_was(extension, attributes):
    before = extension.read_text().replace(FRAME, attributes)
    extension.write_text(before)
    status, after, message = converted(extension, "--id=photo")
    assert (status, message) == (0, "")
    assert_looks_the_same(before, after)


def test_an_error_of_the_extension_is_one_line_and_changes_nothing(extension):
    status, after, message = converted(extension, "--id=photo", "--program=/no/such")
    assert (status != 0, after, len(message.strip().splitlines())) == (True, "", 1)
    assert message.startswith("program must be that of gauss2svg; got '/no/such'")


@pytest.mark.browser
def test_inkscape_runs_its_extension(extension, tmp_path):
    if not shutil.which("inkscape") or not shutil.which("xvfb-run"):
        pytest.skip("needs Inkscape and xvfb-run")
    clipped = extension.read_text().replace('id="photo"', 'id="photo" clip-path="url(#round)"')
    extension.write_text(clipped)
    profile, out = tmp_path / "profile", tmp_path / "out.svg"
    shutil.copytree(EXAMPLES / "inkscape", profile / "extensions" / "gauss2svg")
    actions = f"select-by-id:photo;org.gauss2svg.photo.noprefs;export-filename:{out};export-do"
    environment = {**os.environ, "INKSCAPE_PROFILE_DIR": str(profile), "HOME": str(tmp_path)}
    environment.pop("PYTHONPATH", None)
    subprocess.run(
        ["xvfb-run", "-a", "inkscape", "--batch-process", str(extension), f"--actions={actions}"],
        env=environment, check=True, capture_output=True, timeout=300,
    )  # fmt: skip
    assert_looks_the_same(extension.read_text(), out.read_text())


def test_a_page_of_the_vite_project_has_each_photo_over_its_placeholder(
    photo, tmp_path, monkeypatch
):
    if not shutil.which("node"):
        pytest.skip("needs node")
    project = shutil.copytree(
        EXAMPLES / "vite", tmp_path / "vite", ignore=shutil.ignore_patterns("node_modules")
    )
    (project / "public" / "photos").mkdir(parents=True)
    Image.fromarray(np.uint8(255 * photo[:48, :64])).save(project / "public/photos/a cup.png")
    monkeypatch.chdir(project)
    script = json.loads(Path("package.json").read_text())["scripts"]["placeholders"]
    assert main(script.split()[1:]) == 0
    code = """import config from "./vite.config.js"; import { readFileSync } from "node:fs";
        console.log(config.plugins[0].transformIndexHtml(readFileSync("index.html", "utf8")))"""
    node = ["node", "--input-type=module", "--eval", code]
    page = subprocess.run(node, capture_output=True, text=True, check=True, timeout=60).stdout
    [attributes] = re.findall("<img (.*)>", page)
    assert 'src="/photos/a%20cup.png" alt="" width="64" height="48"' in attributes
    uri = re.search(r"url\('data:image/svg\+xml;base64,([^']+)'\)", attributes)[1]
    assert check("public/photos/a cup.png", base64.b64decode(uri)).psnr > 15
