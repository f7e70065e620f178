"""Who may use the studio: each hostile use has its answer. All in process, no fit is run."""

import asyncio
import errno
import io
import json
import math
import os
import struct
import zlib
from xml.etree import ElementTree

import httpx
import pytest
from PIL import Image

from gauss2svg.studio import guard, photos
from gauss2svg.studio.guard import Bounded, Guard
from gauss2svg.studio.photos import display_name, link, size_of, stem_of
from gauss2svg.studio.service import create_app

TOKEN, PORT = "t0ken", 8137
BEARER = {"Authorization": f"Bearer {TOKEN}"}
HOME = f"http://127.0.0.1:{PORT}"


STUDIO = create_app()


def ask(method: str, path: str, base: str = HOME, local: bool = True, **more):
    """The answer of a guarded studio to one request."""

    async def one():
        guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1", "localhost", "::1"}, local)
        transport = httpx.ASGITransport(guarded)
        async with httpx.AsyncClient(transport=transport, base_url=base) as client:
            answer = await client.request(method, path, **more)
        await STUDIO.jobs.close()
        return answer

    return asyncio.run(one())


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
    assert "SameSite=Strict" in cookie
    page = ask("GET", "/", headers={"Cookie": cookie.partition(";")[0]})
    assert page.status_code == 200
    assert TOKEN not in page.text


def test_a_ticket_opens_the_page_once():
    async def statuses():
        guarded = Guard(STUDIO, TOKEN, PORT, {"127.0.0.1"}, True)
        ticket = guarded.ticket()
        transport = httpx.ASGITransport(guarded)
        async with httpx.AsyncClient(transport=transport, base_url=HOME) as client:
            asked = [
                f"/api/options?token={ticket}",
                f"/?token={ticket}",
                f"/?token={ticket}",
                "/?token=",
            ]
            found = []
            for path in asked:
                client.cookies.clear()
                found.append((await client.get(path)).status_code)
        return found

    assert asyncio.run(statuses()) == [401, 303, 401, 401]


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
    async def one():
        transport = httpx.ASGITransport(STUDIO)
        async with httpx.AsyncClient(transport=transport, base_url=HOME) as client:
            return await client.post("/api/estimate", headers=site, content="{}")

    assert asyncio.run(one()).status_code == 403


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
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert "://" not in answer.text.replace("http://www.w3.org/", "")


def post_photo(data: bytes, name: str = "photo.png", options: str = "{}", **more):
    files = {"photo": (name, data, "image/png")}
    return ask("POST", "/api/jobs", headers=BEARER, files=files, data={"options": options}, **more)


@pytest.mark.parametrize(("code", "status"), [(errno.ENOSPC, 507), (errno.EIO, 500)])
def test_a_photo_that_the_disk_does_not_take_is_a_line_without_its_path(code, status, monkeypatch):
    async def refuse(upload, path):
        raise OSError(code, os.strerror(code), str(path))

    monkeypatch.setattr(photos, "save", refuse)
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
    monkeypatch.setattr(STUDIO, "_most", 10**6)
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


def test_a_body_that_comes_too_slowly_is_given_up(monkeypatch):
    monkeypatch.setattr(guard, "_CHUNK_S", 0.05)

    async def app(scope, receive, send):
        await receive()

    async def receive():
        await asyncio.sleep(30)

    sent = []

    async def send(message):
        sent.append(message)

    asyncio.run(Bounded(app)({"type": "http", "headers": []}, receive, send))
    assert sent[0]["status"] == 408
    assert "slow" in json.loads(sent[1]["body"])["error"] or "pauses" in sent[1]["body"].decode()


def bomb() -> bytes:
    """A PNG of 50 000 x 50 000 px in a few bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", 50_000, 50_000, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(b""))
        + chunk(b"IEND", b"")
    )


def test_a_png_of_50_000_by_50_000_px_is_refused_by_its_header():
    answer = post_photo(bomb())
    assert answer.status_code == 422
    assert "2500000000 px" in line_of(answer)


def test_an_svg_with_a_script_is_no_photo():
    svg = b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>'
    answer = post_photo(svg, "x.svg")
    assert answer.status_code == 422
    assert "SVG" in line_of(answer)


@pytest.mark.parametrize("data", [b"", b"no photo", b"\x89PNG\r\n\x1a\nrubbish"])
def test_what_is_no_photo_is_refused_in_a_line(data):
    assert post_photo(data).status_code == 422


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
        ("\u00fcber s\u00fc\u00df.jpg", "\u00fcber s\u00fc\u00df.jpg"),
    ],
)
def test_a_file_name_is_shown_and_is_never_a_path(given, name):
    assert display_name(given) == name


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ('{"checkpoint": "x"}', "checkpoint"),
        ('{"resume": "/etc/passwd"}', "resume"),
        ('{"segments": "/etc/passwd"}', "segments"),
        ('{"threads": 99}', "threads"),
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


@pytest.mark.parametrize("body", ["[" * 60_000, '{"a": ' * 9000, " " * 10**6, "no JSON", "[1]"])
def test_json_is_bounded_in_bytes_and_depth(body):
    line = line_of(answer := ask("POST", "/api/estimate", headers=BEARER, content=body))
    assert answer.status_code == 422
    assert line.startswith("the body must be")
    assert len(line) < 200


def test_the_size_of_a_png_is_read_without_its_pixels(tmp_path, monkeypatch):
    path = tmp_path / "private"
    Image.new("RGB", (8, 6)).save(path, "PNG")
    monkeypatch.setattr("PIL.ImageFile.ImageFile.load", None)
    assert size_of(path, "a.png") == (8, 6)


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
        ("POST", "/api/estimate", 422),
        ("POST", "/api/chart", 422),
        ("PUT", "/api/jobs", 405),
    ],
)
def test_errors_are_one_line_of_json(method, path, status):
    answer = ask(method, path, headers=BEARER)
    assert answer.status_code == status
    assert line_of(answer)


@pytest.mark.parametrize(
    ("cost", "score", "drawn"),
    [
        (1e-9, 1e6, True), (1e15, -1e6, True), (5.0, None, True),
        (0, 30, False), (-1, 30, False), (1e300, 30, False), (5, 1e300, False),
        (math.nan, 30, False), (5, math.inf, False), ("5 s", 30, False),
    ],
)  # fmt: skip
def test_a_chart_is_drawn_of_what_can_be_and_its_texts_are_text(cost, score, drawn):
    hostile = '<script>alert(1)</script>&"'
    points = [
        {"cost": one, "score": other, "series": at, "text": hostile}
        for at, (one, other) in enumerate([(cost, score), (10, 20.0)])
    ]
    body = json.dumps({"score": "psnr_svg", "cost": "total_s", "points": points})
    headers = {**BEARER, "Content-Type": "application/json"}
    answer = ask("POST", "/api/chart", headers=headers, content=body)
    if not drawn:
        assert answer.status_code == 422
        assert line_of(answer).startswith("body.points.0.")
        return
    assert answer.headers["content-type"].startswith("image/svg+xml")
    texts = [one.text for one in ElementTree.fromstring(answer.text).iter() if one.text]
    assert texts.count(hostile) == 2
    assert {"PSNR, dB", "time, photo to measured SVG"} <= set(texts)


def test_the_description_of_the_service_has_types_of_its_answers_and_errors():
    document = STUDIO.api.openapi()
    for path, methods in document["paths"].items():
        for method, route in methods.items():
            assert not route["summary"].startswith(" "), (method, path)
            for status in ("403", "404", "422"):
                said = route["responses"][status]["content"]["application/json"]["schema"]
                assert said == {"$ref": "#/components/schemas/Error"}
    state = document["paths"]["/api/jobs/{name}"]["get"]["responses"]["200"]
    assert state["content"]["application/json"]["schema"]["$ref"].endswith("/State")
    assert {"id", "state", "place", "lines"} <= document["components"]["schemas"]["State"][
        "properties"
    ].keys()


def test_a_zip_of_no_jobs_is_refused():
    answer = ask("GET", "/api/zip?ids=,", headers=BEARER)
    assert answer.status_code == 422
    assert "ids must" in line_of(answer)
