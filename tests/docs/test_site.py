"""The built documentation: its links lead somewhere, and its pages are for everybody."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from galleries import Page
from gallery_site import PHONE, WIDE, Visit, closed_after
from screens import OVERFLOW, grave_faults

ROOT = Path(__file__).parents[2]
BUILT = "GAUSS2SVG_SITE"  # the folder of a site that is built already
LOOKED_AT = ("index", "guide/studio", "reference/options", "development", "search")

pytestmark = pytest.mark.example


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
def pages(site) -> dict[Path, Page]:
    found = {path.resolve(): Page(path) for path in sorted(site.rglob("*.html"))}
    sample = (site / "sample").resolve()  # a gallery, whose pages have tests of their own
    assert sample / "index.html" in found
    ours = {path: page for path, page in found.items() if not path.is_relative_to(sample)}
    assert len(ours) > 50
    return ours


def values(page: Page, *names: str) -> set[str]:
    """What these attributes of elements of a page are, where they are not empty."""
    return {value for _, given in page.parts for name, value in given if name in names and value}


def test_links_lead_to_pages_and_anchors_that_exist(pages):
    ids = {path: values(page, "id", "name") for path, page in pages.items()}
    for path, page in pages.items():
        for address in map(urlsplit, values(page, "href", "src")):
            if address.scheme:
                continue
            target = (path.parent / unquote(address.path)).resolve() if address.path else path
            assert target.exists(), (path, address)
            if address.fragment and target in pages:
                assert unquote(address.fragment) in ids[target], (path, address)


@pytest.fixture(scope="module")
def open_one(site, tabs):
    with closed_after(partial(Visit, tabs, site)) as visit:  # fails on errors and strange requests
        yield visit


@pytest.mark.browser
@pytest.mark.parametrize("name", LOOKED_AT)
def test_pages_are_accessible_in_light_and_dark_wide_and_narrow(open_one, name):
    one = open_one(viewport=PHONE, color_scheme="dark")
    one.page.set_default_timeout(30_000)
    page = one.go(f"{name}.html")
    for scheme, size in (("dark", PHONE), ("light", WIDE)):
        page.set_viewport_size(size)
        page.emulate_media(color_scheme=scheme)
        assert not grave_faults(page)
        assert page.evaluate(OVERFLOW) == 0
