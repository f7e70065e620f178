"""The built documentation: whole, light, and without anything from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from conftest import needs
from galleries import Page
from gallery_site import PHONE, WIDE, Headless, closed_after

ROOT = Path(__file__).parents[2]
BUILT = "GAUSS2SVG_SITE"  # the folder of a site that is built already
MOST_BYTES = 500_000
LOOKED_AT = ("index", "guide/python", "reference/options", "development", "search")

pytestmark = pytest.mark.example
_LOADED = {"stylesheet", "icon", "preload"}


class SitePage(Page):
    """A page with the ids, the links and the files that it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.path, self.ids, self.links, self.loaded = path, set(), [], []
        for tag, given in ((tag, dict(attributes)) for tag, attributes in self.parts):
            self.ids |= {given[name] for name in ("id", "name") if given.get(name)}
            if tag == "a" and given.get("href"):
                self.links.append(given["href"])
            elif tag == "link" and _LOADED & set((given.get("rel") or "").split()):
                self.loaded.append(given["href"])
            elif given.get("data-frames"):  # the pictures of the start page's slider
                self.loaded += [f"_static/start/{n}.webp" for n in given["data-frames"].split()]
            elif given.get("src"):
                self.loaded.append(given["src"])

    def file_of(self, address: str) -> Path:
        return (self.path.parent / unquote(urlsplit(address).path)).resolve()


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    if BUILT in os.environ:
        return Path(os.environ[BUILT])
    out = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", out]
    run = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return out


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, SitePage]:
    found = {path.resolve(): SitePage(path) for path in sorted(site.rglob("*.html"))}
    sample = (site / "sample").resolve()  # a gallery, whose pages have tests of their own
    assert sample / "index.html" in found
    ours = {path: page for path, page in found.items() if not path.is_relative_to(sample)}
    assert len(ours) > 50
    return ours


def test_links_lead_to_pages_and_anchors_that_exist(pages):
    for path, page in pages.items():
        for link in page.links:
            address = urlsplit(link)
            if address.scheme:
                continue
            target = page.file_of(link) if address.path else path
            assert target.exists(), f"{path}: {link}"
            if address.fragment and target in pages:
                assert unquote(address.fragment) in pages[target].ids, f"{path}: {link}"


def test_a_page_loads_only_files_of_the_site_and_few_bytes(pages):
    for path, page in pages.items():
        files = {path, *(page.file_of(address) for address in page.loaded)}
        assert not [a for a in page.loaded if urlsplit(a).scheme or a.startswith("//")], path
        assert sum(file.stat().st_size for file in files) <= MOST_BYTES, path


@pytest.fixture(scope="module")
def open_page(site, tmp_path_factory):
    needs("chromium")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = Headless(playwright, site, tmp_path_factory.mktemp("alone"))
        with closed_after(browser.visit) as visit:  # fails on errors and on requests to elsewhere

            def opened(name: str, **options):
                one = visit(**options)
                one.page.set_default_timeout(30_000)
                return one.go(f"{name}.html")

            yield opened
        browser.close()


@pytest.mark.browser
@pytest.mark.parametrize("name", LOOKED_AT)
def test_pages_are_accessible_in_light_and_dark_wide_and_narrow(open_page, name):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    for scheme, size in (("light", WIDE), ("dark", PHONE)):
        page = open_page(name, viewport=size, color_scheme=scheme)
        found = axe.run(page, options={"resultTypes": ["violations"], "preload": False})
        faults = [(f["id"], f["nodes"][0]["html"]) for f in found.response["violations"]]
        assert not faults
        root = "document.documentElement"
        assert page.evaluate(f"{root}.scrollWidth <= {root}.clientWidth")


@pytest.mark.browser
def test_the_start_picture_goes_from_few_to_many_by_the_keyboard(open_page):
    page = open_page("index")
    slider, shown = page.get_by_role("slider"), page.locator("#start li:visible")
    source = page.locator("#start img")
    counts = []
    slider.press("Home")
    for _ in range(6):
        (line,) = shown.all_text_contents()
        counts.append(int(line.split()[0]))
        number = re.search(r"(\d+)\.webp", source.get_attribute("src"))
        assert number
        assert counts[-1] == pytest.approx(int(number[1]), rel=0.01)
        assert slider.evaluate("one => one.ariaValueText") == line
        slider.press("ArrowRight")
    assert counts == sorted(set(counts))
