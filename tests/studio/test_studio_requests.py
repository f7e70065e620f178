"""What the studio answers to requests that run no fit: one table of hostile ones, in process."""

import json
import math
import os
from xml.etree import ElementTree

import numpy as np
import pytest
from batches import PoolHere
from pictures import png
from studio_server import answer_of

from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.studio import jobs, service
from gauss2svg.studio.routes import display_name, samples_in
from gauss2svg.studio.service import Guard, create_app

TOKEN, PORT = "t0ken", 8137
BEARER = {"Authorization": f"Bearer {TOKEN}"}
HOME = f"http://127.0.0.1:{PORT}"
STUDIO = create_app()


def ask(method: str, path: str, base: str = HOME, local: bool = True, **more):
    """The answer of a guarded studio to one request."""
    guarded = Guard(STUDIO, TOKEN, PORT, local)
    return answer_of(guarded, method, path, base, **more)


def line_of(answer) -> str:
    error = answer.json()["error"]
    assert answer.headers["content-type"] == "application/json"
    assert error == " ".join(error.split())
    assert len(error) < 600
    return error


def photo_of(data: bytes, name: str = "photo.png", **fields) -> dict:
    return {"files": {"photo": (name, data, "image/png")}, "data": fields, "headers": BEARER}


def form_of(**fields) -> dict:
    return {"files": {"x": b""}, "data": fields, "headers": BEARER}


def headers_of(**headers) -> dict:
    return {"headers": BEARER | {name.replace("_", "-"): text for name, text in headers.items()}}


def chart_of(cost: object, score: object, **more) -> dict:
    points = [{"cost": cost, "score": score, "series": 0, "text": "run"} | more]
    return json_of(json.dumps({"score": "psnr_svg", "cost": "total_s", "points": points}))


def json_of(body: str) -> dict:
    return {"headers": BEARER | {"Content-Type": "application/json"}, "content": body}


SCRIPTED = b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>'
PNG = as_png(np.zeros((8, 8, 3)))
BOMB = png(np.zeros((1, 1, 3)), size=(50_000, 50_000))
# (method, path, what comes with it, status, word of the line)
HOSTILE = [
    *(("GET", path, {}, 401, "token") for path in ("/", f"/api/options?token={TOKEN}")),
    ("GET", "/api/options", {"headers": {"Authorization": "Bearer wrong"}}, 401, "token"),
    ("GET", "/api/options", {"base": "http://rebound.example:8137"} | headers_of(), 421, "address"),
    *(("POST", "/api/jobs", headers_of(Origin=origin), 403, "another site")
      for origin in ("https://evil.example", "null", "http://127.0.0.1:9999")),
    ("POST", "/api/jobs", photo_of(BOMB), 422, "2500000000 px"),
    ("POST", "/api/jobs", photo_of(SCRIPTED, "x.svg"), 422, "SVG"),
    ("POST", "/api/jobs", photo_of(b"\x89PNG\r\n\x1a\nrubbish"), 422, "photo.png must be"),
    ("POST", "/api/jobs", form_of(sample="", of=""), 422, "the photo must be given"),
    ("POST", "/api/jobs", form_of(sample="none"), 404, "no sample none"),
    *(("POST", "/api/jobs", photo_of(PNG, options=options), 422, word) for options, word in (
        ('{"threads": 99}', "threads"), ('{"form": "blur", "renderer": "cairo"}', "renderer"),
        ("[" * 60_000, "options must be valid"),
    )),
    ("POST", "/api/chart", chart_of(math.nan, 30), 422, "points."),
    ("GET", "/api/jobs/none/picture.svg", headers_of(), 404, "no job none"),
    *(("GET", path, headers_of(), 404, "Not Found") for path in (
        "/api/jobs/none/..%2f..%2fetc%2fpasswd", "/static/..%2fservice.py", "/docs",
        "/api/samples/..%2f..%2fx",
    )),
    ("GET", "/api/zip?ids=,none", headers_of(), 404, "no job"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path", "given", "status", "word"), HOSTILE)
def test_a_hostile_request_is_one_line_and_keeps_nothing(method, path, given, status, word):
    folder = STUDIO.app.state.jobs.folder
    before = set(folder.iterdir())
    answer = ask(method, path, **given)
    assert (answer.status_code, word in line_of(answer)) == (status, True), answer.text
    assert answer.headers["cache-control"] == "no-store"
    assert set(folder.iterdir()) == before


def test_the_token_opens_the_page_by_a_cookie():
    guarded = Guard(STUDIO, TOKEN, PORT, True)
    answer = answer_of(guarded, "GET", f"/?token={TOKEN}", HOME)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    assert {"HttpOnly", "SameSite=lax"} <= set(answer.headers["set-cookie"].split("; "))
    page = ask("GET", "/", headers={"Cookie": f"a[b]=1; gauss2svg-{PORT}={TOKEN}"})
    assert page.status_code == 200
    assert TOKEN not in page.text


def test_a_port_that_is_taken_is_refused():
    # Not by the command, which would serve for ever if it took the port.
    with (
        service._listening("127.0.0.1", 0) as taken,
        pytest.raises(InputError, match="host and port must be free to listen on; got 127"),
    ):
        service._listening(*taken.getsockname()).close()


def test_nor_may_a_page_of_another_site_drive_a_mounted_studio():
    site = {"Origin": "https://evil.example"}
    assert answer_of(STUDIO, "POST", "/api/chart", HOME, headers=site).status_code == 403
    assert ask("GET", "/api/options", headers=BEARER | {"Origin": HOME}).status_code == 200
    # In a network any address of the server is its name.
    answer = ask("GET", "/api/options", f"http://[fe80::1]:{PORT}", local=False, headers=BEARER)
    assert answer.status_code == 200


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/jobs/none"])
def test_the_page_may_load_only_what_is_here_and_every_answer_has_the_headers_of_safety(path):
    answer = ask("GET", path, headers=BEARER)
    policies = answer.headers["content-security-policy"].split("; ")
    directives = dict(policy.split(" ", 1) for policy in policies)
    for name in ("default-src", "frame-ancestors", "base-uri", "form-action"):
        assert directives.pop(name) == "'none'"
    assert set(" ".join(directives.values()).split()) <= {"'self'", "blob:", "data:"}
    assert directives["script-src"] == "'self'"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    if path == "/":
        assert "://" not in answer.text.replace("http://www.w3.org/", "")


def test_a_file_name_is_shown_and_is_never_a_path():
    for given, name in {
        "../../etc/passwd": "passwd", "..\\..\\windows\\win.ini": "win.ini", "..": "photo",
        "a\0b\n\x1b[31m.png": "ab[31m.png", "\u202egnp.exe": "gnp.exe", None: "photo",
        '<img src=x onerror="alert(1)">.png': "img src=x onerror=alert(1).png",
        "x" * 500 + ".jpeg": "x" * 95 + ".jpeg", "\u00fcber s.jpg": "\u00fcber s.jpg",
    }.items():  # fmt: skip
        assert display_name(given) == name


@pytest.mark.posix
def test_samples_are_the_photos_of_a_folder_by_names_that_an_address_can_have(tmp_path):
    for name in (b"caf\xe9.png", "größe.JFIF".encode(), b".hidden.png", b"note.md"):
        (tmp_path / os.fsdecode(name)).write_bytes(PNG)
    studio = create_app(folder=tmp_path)
    samples = answer_of(studio, "GET", "/api/samples").json()
    assert {one["name"] for one in samples} == {"caf\\xe9.png", "größe.JFIF"}
    for one in samples:
        assert answer_of(studio, "GET", f"/{one['url']}").content == PNG
    with pytest.raises(InputError, match="FOLDER must be a folder with photos"):
        samples_in(tmp_path / "none")


def test_a_chart_is_drawn_and_its_texts_are_text():
    answer = ask("POST", "/api/chart", **chart_of(5.0, None, text='<b>alert(1)</b>&"'))
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"].endswith("sandbox")
    texts = [one.text for one in ElementTree.fromstring(answer.text).iter() if one.text]
    assert {'<b>alert(1)</b>&"', "time, photo to measured SVG"} <= set(texts)


def test_of_more_results_than_are_kept_the_oldest_are_forgotten(monkeypatch):
    monkeypatch.setattr(jobs, "Pool", PoolHere)
    monkeypatch.setattr(jobs, "MOST_KEPT", 2)
    monkeypatch.setattr(jobs, "fit", lambda *_: None)
    studio = create_app()
    made = [answer_of(studio, "POST", "/api/jobs", **photo_of(PNG)).json()["id"] for _ in range(5)]
    found = [answer_of(studio, "GET", f"/api/jobs/{name}").status_code for name in made]
    assert found == [404, 404, 200, 200, 200]
    assert len([*studio.app.state.jobs.folder.iterdir()]) == 3
