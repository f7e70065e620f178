"""Photos, parsers of pages and stand-ins for workers that the tests of the gallery share."""

import csv
from html.parser import HTMLParser

import numpy as np
from PIL import Image

from gauss2svg.compare.grid import flat
from gauss2svg.compare.run import _write
from gauss2svg.errors import RendererError
from gauss2svg.files import as_json


def save(pixels, path, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(path, **options)
    return path


BLANK = '<svg xmlns="http://www.w3.org/2000/svg" width="64" height="48"/>'


def program(path, body):
    """A program: a script of the shell."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o700)
    return path


def cells_of(path):
    """The rows of a CSV file, without empty cells."""
    with path.open(newline="") as stream:
        return [{k: v for k, v in row.items() if v} for row in csv.DictReader(stream)]


def cells_expected(rows):
    """What a CSV file of these rows of JSON has."""
    return [{k: str(v) for k, v in flat(row).items() if v not in (None, "")} for row in rows]


class Page(HTMLParser):
    """The elements of a page with their attributes, its texts, and the rows of its tables."""

    def __init__(self, path):
        super().__init__()
        self.parts, self.texts, self.rows, self._is_cell = [], [], [], False
        self.feed(path.read_text())
        self.close()

    def handle_starttag(self, tag, attrs):
        self.parts.append((tag, attrs))
        if tag == "tr":
            self.rows.append([])
        self._is_cell = tag in ("th", "td") or (self._is_cell and tag not in ("tr", "caption"))
        if tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        self._is_cell = self._is_cell and tag not in ("th", "td")

    def handle_data(self, data):
        if data.strip():
            self.texts.append(" ".join(data.split()))
        if self._is_cell:
            self.rows[-1][-1] += data


class Asked(list):
    """The requests of a gallery, as (kind, folder)."""

    def take(self):
        found = sorted(self, key=str)
        self.clear()
        return found


CROP = {"x": 0, "y": 0, "width": 5, "height": 5, "psnr": None}


def canned(request):
    """Stands in for make_svg: files without content, at once."""
    count = request["settings"].get("gaussians", 100)
    if count == 13:
        raise RendererError("un\nlucky \udcff")
    report = {
        "gaussians": count, "svg_bytes": 100 * count, "svgz_bytes": 10 * count, "fit_s": 0.1,
        "total_s": 0.1 * count, "psnr_svg": None if count == 7 else 20.0,
        "ssim_svg": 0.5, "ssimulacra2_svg": -20.0, "flip_svg": 0.25,
        "renderer": "resvg 1", "seed": 0, "notes": [],
    }  # fmt: skip
    names = ("picture.svg", "scene.npz", "outlines.svg", "thumbnail.png", "errors.png")
    files = dict.fromkeys(names, b"<svg/>") | {"report.json": as_json(report)}
    _write(request["folder"], files)
    crops = {"worst": CROP, "typical": CROP}
    return {"report": report, "cpu_s": 0.1, "rounds": [[1, count]], "crops": crops}


def all_requests(photos, variants):
    found = [("photo", photo) for photo in photos]
    return sorted(found + [("variant", f"{p}/{v}") for p in photos for v in variants])
