"""examples/: each script does what its first line says."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from batches import save_photos
from PIL import Image

from gauss2svg.measure.check import check

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
    for steps in (0, 40):
        loss.main(small, str(out), n=30, steps=steps)
        psnr.append(check(small, str(out)).psnr)
    assert psnr[1] > psnr[0] + 3
    assert said(capsys)[-1] == f"{psnr[1]:.2f} dB"


def test_a_guide_shows_every_example():
    pages = "".join(p.read_text() for p in (EXAMPLES.parent / "docs" / "guide").glob("*.md"))
    for path in EXAMPLES.glob("*.py"):
        assert f"{{literalinclude}} ../../examples/{path.name}" in pages
