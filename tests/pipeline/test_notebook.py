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
from gauss2svg.fit.options import FitProgress
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.pipeline.run import Progress
from gauss2svg.render import render

_SOURCE = re.compile(r'<img [^>]*src="data:image/jpeg;base64,([^"]+)"')


def shown(page: str) -> np.ndarray:
    """The JPEG of a page, of which there is one."""
    [data] = _SOURCE.findall(page)
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))), np.float32) / 255


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_a_scene_is_named_in_one_line_of_any_number_of_shapes(count):
    text = repr(random_scene(count))
    assert text == f"<gauss2svg.Scene 40x30, {count} Gaussians>"
    assert "additive" in repr(gauss2svg.Scene(4, 3, blend="add"))
    assert "transparent" in repr(gauss2svg.Scene(4, 3, transparent=True))


def test_a_scene_shows_its_picture_in_a_notebook():
    scene = random_scene(30, sigma=(3, 8), beta=(0.5, 1.0))
    assert psnr(shown(scene._repr_html_()), render(scene)) > 30


def test_a_picture_in_a_notebook_is_small_at_any_size_of_the_canvas():
    scene = random_scene(30).scaled(1e6, 2e6)
    assert shown(scene._repr_html_()).shape == (768, 512, 3)


def test_the_public_scene_shows_itself_and_loads_no_renderer():
    code = (
        "import gauss2svg, sys; scene = gauss2svg.Scene(4, 3); print('numba' in sys.modules); "
        "print(scene._repr_html_()[:5], 'numba' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "<img", "True"]


def test_a_scene_that_was_read_shows_itself_too():
    code = (
        "from gauss2svg.svg.read import read_svg; import sys; "
        "print(read_svg(sys.argv[1])._repr_html_()[:5])"
    )
    svg = gauss2svg.write_svg(gauss2svg.Scene(4, 3))
    command = [sys.executable, "-c", code, svg]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["<img"]


def test_a_run_that_shows_itself_is_the_same_and_is_quiet_where_nobody_looks(photo, capfd):
    given = {"gaussians": 5, "run": gauss2svg.RunOptions(threads=1)}
    files = {gauss2svg.vectorize(photo[:32, :32], progress=p, **given).svg for p in (None, True)}
    assert len(files) == 1
    assert capfd.readouterr() == ("", "")
    with pytest.raises(gauss2svg.InputError, match="progress must be"):
        gauss2svg.vectorize(photo[:32, :32], progress=1, **given)  # pyright: ignore


def test_a_terminal_shows_what_a_run_does_and_how_long_it_will_take(monkeypatch):
    written = io.StringIO()
    terminal = Console(file=written, force_terminal=True, width=120)
    monkeypatch.setattr("rich.console.Console", lambda stderr: terminal)
    now = FitProgress(2, 30, 0.4, 120, 27.123, 1.0, 3.2, scene=lambda: random_scene(1))
    with watched(True) as callback:
        assert callback is not None
        callback(Progress("read"))
        callback(Progress("fit", now))
    said = written.getvalue()
    assert "fitting, round 2" in said
    assert "120 shapes, 27.12 dB, 3 s left" in said


def test_a_placeholder_shows_its_run_as_an_svg_does(photo, monkeypatch):
    written = io.StringIO()
    terminal = Console(file=written, force_terminal=True, width=120)
    monkeypatch.setattr("rich.console.Console", lambda stderr: terminal)
    made = {gauss2svg.placeholder(photo[:32, :32], 400, progress=p).svg for p in (None, True)}
    assert len(made) == 1
    assert "shapes, " in written.getvalue()
    with pytest.raises(gauss2svg.InputError, match="progress must be"):
        gauss2svg.placeholder(photo[:32, :32], 400, progress=1)  # pyright: ignore


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
