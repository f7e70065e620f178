"""Laws of notebooks: what scenes and results show of themselves, and a run that shows itself."""

import base64
import io
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import random_scene
from PIL import Image
from rich.console import Console

import gauss2svg
from gauss2svg.fit import FitProgress
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.options import Progress
from gauss2svg.pipeline.run import watched
from gauss2svg.render import render

_SOURCE = re.compile(r'<img [^>]*src="data:image/jpeg;base64,([^"]+)"')


def shown(page: str) -> np.ndarray:
    """The JPEG of a page, of which there is one."""
    [data] = _SOURCE.findall(page)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))), np.float32) / 255


def test_a_scene_shows_its_name_and_its_picture_which_is_small_at_any_size():
    scene = random_scene(30, sigma=(3, 8), beta=(0.5, 1.0))
    assert repr(scene) == "<gauss2svg.Scene 40x30, 30 Gaussians>"
    assert "additive" in repr(gauss2svg.Scene(4, 3, blend="add"))
    assert "transparent" in repr(gauss2svg.Scene(4, 3, transparent=True))
    assert psnr(shown(scene._repr_html_()), render(scene)) > 30
    assert shown(scene.scaled(1e6, 2e6)._repr_html_()).shape == (768, 512, 3)


def test_a_scene_shows_itself_however_it_is_imported_and_loads_a_renderer_for_that_alone():
    code = (
        "from gauss2svg.svg.read import read_svg; import sys; scene = read_svg(sys.argv[1]); "
        "print('numba' in sys.modules, scene._repr_html_()[:5], 'numba' in sys.modules)"
    )
    command = [sys.executable, "-c", code, gauss2svg.write_svg(gauss2svg.Scene(4, 3))]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "<img", "True"]


RUNS = {
    "vectorize": lambda picture, shows: gauss2svg.vectorize(picture, gaussians=5, progress=shows),
    "placeholder": lambda picture, shows: gauss2svg.placeholder(picture, 400, progress=shows),
}


@pytest.fixture
def terminal(monkeypatch):
    """What a terminal has been told."""
    written = io.StringIO()
    console = Console(file=written, force_terminal=True, width=120)
    monkeypatch.setattr("rich.console.Console", lambda stderr: console)
    return written


@pytest.mark.parametrize("run", RUNS.values(), ids=RUNS)
def test_a_run_that_shows_itself_is_the_same_and_is_quiet_where_nobody_looks(run, photo, capfd):
    assert len({run(photo[:32, :32], shows).svg for shows in (None, True)}) == 1
    assert capfd.readouterr() == ("", "")
    with pytest.raises(gauss2svg.InputError, match="progress must be"):
        run(photo[:32, :32], 1)


def test_a_terminal_shows_how_long_a_run_will_take(terminal):
    now = FitProgress(2, 30, 0.4, 120, 27.123, 1.0, 3.2, scene=lambda: random_scene(1))
    with watched(True) as callback:
        assert callback is not None
        callback(Progress("read"))
        callback(Progress("fit", now))
    assert "fitting, round 2: 120 shapes, 27.12 dB, 3 s left" in terminal.getvalue()


@pytest.mark.process
def test_a_notebook_shows_the_forming_picture_and_keeps_the_last(photo, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    Image.fromarray(np.uint8(255 * photo)).save(tmp_path / "photo.png")
    cells = [
        "import gauss2svg",
        'result = gauss2svg.vectorize("photo.png", gaussians=800, progress=True)',
        "result",
        "result.scene",
        "print(result.scene)",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    updates = []

    class Client(nbclient.NotebookClient):
        def process_message(self, msg, cell, cell_index):
            if msg["msg_type"] == "update_display_data":
                updates.append(msg["content"]["data"]["text/html"])
            return super().process_message(msg, cell, cell_index)

    Client(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert len([page for page in updates if "<img" in page]) > 2
    assert any("fitting" in page for page in updates)
    forming, drawn, scene, printed = (cell.outputs for cell in book.cells[1:])
    [output] = forming
    page = output["data"]["text/html"]
    assert page == updates[-1]
    assert "800 shapes" in page
    assert "left" not in page
    assert psnr(shown(page), photo) > 25
    assert drawn[0]["data"]["text/html"].startswith("<img ")
    assert psnr(shown(scene[0]["data"]["text/html"]), photo) > 25
    assert printed[0]["text"] == "<gauss2svg.Scene 128x128, 800 Gaussians>\n"
