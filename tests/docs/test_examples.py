"""examples/: each script does what its first line says."""

from __future__ import annotations

import base64
import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from batches import save_photo, save_photos
from galleries import program
from gallery_site import hastily
from PIL import Image
from scenes import random_scene

from gauss2svg.measure.check import check
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.render import render

pytestmark = pytest.mark.example

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(autouse=True)
def _importable(monkeypatch, drawn_here):
    """Modules of examples; files are checked in this process, without scores."""
    monkeypatch.syspath_prepend(EXAMPLES)  # also for processes that are spawned


@pytest.fixture
def small(photo, tmp_path) -> str:
    path = tmp_path / "photo.png"
    Image.fromarray(np.uint8(255 * photo[40:64, 46:82])).save(path)
    return str(path)


def said(capsys) -> list[str]:
    return capsys.readouterr().out.splitlines()


@pytest.mark.usefixtures("hasty", "pool_here")
def test_a_folder_of_photos_becomes_svgs_and_a_bad_one_costs_itself(tmp_path, capsys):
    photos = save_photos(tmp_path / "photos", ["a.png", "sub/b.png"])
    (photos / "bad.png").write_bytes(b"no picture")
    folder = importlib.import_module("folder")
    assert folder.main(str(photos), str(tmp_path / "out"), workers=1) == 1
    good, bad, below = sorted(said(capsys))
    assert good.startswith("a.svg ")
    assert good.endswith(f"dB, {(tmp_path / 'out' / 'a.svg').stat().st_size} bytes")
    assert re.match(r"bad\.svg .*bad\.png must be", bad)
    assert below.startswith("sub/b.svg ")


def test_a_cluster_does_what_is_new_and_counts_it(tmp_path, capsys):
    distributed = pytest.importorskip("distributed")

    photos = str(save_photos(tmp_path / "photos", ["a.png", "b.png"]))
    local = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with distributed.LocalCluster(**local) as cluster:
        for counted in ("2 written", "2 skipped"):
            example = importlib.import_module("cluster")
            assert example.main(cluster.scheduler_address, photos, str(tmp_path / "out")) == 0
            assert said(capsys)[-1] == counted


def test_the_service_answers_svgs_and_refusals(small, monkeypatch):
    testing = pytest.importorskip("fastapi.testclient")
    service = importlib.import_module("service")
    monkeypatch.setattr(service, "WORKERS", 1)
    monkeypatch.setattr(service, "MOST_BYTES", 9999)
    photo = save_photo(Path(small), 0).read_bytes()  # smaller still
    with testing.TestClient(service.app) as client:
        uploads = [photo, b"no picture", bytes(10_000)]
        drawn, *refused = (client.post("/vectorize", content=data) for data in uploads)
    assert (drawn.status_code, drawn.headers["content-type"]) == (200, "image/svg+xml")
    assert check(small, drawn.content).report["psnr_svg"] > 15
    assert [answer.status_code for answer in refused] == [422, 413]
    assert all(" must be " in one.text and "\n" not in one.text for one in refused)


def test_a_tracer_of_ones_own_is_beside_ours_in_tables_and_pages(small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with hastily():
        importlib.import_module("tracer").main(small)
    for name, label in (("bench/bench.json", "label"), ("site/gallery.json", "variant")):
        rows = json.loads(Path(name).read_text())["rows"]
        assert {row[label] for row in rows} == {"draft", "mine"}
        assert all(row["psnr_svg"] > 10 and row["svg_bytes"] > 0 for row in rows)


def test_a_torch_loss_in_the_fit_is_about_as_close_as_the_usual_one(small, tmp_path, capsys):
    pytest.importorskip("torch")
    importlib.import_module("loss").main(small, str(tmp_path / "out.svg"), 40, 60)
    usual, own = (re.fullmatch(r"(\w+): (.*) dB by (\d+) Gaussians", line) for line in said(capsys))
    assert (usual[1], own[1], usual[3]) == ("weighted", "loss_of", own[3])
    assert abs(float(own[2]) - float(usual[2])) < 1.5
    assert check(small, tmp_path / "out.svg").report["psnr_svg"] == pytest.approx(
        float(own[2]), abs=0.01
    )


@pytest.mark.parametrize("layout", ["_cholesky", "_scaling"])
def test_a_checkpoint_of_gaussian_image_becomes_its_picture(layout, tmp_path):
    """Pixel (row, column) of theirs is at (column, row), and rotations turn from +y to +x."""
    torch, rng = pytest.importorskip("torch"), np.random.default_rng(1)
    xy, color = rng.uniform(-1, 1, (20, 2)), rng.uniform(-0.2, 0.8, (20, 3))
    scale, turns = rng.uniform(0.5, 6.5, (20, 2)), rng.normal(size=(20, 1))
    angle = 2 * np.pi / (1 + np.exp(-turns[:, 0]))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    factor = turn.transpose(2, 0, 1) * scale[:, None]
    covariance, bound = factor @ factor.transpose(0, 2, 1), np.array([[0.5, 0, 0.5]])
    tensors = {"_xyz": np.arctanh(xy), "_features_dc": color, "_opacity": np.ones((20, 1))}
    if layout == "_cholesky":
        lower = np.linalg.cholesky(covariance)[:, [0, 1, 1], [0, 0, 1]]
        tensors |= {"_cholesky": lower - bound, "cholesky_bound": bound}
    else:
        tensors |= {"_scaling": scale - 0.5, "bound": bound[:, ::2], "_rotation": turns}
    path, out = tmp_path / "gaussian_model.pth.tar", tmp_path / "out.svg"
    torch.save({name: torch.tensor(array) for name, array in tensors.items()}, path)
    importlib.import_module("checkpoint").main(str(path), 48, 32, out)
    offset = np.stack(np.mgrid[:32, :48][::-1], axis=-1)[:, :, None] - (xy + 1) / 2 * [48, 32]
    r2 = np.einsum("hwni,nij,hwnj->hwn", offset, np.linalg.inv(covariance), offset)
    # Less than the same: Gaussians end at 3 sigma in a file, and renderers round each layer.
    assert check(np.float32(np.clip(np.exp(-r2 / 2) @ color, 0, 1)), out).report["psnr_svg"] > 30


def test_a_checkpoint_of_image_gs_is_fitted_to_its_picture_and_runs_no_code(tmp_path, capsys):
    torch = pytest.importorskip("torch")
    checkpoint = importlib.import_module("checkpoint")
    random = torch.Generator().manual_seed(2)
    sizes = {"xy": 2, "scale": 2, "rot": 1, "feat": 3, "vis_feat": 3}
    state = {name: torch.rand(40, size, generator=random) for name, size in sizes.items()}
    state["scale"] = 1 / (2 + 4 * state["scale"])
    path, out, folder = str(tmp_path / "ckpt.pt"), tmp_path / "out.svg", tmp_path / "made"
    torch.save({"step": 9, "psnr": 1.0, "state_dict": state}, path)
    checkpoint.main(path, 40, 30, str(out))
    assert said(capsys)[-1] == "<gauss2svg.Scene 40x30, 40 Gaussians>"
    _, picture = checkpoint.image_gs(checkpoint.loaded(path), 40, 30)
    assert check(np.float32(picture), out).report["psnr_svg"] > 26

    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(folder),)

    torch.save({"state_dict": Bomb()}, path)
    with pytest.raises(SystemExit, match="must have tensors and plain numbers alone"):
        checkpoint.main(path, 8, 8, str(out))
    assert not folder.exists()


def test_a_poster_is_the_scene_with_boxes_and_a_profile(tmp_path, monkeypatch):
    pikepdf = pytest.importorskip("pikepdf")
    poster = importlib.import_module("poster")
    monkeypatch.setattr(poster, "DPI", 50)  # 597 x 841 px, in four strips
    scene = random_scene(60, 30, 50, sigma=(0.5, 12))
    poster.write_poster(scene, str(tmp_path / "poster.pdf"))
    with pikepdf.open(tmp_path / "poster.pdf") as pdf:
        [page] = pdf.pages
        box = np.array([float(one) for one in page.TrimBox]) / 72 * 25.4
        assert box[2:] - box[:2] == pytest.approx([297, 420], abs=0.3)
        picture = pikepdf.PdfImage(page.Resources.XObject.Picture)
        assert picture.icc.profile.profile_description.startswith("sRGB")
        drawn = np.asarray(picture.as_pil_image().convert("RGB"))
    height, width, _ = drawn.shape
    grown = scene.scaled(width / 30)  # covers the page, and as much is cut off above as below
    beyond = [0, (grown.height - height) / 2]
    whole = render(grown.replace(width=width, height=height, mean=grown.mean - beyond))
    assert np.abs(drawn - 255 * np.clip(whole, 0, 1)).max() < 0.6


DOCUMENT = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"
width="90" height="60"><clipPath id="round"><circle cx="50" cy="30" r="18"/></clipPath>
<image id="photo" {} xlink:href="data:image/png;base64,{}"/><text id="other">!</text></svg>"""


@pytest.mark.parametrize(
    "attributes",
    [
        'x="10" y="5" width="72" height="48" transform="rotate(3)" preserveAspectRatio="none"',
        'x="10" width="70" height="20" preserveAspectRatio="xMaxYMid"',
        'width="90" height="60" style="opacity:.4;stroke:#000;fill-opacity:.1"',
    ],
)  # fmt: skip
def test_gaussians_are_as_large_as_cut_and_as_styled_as_the_photo_was(attributes, small, tmp_path):
    pytest.importorskip("inkex", reason="needs the inkex of Inkscape's extensions")
    run = f'PYTHONPATH="{EXAMPLES.parent}" exec "{sys.executable}" -m gauss2svg "$@"'
    ours = program(tmp_path / "bin" / "gauss2svg", run)
    before = DOCUMENT.format(attributes, base64.b64encode(Path(small).read_bytes()).decode())
    (tmp_path / "document.svg").write_text(before)
    script = [sys.executable, EXAMPLES / "inkscape" / "photo_to_gaussians.py"]
    given = ["--quality=draft", "--kilobytes=5", f"--program={ours}", "--id=photo"]
    command = [*script, *given, tmp_path / "document.svg"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    drawn, wanted = (rasterize(text, 90, 60) for text in (run.stdout, before))
    assert psnr(drawn, wanted) > max(20, 6 + psnr(np.ones_like(wanted), wanted))
    assert "<image" not in run.stdout
    assert 'id="other"' in run.stdout
