"""Photos that are uploaded or picked: checked by their headers, kept under names of ours."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path, PurePath
from urllib.parse import quote

from pydantic import BaseModel, Field

from gauss2svg.batch.inputs import is_picture
from gauss2svg.errors import InputError, brief, refusal
from gauss2svg.files import is_device, reading
from gauss2svg.photo.decode import opened
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS

_OF_SKIMAGE = ("coffee.png", "chelsea.png", "astronaut.png", "rocket.jpg")
# Not read, but offered by the dialog for files, so that the page says why.
REFUSED = (".jxl",)
_MOST_SAMPLES = 100
_LONGEST_NAME = 100


class Sample(BaseModel):
    """A picture that can be picked; width and height in px."""

    name: str
    path: Path = Field(exclude=True)
    width: int
    height: int
    url: str
    """Address of its file, relative to the page."""


def display_name(given: str | None) -> str:
    """The last part of a file's name, fit to be shown and to be offered for a download."""
    last = re.split(r"[/\\]", given or "")[-1]
    plain = "".join(c for c in last if unicodedata.category(c)[0] != "C" and c not in '<>:"|?*')
    stem, dot, suffix = plain.strip(". ").rpartition(".")
    return f"{stem[:_LONGEST_NAME]}{dot}{suffix[:8]}" if stem else suffix[:_LONGEST_NAME] or "photo"


def stem_of(name: str) -> str:
    """What a display name begins with, as any system takes it for the name of a file."""
    stem = PurePath(name).stem.encode()[:200].decode(errors="ignore")
    return f"_{stem}" if is_device(stem) else stem


def size_of(path: Path, name: str) -> tuple[int, int]:
    """Width and height in px of an upright photo, by its header alone.

    Raises InputError that says the name, for what is no photo and for too many pixels.
    """
    with reading(path, "another photo") as file:
        return opened(file.read(), name, DEFAULT_MAX_PIXELS).upright_size


def samples_in(folder: Path | None) -> Sequence[Sample]:
    """Photos of a folder, or some of scikit-image's; raises InputError where a folder has none."""
    if folder is None:
        from skimage import data

        place = Path(data.__file__).parent
        paths = [place / name for name in _OF_SKIMAGE if (place / name).is_file()]
    else:
        paths = [p for p in sorted(folder.glob("*")) if is_picture(p.name)]
    found = []
    for path in paths[:_MOST_SAMPLES]:
        try:
            width, height = size_of(path, path.name)
        except InputError:  # it says so when it is picked nowhere: it is no photo to pick
            continue
        name = os.fsencode(path.name).decode(errors="backslashreplace")  # for a page
        url = f"api/samples/{quote(name, safe='')}"
        found.append(Sample(name=name, path=path, width=width, height=height, url=url))
    if folder is not None and not found:
        advice = "another folder, or none for pictures of scikit-image"
        raise refusal("FOLDER", "a folder with photos", brief(str(folder)), advice)
    return found
