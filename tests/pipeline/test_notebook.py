"""Laws of notebooks: what results show of themselves, and a run that shows itself."""

import base64
import io
import re
import time

import numpy as np
import pytest
from PIL import Image
from scenes import random_areas, random_scene

import gauss2svg
from gauss2svg.fit import FitProgress
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline import progress_display
from gauss2svg.pipeline.options import Progress
from gauss2svg.pipeline.placeholder import Placeholder
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.render import as_jpeg, render


def shown(jpeg: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(jpeg)), np.float32) / 255


def test_a_scene_shows_its_name_and_its_picture_is_small_at_any_size():
    scene = random_scene(30, sigma=(3, 8), beta=(0.5, 1.0))
    assert repr(scene) == "<gauss2svg.Scene 40x30, 30 Gaussians>"
    assert "additive" in repr(gauss2svg.Scene(4, 3, blend="add"))
    assert "transparent" in repr(gauss2svg.Scene(4, 3, transparent=True))
    assert psnr(shown(as_jpeg(scene)), render(scene)) > 30
    drawing = scene.replace(areas=random_areas(3, 1))
    assert len(repr(drawing.areas)) < 200
    assert psnr(shown(as_jpeg(drawing)), render(drawing)) > 28
    assert shown(as_jpeg(scene.scaled(1e6, 2e6))).shape == (768, 512, 3)


def test_a_placeholder_shows_a_line_and_a_picture():
    svg = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"/>'
    small = Placeholder(svg, 32, 32, "#888888", 3)
    assert small._repr_html_().count("<img ") == 1
    assert re.fullmatch(r"<gauss2svg.Placeholder 32x32, .* Gaussians, \d+ bytes>", repr(small))


def test_a_run_that_shows_itself_is_the_same_and_is_quiet_where_nobody_looks(
    photo, capfd, monkeypatch, hasty
):
    run = gauss2svg.vectorize
    files = [run(photo[:32, :32], progress=shows).svg for shows in (None, True)]
    assert capfd.readouterr() == ("", "")
    monkeypatch.setattr("sys.stderr", None)  # as without a console
    assert {run(photo[:32, :32], progress=True).svg, *files} == {files[0]}
    with pytest.raises(gauss2svg.InputError, match="progress must be"):
        run(photo[:32, :32], progress=1)


def test_a_terminal_shows_how_long_a_run_will_take(monkeypatch):
    monkeypatch.setattr("sys.stderr", written := io.StringIO())
    written.isatty = lambda: True
    monkeypatch.setattr("gauss2svg.pipeline.progress_display.columns", lambda: 80)
    now = FitProgress(2, 30, 0.4, 120, 27.123, 1.0, 3.2, scene=lambda: random_scene(1))
    with watched(True) as callback:
        assert callback is not None
        callback(Progress("fit", now))
    *_, drawn, _, cleared, _ = written.getvalue().split("\r")
    assert "fitting, round 2, 3 s left: 120 shapes, 27.12 dB" in drawn
    assert (len(drawn), cleared.strip()) == (79, "")


def test_where_there_is_no_terminal_a_line_comes_from_time_to_time_while_a_task_runs(monkeypatch):
    monkeypatch.setattr("sys.stderr", written := io.StringIO())
    monkeypatch.setattr(progress_display, "LINE_EVERY_S", 0.01)
    end = time.monotonic() + 30
    with progress_display.counting() as update:
        update("a.jpg", 1, 1200)
        while written.getvalue().count("\n") < 3 and time.monotonic() < end:
            time.sleep(0.01)
    assert re.match("(gauss2svg: 0:[0-9]{2} 1 of 1,200: a.jpg\n){2}", written.getvalue())
    with progress_display.counting(quiet=True):
        time.sleep(0.05)
        said = written.getvalue()
    assert written.getvalue() == said


@pytest.mark.process
def test_a_notebook_shows_the_forming_picture_and_keeps_the_last(photo, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    Image.fromarray(np.uint8(255 * photo)).save(tmp_path / "photo.png")
    run = 'result = gauss2svg.vectorize("photo.png", gaussians=800, progress=True)'
    cells = [nbformat.v4.new_code_cell(cell) for cell in (f"import gauss2svg; {run}", "result")]
    book = nbformat.v4.new_notebook(cells=cells)
    updates = []

    class Client(nbclient.NotebookClient):
        def process_message(self, msg, cell, cell_index):
            if msg["msg_type"] == "update_display_data":
                updates.append(msg["content"]["data"]["text/html"])
            return super().process_message(msg, cell, cell_index)

    Client(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    # A fast machine ends the fit before a second frame is due.
    assert any("<img" in page and "fitting" in page for page in updates)
    [forming], [drawn] = (cell.outputs for cell in book.cells)
    page = forming["data"]["text/html"]
    assert page == updates[-1]
    assert "800 shapes" in page
    [jpeg] = re.findall(r'<img [^>]*src="data:image/jpeg;base64,([^"]+)"', page)
    assert psnr(shown(base64.b64decode(jpeg)), photo) > 25
    assert drawn["data"]["text/html"].startswith("<img ")
