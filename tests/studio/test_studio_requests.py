"""What the studio answers to requests that run no fit: one table of hostile ones, in process."""

import asyncio
import errno
import json
import math
import os
import shutil
import struct
import zlib
from xml.etree import ElementTree

import numpy as np
import pytest
from pictures import chunk
from PIL import ExifTags, Image
from studio_server import answer_of

from gauss2svg.errors import InputError
from gauss2svg.files import as_png
from gauss2svg.measure.scores import SCORES
from gauss2svg.studio import guard, jobs, routes
from gauss2svg.studio.guard import PICTURE_POLICY, Guard
from gauss2svg.studio.service import create_app
from gauss2svg.studio.uploads import display_name, samples_in, size_of, stem_of

TOKEN, PORT = "t0ken", 8137
BEARER = {"Authorization": f"Bearer {TOKEN}"}
HOME = f"http://127.0.0.1:{PORT}"
STUDIO = create_app()


def ask(method: str, path: str, base: str = HOME, local: bool = True, **more):
    """The answer of a guarded studio to one request."""
    guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1", "localhost", "[::1]"}, local)
    return answer_of(guarded, method, path, base, **more)


def line_of(answer) -> str:
    error = answer.json()["error"]
    assert answer.headers["content-type"] == "application/json"
    assert error == " ".join(error.split())
    assert len(error) < 600
    return error


def bomb() -> bytes:
    """A PNG of 50 000 x 50 000 px in a few bytes."""
    head = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    chunks = (b"IHDR", head), (b"IDAT", zlib.compress(b"")), (b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*one) for one in chunks)


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
LONG = {"Content-Length": str(2 * 10**9), "Content-Type": "multipart/form-data"}
COOKIE = f"gauss2svg-{PORT}={TOKEN}"
# (method, path, what comes with it, status, word of the line)
HOSTILE = [
    *(("GET", path, {}, 401, "token") for path in ("/", "/api/options", "/static/main.js")),
    ("GET", "/api/options", {"headers": {"Authorization": "Bearer wrong"}}, 401, "token"),
    ("GET", "/api/options", {"headers": {"Authorization": f"Basic {TOKEN}"}}, 401, "token"),
    ("GET", "/api/options", {"headers": {"Authorization": TOKEN}}, 401, "token"),
    ("GET", "/api/options", {"headers": {"Cookie": f"gauss2svg-1={TOKEN}"}}, 401, "token"),
    ("GET", f"/api/options?token={TOKEN}", {}, 401, "token"),
    ("GET", "/?token=junk", {}, 401, "token"),
    ("GET", "/?token=", {}, 401, "token"),
    ("GET", "/api/options", {"base": "http://rebound.example:8137"} | headers_of(), 421, "address"),
    ("GET", "/", {"base": "http://192.168.1.7:8137"} | headers_of(), 421, "address"),
    ("GET", "/", headers_of(Host="["), 421, "address"),
    ("POST", "/api/jobs", headers_of(Origin="https://evil.example"), 403, "another site"),
    ("POST", "/api/jobs", headers_of(Origin="null"), 403, "another site"),
    ("POST", "/api/jobs", headers_of(Origin="http://["), 403, "another site"),
    ("POST", "/api/jobs", headers_of(Origin="http://127.0.0.1:9999"), 403, "another site"),
    ("POST", "/api/jobs", {"headers": BEARER | LONG}, 413, "256 MB"),
    ("POST", "/api/chart", json_of(" " * 5_000_000), 413, "4 MB"),
    ("POST", "/api/jobs", photo_of(bomb()), 422, "2500000000 px"),
    ("POST", "/api/jobs", photo_of(SCRIPTED, "x.svg"), 422, "SVG"),
    ("POST", "/api/jobs", photo_of(b"no photo"), 422, "photo.png must be"),
    ("POST", "/api/jobs", photo_of(b"\x89PNG\r\n\x1a\nrubbish"), 422, "photo.png must be"),
    ("POST", "/api/jobs", {"headers": BEARER}, 422, "the photo must be given"),
    ("POST", "/api/jobs", form_of(), 422, "the photo must be given"),
    ("POST", "/api/jobs", form_of(sample="", of=""), 422, "the photo must be given"),
    ("POST", "/api/jobs", form_of(photo="photo.png"), 422, "photo must be valid; got 'photo.png'"),
    ("POST", "/api/jobs", form_of(sample="none"), 404, "no sample none"),
    ("POST", "/api/jobs", form_of(of="none"), 404, "no job none"),
    ("POST", "/api/jobs", form_of(options="x" * 2_000_000), 400, "maximum size"),
    *(("POST", "/api/jobs", photo_of(PNG, options=options), 422, word) for options, word in (
        ('{"inks": "/etc/passwd.gpl"}', "inks"), ('{"threads": 99}', "threads"),
        ('{"form": "blur", "renderer": "cairo"}', "renderer"), ('{"max_pixels": 1}', "max_pixels"),
        ('{"nonsense": 1}', "nonsense"), ('{"gaussians": -1}', "gaussians"), ("[]", "options"),
        ("{", "options must be valid"), ("NaN", "options"), ("[" * 60_000, "options must be valid"),
    )),
    ("POST", "/api/chart", json_of("no JSON"), 422, "must be valid"),
    ("POST", "/api/chart", json_of("[1]"), 422, "the body must be"),
    ("POST", "/api/chart", json_of(""), 422, "the body must be valid"),
    ("POST", "/api/chart", json_of("[" * 60_000), 400, "body"),
    *(("POST", "/api/chart", chart_of(*point), 422, "points.") for point in (
        (0, 30), (-1, 30), (1e300, 30), (5, 1e300), (math.nan, 30), (5, math.inf), ("5 s", 30),
    )),
    ("GET", "/api/jobs/none", headers_of(), 404, "no job none"),
    ("GET", "/api/jobs/none/picture.svg", headers_of(), 404, "no job none"),
    ("GET", "/api/jobs/none/..%2f..%2fetc%2fpasswd", headers_of(), 404, "Not Found"),
    ("GET", "/static/..%2fservice.py", headers_of(), 404, "Not Found"),
    ("GET", "/static/../service.py", headers_of(), 404, "Not Found"),
    ("GET", "/api/samples/..%2f..%2fx", headers_of(), 404, "Not Found"),
    ("GET", "/api/zip", headers_of(), 422, "ids must be valid; got None (Field required)"),
    ("GET", "/api/zip?ids=,", headers_of(), 404, "no job"),
    ("GET", "/api/zip?ids=none", headers_of(), 404, "no job none"),
    ("GET", "/api/zip?ids=a&gzip=2", headers_of(), 422, "gzip must be valid; got '2'"),
    ("GET", "/api/zip?ids=a&markup=small", headers_of(), 422, "markup must be valid; got 'small'"),
    ("GET", "/docs", headers_of(), 404, "Not Found"),
    ("PUT", "/api/jobs", headers_of(), 405, "Not Allowed"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path", "given", "status", "word"), HOSTILE)
def test_a_hostile_request_is_one_line_and_keeps_nothing(method, path, given, status, word):
    folder = STUDIO.app.state.jobs.folder
    before = set(folder.iterdir())
    answer = ask(method, path, **given)
    assert (answer.status_code, word in line_of(answer)) == (status, True), answer.text
    assert answer.headers["cache-control"] == "no-store"
    assert set(folder.iterdir()) == before


def test_the_table_has_the_statuses_that_are_documented():
    text = (os.path.dirname(__file__), "..", "..", "docs", "reference", "errors.md")
    with open(os.path.join(*text), encoding="utf-8") as page:
        documented = {int(line[2:5]) for line in page if line[2:5].isdecimal()} - {130, 143}
    asked = {status for *_, status, _ in HOSTILE} - {405}
    assert documented == asked | {408, 409, 429, 507}  # of the tests below and of the server's


def test_the_token_and_a_ticket_open_the_page_by_a_cookie_and_the_ticket_once():
    guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1"}, True)
    ticket = guarded.ticket
    for given, status in ((ticket, 303), (ticket, 401), (TOKEN, 303)):
        answer = answer_of(guarded, "GET", f"/?token={given}", HOME)
        assert answer.status_code == status
    assert answer.headers["location"] == "/"
    assert {"HttpOnly", "SameSite=lax"} <= set(answer.headers["set-cookie"].split("; "))
    for odd in ("a[b]=1", "x=\\", 'q="open', "=", "{j}=1", f"gauss2svg-{PORT}=junk"):
        # Of two of one name browsers send that of the longest path first.
        page = ask("GET", "/", headers={"Cookie": f"{odd}; {COOKIE}"})
        assert page.status_code == 200, odd
        assert TOKEN not in page.text


@pytest.mark.parametrize(
    ("base", "status"), [("http://192.168.1.7:8137", 200), ("http://rebound.example:8137", 421)]
)
def test_in_a_network_digits_are_an_address_and_strange_names_are_not(base, status):
    assert ask("GET", "/", base=base, headers=BEARER, local=False).status_code == status


def test_nor_may_a_page_of_another_site_drive_a_mounted_studio():
    site = {"Origin": "https://evil.example"}
    assert answer_of(STUDIO, "POST", "/api/chart", HOME, headers=site).status_code == 403
    own = BEARER | {"Origin": HOME}
    assert ask("GET", "/api/options", headers=own).status_code == 200


def test_the_page_may_load_only_what_is_here_and_every_answer_has_the_headers_of_safety():
    for path in ("/", "/static/main.js", "/api/options", "/api/jobs/none", "/no"):
        answer = ask("GET", path, headers=BEARER)
        directives = dict(
            one.split(" ", 1) for one in answer.headers["content-security-policy"].split("; ")
        )
        for name in ("default-src", "frame-ancestors", "base-uri", "form-action"):
            assert directives.pop(name) == "'none'"
        sources = {word for words in directives.values() for word in words.split()}
        assert sources <= {"'self'", "blob:", "data:"}
        assert directives["script-src"] == "'self'"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
    assert (
        ask("GET", "/static/main.js", headers=BEARER)
        .headers["content-type"]
        .startswith("text/javascript")
    )
    assert "://" not in ask("GET", "/", headers=BEARER).text.replace("http://www.w3.org/", "")


def test_an_upload_whose_length_is_not_said_ends_at_the_bound(monkeypatch):
    monkeypatch.setattr(guard, "MOST_UPLOADED", 10**6)
    sent = 0

    async def long():
        nonlocal sent
        yield b'--x\r\nContent-Disposition: form-data; name="photo"; filename="a.png"\r\n\r\n'
        while sent < 20e6:
            sent += 1 << 16
            yield bytes(1 << 16)

    headers = BEARER | {"Content-Type": "multipart/form-data; boundary=x"}
    answer = ask("POST", "/api/jobs", headers=headers, content=long())
    assert (answer.status_code, "1 MB" in line_of(answer)) == (413, True)
    assert sent < 1.5e6


def test_a_body_that_stops_coming_is_given_up(monkeypatch):
    monkeypatch.setattr(guard, "PAUSE_S", 0.05)

    async def stuck():
        yield b"--x\r\n"
        await asyncio.sleep(60)

    headers = BEARER | {"Content-Type": "multipart/form-data; boundary=x"}
    answer = ask("POST", "/api/jobs", headers=headers, content=stuck())
    assert (answer.status_code, "without long pauses" in line_of(answer)) == (408, True)


def test_a_photo_that_the_disk_does_not_take_is_a_line_without_its_path(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left", "/private")

    monkeypatch.setattr(shutil, "copyfileobj", refuse)
    answer = ask("POST", "/api/jobs", **photo_of(PNG))
    assert (answer.status_code, line_of(answer)) == (507, "a file cannot be kept: No space left")


def test_a_bug_is_a_line(monkeypatch):
    def fail():
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(routes, "form", fail)
    answer = ask("GET", "/api/options", headers=BEARER, raises=False)
    assert (answer.status_code, line_of(answer)) == (500, "ZeroDivisionError: division by zero")
    assert answer.headers["cache-control"] == "no-store"


def test_a_full_line_is_told_with_when_to_ask_again(monkeypatch):
    monkeypatch.setattr(jobs, "MOST_WAITING", 0)
    answer = ask("POST", "/api/jobs", **photo_of(PNG))
    assert (answer.status_code, "waiting already" in line_of(answer)) == (429, True)
    assert int(answer.headers["retry-after"]) > 0


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("../../etc/passwd", "passwd"), ("..\\..\\windows\\win.ini", "win.ini"),
        ("/photos/photo.jpg", "photo.jpg"), ("a\0b\n\x1b[31m.png", "ab[31m.png"),
        ("\u202egnp.exe", "gnp.exe"), ("..", "photo"), ("", "photo"), (None, "photo"),
        ('<img src=x onerror="alert(1)">.png', "img src=x onerror=alert(1).png"),
        ("x" * 500 + ".jpeg", "x" * 100 + ".jpeg"), ("x." + "y" * 500, "x." + "y" * 8),
        ("\u00fcber s\u00fc\u00df.jpg", "\u00fcber s\u00fc\u00df.jpg"),
    ],
)  # fmt: skip
def test_a_file_name_is_shown_and_is_never_a_path(given, name):
    assert display_name(given) == name


@pytest.mark.parametrize(
    ("name", "stem"),
    [("con.png", "_con"), ("LPT1.a.png", "_LPT1.a"), ("\u00fc" * 150, "\u00fc" * 100)],
)
def test_the_stem_of_a_name_is_one_on_every_system(name, stem):
    assert stem_of(name) == stem


@pytest.mark.parametrize(("turn", "size"), [(6, (6, 8)), (3, (8, 6))])
def test_the_size_of_a_photo_is_that_of_it_upright_without_its_pixels(tmp_path, turn, size):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = turn
    Image.new("RGB", (8, 6)).save(tmp_path / "turned", "JPEG", exif=exif)
    assert size_of(tmp_path / "turned", "a.jpg") == size


@pytest.mark.posix
def test_samples_are_the_photos_of_a_folder_by_names_that_an_address_can_have(tmp_path):
    names = [b"caf\xe9.png", b"plain.png", "größe.JFIF".encode(), b".hidden.png", b"note.md"]
    for name in names:
        (tmp_path / os.fsdecode(name)).write_bytes(PNG)
    (tmp_path / "link.png").symlink_to("plain.png")
    (tmp_path / "broken.png").write_bytes(b"no photo")
    studio = create_app(folder=tmp_path)
    samples = answer_of(studio, "GET", "/api/samples").json()
    assert {one["name"] for one in samples} == {
        "caf\\xe9.png",
        "plain.png",
        "größe.JFIF",
        "link.png",
    }
    for one in samples:
        assert answer_of(studio, "GET", f"/{one['url']}").content == PNG
    for number in range(200):
        (tmp_path / f"{number}.png").write_bytes(PNG)
    assert len(samples_in(tmp_path)) == 100
    with pytest.raises(InputError, match="FOLDER must be a folder with photos"):
        samples_in(tmp_path / "none")


@pytest.mark.parametrize("axis", SCORES, ids=lambda axis: axis.slug)
@pytest.mark.parametrize(("cost", "score"), [(1e-9, 1e6), (1e15, -1e6), (5.0, None)])
def test_a_chart_is_drawn_of_what_can_be_and_its_texts_are_text(axis, cost, score):
    hostile = '<script>alert(1)</script>&"'
    points = [
        {"cost": one, "score": other, "series": at, "text": hostile}
        for at, (one, other) in enumerate([(cost, score), (10, 20.0)])
    ]
    body = json.dumps({"score": axis.key, "cost": "total_s", "points": points})
    answer = ask("POST", "/api/chart", **json_of(body))
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"] == PICTURE_POLICY
    texts = [one.text for one in ElementTree.fromstring(answer.text).iter() if one.text]
    assert texts.count(hostile) == 2
    assert {axis.title, "time, photo to measured SVG"} <= set(texts)


def test_the_description_of_the_service_has_types_of_its_answers():
    document = ask("GET", "/api/openapi.json", headers=BEARER).json()
    for methods in document["paths"].values():
        for route in methods.values():
            assert route["description"]
    state = document["paths"]["/api/jobs/{name}"]["get"]["responses"]["200"]
    assert state["content"]["application/json"]["schema"]["$ref"].endswith("/JobState")
    form = document["paths"]["/api/jobs"]["post"]["requestBody"]["content"]["multipart/form-data"]
    name = form["schema"]["$ref"].rpartition("/")[2]
    fields = document["components"]["schemas"][name]["properties"]
    assert fields.keys() == {"photo", "sample", "of", "options"}
