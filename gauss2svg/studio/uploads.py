"""Sizes and names of uploaded photos and samples.

A size is read from the header of the file, and a name is made safe to show.
"""

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
from gauss2svg.photo import DEFAULT_MAX_PIXELS
from gauss2svg.photo.load import opened

_SKIMAGE_SAMPLES = ("coffee.png", "chelsea.png", "astronaut.png", "rocket.jpg")
# Suffixes of files that cannot be read. The file dialog still offers them, so that the page can say
# why.
REFUSED = (".jxl",)
_MOST_SAMPLES = 100
_LONGEST_NAME = 100  # largest number of characters of a display name before its suffix


class Sample(BaseModel):
    """A picture of the server that users can pick if they do not want to upload one.

    Its width and height are in px.
    """

    name: str
    path: Path = Field(exclude=True)
    width: int
    height: int
    url: str
    """Address of its file, relative to the page."""


def display_name(path: str | None) -> str:
    """Return the last part of a path, made safe to show on a page and to name a download."""
    last = re.split(r"[/\\]", path or "")[-1]
    safe = "".join(c for c in last if unicodedata.category(c)[0] != "C" and c not in '<>:"|?*')
    stem, dot, suffix = safe.strip(". ").rpartition(".")
    return f"{stem[:_LONGEST_NAME]}{dot}{suffix[:8]}" if stem else suffix[:_LONGEST_NAME] or "photo"


def stem_of(name: str) -> str:
    """Return a display name without its suffix, made a valid file name on any system."""
    stem = PurePath(name).stem.encode()[:200].decode(errors="ignore")
    return f"_{stem}" if is_device(stem) else stem


def size_of(path: Path, name: str) -> tuple[int, int]:
    """Return the width and height (px) of a photo after it is turned upright.

    Only the header of the photo is decoded. Raise InputError, with the name in its message, if the
    file is not a photo or has too many pixels.
    """
    with reading(path, "another photo") as file:
        return opened(file.read(), name, DEFAULT_MAX_PIXELS).upright_size


def samples_in(folder: Path | None) -> Sequence[Sample]:
    """Return the photos of a folder, or pictures of scikit-image if the folder is None.

    Raise InputError if the folder has no photos.
    """
    if folder is None:
        from skimage import data

        parent = Path(data.__file__).parent
        paths = [parent / name for name in _SKIMAGE_SAMPLES if (parent / name).is_file()]
    else:
        paths = [p for p in sorted(folder.glob("*")) if is_picture(p.name)]
    samples = []
    for path in paths[:_MOST_SAMPLES]:
        try:
            width, height = size_of(path, path.name)
        except InputError:  # a file that cannot be read is not offered on the page
            continue
        # A page must be valid Unicode, so bytes of the name that are not valid are escaped.
        name = os.fsencode(path.name).decode(errors="backslashreplace")
        url = f"api/samples/{quote(name, safe='')}"
        samples.append(Sample(name=name, path=path, width=width, height=height, url=url))
    if folder is not None and not samples:
        advice = "another folder, or none for pictures of scikit-image"
        raise refusal("FOLDER", "a folder with photos", brief(str(folder)), advice)
    return samples
