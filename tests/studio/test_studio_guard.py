"""Who may use the studio: each hostile use has its answer. All in process, no fit is run.

The file is long because there are so many hostile uses.
"""

import asyncio
import errno
import io
import json
import math
import os
import re
import struct
import zlib
from xml.etree import ElementTree

import pytest
from pictures import chunk
from PIL import ExifTags, Image
from starlette.datastructures import UploadFile
from studio_server import answer_of

from gauss2svg.measure.scores import SCORES
from gauss2svg.studio import guard, uploads
from gauss2svg.studio.guard import Bounded, Guard
from gauss2svg.studio.service import create_app
from gauss2svg.studio.uploads import display_name, link, size_of, stem_of

TOKEN, PORT = "t0ken", 8137
BEARER = {"Authorization": f"Bearer {TOKEN}"}
HOME = f"http://127.0.0.1:{PORT}"
SAFETY = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


STUDIO = create_app()


def ask(method: str, path: str, base: str = HOME, local: bool = True, **more):
    """The answer of a guarded studio to one request."""

    guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1", "localhost", "::1"}, local)
    try:
        return answer_of(guarded, method, path, base, **more)
    finally:
        asyncio.run(STUDIO.jobs.close())


def line_of(answer) -> str:
    error = answer.json()["error"]
    assert "\n" not in error
    assert answer.headers["content-type"] == "application/json"
    return error


@pytest.mark.parametrize("path", ["/", "/api/options", "/static/gallery.css", "/api/openapi.json"])
@pytest.mark.parametrize(
    "given", [{}, {"Authorization": "Bearer wrong"}, {"Cookie": f"gauss2svg-1={TOKEN}"}]
)
def test_nothing_is_served_without_the_token(path, given):
    answer = ask("GET", path, headers=given)
    assert answer.status_code == 401
    assert "token" in line_of(answer)


def test_the_address_with_the_token_opens_the_page_by_a_cookie():
    answer = ask("GET", f"/?token={TOKEN}")
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    page = ask("GET", "/", headers={"Cookie": cookie.partition(";")[0]})
    assert page.status_code == 200
    assert TOKEN not in page.text


def test_a_ticket_opens_the_page_once():
    guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1"}, True)
    ticket = guarded.ticket()
    for path, status in (
        (f"/api/options?token={ticket}", 401), (f"/?token={ticket}", 303),
        (f"/?token={ticket}", 401), ("/?token=", 401),
    ):  # fmt: skip
        assert answer_of(guarded, "GET", path, HOME).status_code == status


def test_a_link_of_another_site_with_the_token_opens_it_at_once():
    # browsers leave out a strict cookie after such a redirect
    answer = ask("GET", f"/?token={TOKEN}", headers={"Sec-Fetch-Site": "cross-site"})
    assert answer.status_code == 200
    assert "set-cookie" in answer.headers


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://127.0.0.1:9999"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
    ids=str,
)
def test_no_page_of_another_origin_may_drive_it_even_with_the_token(headers):
    answer = ask("POST", "/api/jobs", headers=BEARER | headers)
    assert answer.status_code == 403
    assert "another site" in line_of(answer)


@pytest.mark.parametrize("headers", [{"Origin": "http://["}, {"Sec-Fetch-Site": "cross-site"}])
@pytest.mark.parametrize("path", ["/api/jobs?token=junk", f"/api/jobs?token={TOKEN}"])
def test_no_token_in_the_address_opens_more_than_the_page(path, headers):
    assert ask("POST", path, headers=BEARER | headers).status_code == 403


@pytest.mark.parametrize(
    "site", [{"Origin": "https://evil.example"}, {"Sec-Fetch-Site": "same-site"}]
)
def test_nor_may_such_a_page_drive_a_mounted_studio(site):
    answer = answer_of(STUDIO, "POST", "/api/chart", HOME, headers=site, content="{}")
    assert answer.status_code == 403


@pytest.mark.parametrize("odd", ["a[b]=1", "x=\\", 'q="open', "=", "{j}=1"])
def test_odd_cookies_of_other_servers_lock_nobody_out(odd):
    cookie = f"{odd}; gauss2svg-{PORT}={TOKEN}; {odd}"
    assert ask("GET", "/api/options", headers={"Cookie": cookie}).status_code == 200


def test_its_own_page_may():
    answer = ask("GET", "/api/options", headers=BEARER | {"Origin": HOME})
    assert answer.status_code == 200


@pytest.mark.parametrize(
    "base", ["http://rebound.example:8137", "http://127.0.0.1:80", "http://192.168.1.7:8137"]
)
def test_a_name_that_was_made_to_point_here_is_refused(base):
    answer = ask("GET", "/api/options", base=base, headers=BEARER)
    assert answer.status_code == 421


@pytest.mark.parametrize(
    ("base", "status"), [("http://192.168.1.7:8137", 200), ("http://rebound.example:8137", 421)]
)
def test_in_a_network_digits_are_an_address_and_strange_names_are_not(base, status):
    answer = ask("GET", "/api/options", base=base, headers=BEARER, local=False)
    assert answer.status_code == status


def test_the_page_may_load_only_what_is_here():
    answer = ask("GET", "/", headers=BEARER)
    policy = answer.headers["content-security-policy"]
    directives = dict(one.split(" ", 1) for one in policy.split("; "))
    for name in ("default-src", "frame-ancestors", "base-uri", "form-action"):
        assert directives.pop(name) == "'none'"
    assert {"'self'", "blob:", "data:"} >= {w for ws in directives.values() for w in ws.split()}
    assert directives["script-src"] == "'self'"
    assert "://" not in answer.text.replace("http://www.w3.org/", "")


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/options", "/api/jobs/none", "/no"])
def test_every_answer_has_the_headers_of_safety(path):
    headers = ask("GET", path, headers=BEARER).headers
    assert {name: headers[name] for name in headers if name in SAFETY} == SAFETY
    assert headers["content-security-policy"]


@pytest.mark.parametrize(
    ("headers", "status"),
    [({}, 401), (BEARER | {"Origin": "null"}, 403), (BEARER | {"Host": "rebound"}, 421)],
)
def test_what_is_refused_is_not_kept_and_ends_its_connection(headers, status):
    answer = ask("GET", "/api/options", headers=headers)
    assert answer.status_code == status
    assert answer.headers["connection"] == "close"
    assert answer.headers["cache-control"] == "no-store"


@pytest.mark.parametrize("path", ["/", "/api/options", "/api/jobs/none"])
def test_no_link_of_another_site_opens_anything_by_the_cookie(path):
    headers = {"Cookie": f"gauss2svg-{PORT}={TOKEN}", "Sec-Fetch-Mode": "navigate"}
    assert ask("GET", path, headers=headers | {"Sec-Fetch-Site": "cross-site"}).status_code == 403
    assert ask("GET", path, headers=headers | {"Sec-Fetch-Site": "none"}).status_code != 403


@pytest.mark.parametrize("scheme", ["Basic", "Token", ""])
def test_the_token_is_taken_of_no_other_scheme(scheme):
    headers = {"Authorization": f"{scheme} {TOKEN}"}
    assert ask("GET", "/api/options", headers=headers).status_code == 401


def test_a_cookie_of_the_same_name_for_a_longer_path_locks_nobody_out():
    # Browsers send the longest path first.
    cookie = f"gauss2svg-{PORT}=junk; gauss2svg-{PORT}={TOKEN}"
    assert ask("GET", "/api/options", headers={"Cookie": cookie}).status_code == 200


def post_photo(data: bytes, name: str = "photo.png", options: str = "{}", **more):
    files = {"photo": (name, data, "image/png")}
    return ask("POST", "/api/jobs", headers=BEARER, files=files, data={"options": options}, **more)


@pytest.mark.parametrize(("code", "status"), [(errno.ENOSPC, 507), (errno.EIO, 500)])
def test_a_photo_that_the_disk_does_not_take_is_a_line_without_its_path(code, status, monkeypatch):
    async def refuse(upload, path):
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(uploads, "save", refuse)
    answer = post_photo(b"photo")
    assert answer.status_code == status
    assert line_of(answer) == f"the photo cannot be kept: {os.strerror(code)}"


def test_an_upload_of_2_gb_is_refused_by_its_length_before_it_comes():
    read = 0

    async def body():
        nonlocal read
        while True:
            read += 1
            yield bytes(1 << 16)

    headers = BEARER | {"Content-Length": str(2 * 10**9), "Content-Type": "multipart/form-data"}
    answer = ask("POST", "/api/jobs", headers=headers, content=body())
    assert answer.status_code == 413
    assert "256 MB" in line_of(answer)
    assert read == 0


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
    assert answer.status_code == 413
    assert sent < 1.5e6


@pytest.mark.parametrize(("bound", "pause"), [("_CHUNK_S", 30), ("_BODY_S", 0.01)])
def test_a_body_that_comes_too_slowly_is_given_up(monkeypatch, bound, pause):
    monkeypatch.setattr(guard, bound, 0.05)

    async def app(scope, receive, send):
        while True:
            await receive()

    async def receive():
        await asyncio.sleep(pause)
        return {"type": "http.request", "body": b"a", "more_body": True}

    sent = []

    async def send(message):
        sent.append(message)

    bounded = Bounded(app)({"type": "http", "headers": []}, receive, send)
    asyncio.run(asyncio.wait_for(bounded, 5))
    assert sent[0]["status"] == 408
    assert "without long pauses" in json.loads(sent[1]["body"])["error"]


def bomb() -> bytes:
    """A PNG of 50 000 x 50 000 px in a few bytes."""
    head = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )


SCRIPTED = b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>'


@pytest.mark.parametrize(
    ("data", "name", "said"), [(bomb(), "x.png", "2500000000 px"), (SCRIPTED, "x.svg", "SVG")]
)
def test_too_large_a_photo_and_an_svg_are_refused_by_how_they_begin(data, name, said):
    answer = post_photo(data, name)
    assert answer.status_code == 422
    assert said in line_of(answer)


@pytest.mark.parametrize("data", [b"", b"no photo", b"\x89PNG\r\n\x1a\nrubbish"])
def test_what_is_no_photo_is_refused_in_a_line_and_not_kept(data, monkeypatch):
    kept = []
    new_folder = STUDIO.jobs.new_folder
    monkeypatch.setattr(STUDIO.jobs, "new_folder", lambda: kept.append(new_folder()) or kept[-1])
    monkeypatch.setattr(STUDIO.jobs, "close", lambda: asyncio.sleep(0))  # which would remove it
    answer = post_photo(data)
    assert answer.status_code == 422
    assert line_of(answer).startswith("photo.png must be")
    assert [folder.exists() for folder in kept] == [False]


@pytest.mark.parametrize(
    ("fields", "word"),
    [
        ({}, "the photo must be given"),
        ({"photo": "photo.png"}, "the photo must be given"),
        ({"sample": "", "of": "", "options": "", "keep": ""}, "the photo must be given"),
        ({"sample": "coffee.png", "keep": "perhaps"}, "keep"),
    ],
)
def test_a_form_without_a_photo_is_refused_in_a_line(fields, word):
    answer = ask("POST", "/api/jobs", headers=BEARER, data=fields, files={"x": b""})
    assert answer.status_code == 422
    assert line_of(answer).partition(":")[0].startswith(word)


@pytest.mark.parametrize(("keep", "kept"), [("1", True), ("True", True), ("", False), ("0", False)])
def test_what_a_form_asks_to_keep_is_kept(keep, kept, monkeypatch):
    monkeypatch.setattr(STUDIO.jobs, "start", lambda: None)  # no worker
    fields = {"sample": "coffee.png", "keep": keep}
    state = ask("POST", "/api/jobs", headers=BEARER, data=fields, files={"x": b""}).json()
    assert STUDIO.jobs.known.pop(state["id"]).keep == kept


@pytest.mark.parametrize("name", ["of", "sample"])
def test_a_job_or_a_sample_that_is_not_there_is_not_found(name):
    answer = ask("POST", "/api/jobs", headers=BEARER, data={name: "none"}, files={"x": b""})
    assert answer.status_code == 404
    assert "none" in line_of(answer)


def test_a_form_of_two_photos_or_many_fields_is_refused():
    two = [("photo", ("a.png", b"a")), ("photo", ("b.png", b"b"))]
    assert ask("POST", "/api/jobs", headers=BEARER, files=two).status_code == 400
    many = {str(number): "1" for number in range(6)}
    answer = ask("POST", "/api/jobs", headers=BEARER, data=many, files={"x": b""})
    assert answer.status_code == 400
    assert "Too many fields" in line_of(answer)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("../../etc/passwd", "passwd"),
        ("..\\..\\windows\\win.ini", "win.ini"),
        ("/photos/photo.jpg", "photo.jpg"),
        ("a\0b\n\x1b[31m.png", "ab[31m.png"),
        ("\u202egnp.exe", "gnp.exe"),
        ('<img src=x onerror="alert(1)">.png', "img src=x onerror=alert(1).png"),
        ("..", "photo"),
        ("", "photo"),
        (None, "photo"),
        ("x" * 500 + ".jpeg", "x" * 100 + ".jpeg"),
        ("x." + "y" * 500, "x." + "y" * 8),
        ("\u00fcber s\u00fc\u00df.jpg", "\u00fcber s\u00fc\u00df.jpg"),
    ],
)
def test_a_file_name_is_shown_and_is_never_a_path(given, name):
    assert display_name(given) == name


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ('{"inks": "/etc/passwd.gpl"}', "inks"),
        ('{"threads": 99}', "threads"),
        ('{"form": "blur", "renderer": "cairo"}', "renderer"),
        ('{"max_pixels": 1}', "max_pixels"),
        ('{"nonsense": 1}', "nonsense"),
        ('{"gaussians": -1}', "gaussians"),
        ("[]", "options"),
        ("{", "options"),
        ("NaN", "options"),
    ],
)
def test_options_that_are_not_offered_or_wrong_are_refused_in_a_line(options, word):
    stream = io.BytesIO()
    Image.new("RGB", (8, 8)).save(stream, "PNG")
    answer = post_photo(stream.getvalue(), options=options)
    assert answer.status_code == 422
    assert word in line_of(answer)


@pytest.mark.parametrize(
    ("data", "files", "line"),
    [
        ({"keep": "perhaps"}, {"x": b""}, "keep must be a valid boolean; got 'perhaps'"),
        ({}, {"options": ("a.txt", b"{}")}, "options must be a valid string; got a file"),
    ],
)
def test_a_field_of_another_kind_is_refused_as_every_value_is(data, files, line):
    answer = ask("POST", "/api/jobs", headers=BEARER, data=data, files=files)
    assert (answer.status_code, line_of(answer)) == (422, line)


@pytest.mark.parametrize(
    ("query", "line"),
    [
        ("", "query.ids must be given; got none"),
        ("?ids=a&gzip=2", "query.gzip must be a valid boolean; got '2'"),
        ("?ids=a&markup=small", "query.markup must be 'editable' or 'minimal'; got 'small'"),
    ],
)
def test_a_query_of_another_kind_is_refused_as_every_value_is(query, line):
    answer = ask("GET", f"/api/zip{query}", headers=BEARER)
    assert (answer.status_code, line_of(answer)) == (422, line)


@pytest.mark.parametrize("body", ["[" * 60_000, '{"a": ' * 9000, " " * 5_000_000, "no JSON", "[1]"])
def test_json_is_bounded_in_bytes_and_depth(body):
    line = line_of(answer := ask("POST", "/api/chart", headers=BEARER, content=body))
    assert answer.status_code == 422
    assert line.startswith("the body must be")
    assert len(line) < 200


def test_the_size_of_a_png_is_read_without_its_pixels(tmp_path, monkeypatch):
    path = tmp_path / "private"
    Image.new("RGB", (8, 6)).save(path, "PNG")
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", None)
    assert size_of(path, "a.png") == (8, 6)


def test_the_size_of_a_photo_is_that_of_it_upright(tmp_path, monkeypatch):
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.new("RGB", (8, 6)).save(tmp_path / "turned", "JPEG", exif=exif)
    assert size_of(tmp_path / "turned", "a.jpg") == (6, 8)
    exif[ExifTags.Base.Orientation] = 3
    Image.new("RGB", (8, 6)).save(tmp_path / "reversed", "JPEG", exif=exif)
    assert size_of(tmp_path / "reversed", "a.jpg") == (8, 6)

    def fail(*_):  # as on hostile bytes
        raise SyntaxError("not a TIFF file")

    monkeypatch.setattr(Image.Exif, "load", fail)
    assert size_of(tmp_path / "turned", "a.jpg") == (8, 6)


def test_what_is_kept_is_what_was_sent(tmp_path, monkeypatch):
    data = os.urandom(3 << 20)
    upload = UploadFile(io.BytesIO(data))
    asyncio.run(uploads.save(upload, tmp_path / "photo"))
    assert (tmp_path / "photo").read_bytes() == data

    def refuse(*_):
        raise OSError(errno.EXDEV, "another disk")

    monkeypatch.setattr(os, "link", refuse)
    link(tmp_path / "photo", tmp_path / "copy")
    assert (tmp_path / "copy").read_bytes() == data


def test_the_samples_of_a_folder_are_bounded_in_number(tmp_path, monkeypatch):
    monkeypatch.setattr(uploads, "_MOST_SAMPLES", 3)
    for number in range(5):
        Image.new("RGB", (3, 2)).save(tmp_path / f"{number}.png")
    assert [one.name for one in uploads.samples_in(tmp_path)] == ["0.png", "1.png", "2.png"]


def test_a_sample_by_a_symbolic_link_is_a_photo(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.png").write_bytes(b"photo")
    (tmp_path / "a.png").symlink_to("real/a.png")
    (tmp_path / "job").mkdir()
    link(tmp_path / "a.png", tmp_path / "job" / "photo")
    assert (tmp_path / "job" / "photo").read_bytes() == b"photo"


@pytest.mark.parametrize(
    ("name", "stem"),
    [("con.png", "_con"), ("LPT1.a.png", "_LPT1.a"), ("\u00fc" * 150, "\u00fc" * 100)],
)
def test_the_stem_of_a_name_is_one_on_every_system(name, stem):
    assert stem_of(name) == stem


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/jobs/none", 404),
        ("GET", "/api/jobs/none/picture.svg", 404),
        ("GET", "/api/jobs/none/..%2f..%2fetc%2fpasswd", 404),
        ("GET", "/static/..%2fservice.py", 404),
        ("GET", "/api/samples/..%2f..%2fx", 404),
        ("GET", "/api/zip?ids=none", 404),
        ("GET", "/api/zip", 422),
        ("GET", "/docs", 404),
        ("POST", "/api/jobs", 422),
        ("POST", "/api/chart", 422),
        ("PUT", "/api/jobs", 405),
    ],
)
def test_errors_are_one_line_of_json(method, path, status):
    answer = ask(method, path, headers=BEARER)
    assert answer.status_code == status
    assert line_of(answer)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(errno.EIO, "Input/output error", "/private"), "OSError: Input/output error"),
        (ZeroDivisionError("division\nby zero"), "ZeroDivisionError: division by zero"),
    ],
)
def test_a_bug_is_a_line_without_a_path(error, line, monkeypatch):
    def fail():
        raise error

    monkeypatch.setattr("gauss2svg.studio.routes.pages.form", fail)
    answer = answer_of(STUDIO, "GET", "/api/options", HOME, raises=False)
    assert answer.status_code == 500
    assert line_of(answer) == line
    assert answer.headers["cache-control"] == "no-store"


def test_the_body_of_a_chart_is_bounded():
    body = json.dumps(
        {"score": "psnr_svg", "cost": "total_s", "points": [{"text": "x" * 5 * 10**6}]}
    )
    line = line_of(answer := ask("POST", "/api/chart", headers=BEARER, content=body))
    assert answer.status_code == 422
    assert line == "the body must be at most 4000000 bytes; got more. Try less"


@pytest.mark.parametrize("axis", SCORES, ids=lambda axis: axis.slug)
@pytest.mark.parametrize(
    ("cost", "score", "drawn"),
    [
        (1e-9, 1e6, True), (1e15, -1e6, True), (5.0, None, True),
        (0, 30, False), (-1, 30, False), (1e300, 30, False), (5, 1e300, False),
        (math.nan, 30, False), (5, math.inf, False), ("5 s", 30, False),
    ],
)  # fmt: skip
def test_a_chart_is_drawn_of_what_can_be_and_its_texts_are_text(axis, cost, score, drawn):
    hostile = '<script>alert(1)</script>&"'
    points = [
        {"cost": one, "score": other, "series": at, "text": hostile}
        for at, (one, other) in enumerate([(cost, score), (10, 20.0)])
    ]
    body = json.dumps({"score": axis.key, "cost": "total_s", "points": points})
    headers = {**BEARER, "Content-Type": "application/json"}
    answer = ask("POST", "/api/chart", headers=headers, content=body)
    if not drawn:
        assert answer.status_code == 422
        assert re.match(r"points\.0\.(cost|score) must be .+; got .+", line_of(answer))
        return
    assert answer.status_code == 200
    assert answer.headers["content-security-policy"] == guard.PICTURE_POLICY
    assert answer.headers["content-type"].startswith("image/svg+xml")
    texts = [one.text for one in ElementTree.fromstring(answer.text).iter() if one.text]
    assert texts.count(hostile) == 2
    assert {axis.title, "time, photo to measured SVG"} <= set(texts)


def test_the_description_of_the_service_has_types_of_its_answers_and_errors():
    document = ask("GET", "/api/openapi.json", headers=BEARER).json()
    for path, methods in document["paths"].items():
        for method, route in methods.items():
            assert route["summary"] != route["operationId"].replace("_", " ").title(), path
            assert route["description"].startswith(route["summary"]), (method, path)
            for status in ("403", "404", "422"):
                said = route["responses"][status]["content"]["application/json"]["schema"]
                assert said == {"$ref": "#/components/schemas/Error"}
    form = document["paths"]["/api/jobs"]["post"]["requestBody"]["content"]["multipart/form-data"]
    photo = form["schema"]["properties"]["photo"]
    assert (photo["type"], photo["format"], "anyOf" in photo) == ("string", "binary", False)
    chart = document["paths"]["/api/chart"]["post"]["requestBody"]["content"]["application/json"]
    assert "cost" in chart["schema"]["properties"]["points"]["items"]["properties"]
    state = document["paths"]["/api/jobs/{name}"]["get"]["responses"]["200"]
    assert state["content"]["application/json"]["schema"]["$ref"].endswith("/JobState")
    assert {"id", "state", "place", "lines"} <= document["components"]["schemas"]["JobState"][
        "properties"
    ].keys()


def test_a_zip_of_no_jobs_is_refused():
    answer = ask("GET", "/api/zip?ids=,", headers=BEARER)
    assert answer.status_code == 422
    assert "ids must" in line_of(answer)
