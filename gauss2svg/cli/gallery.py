"""The command `gauss2svg gallery`; the command line loads it only when it is asked for."""

import re
import shlex
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from gauss2svg.gallery.options import GalleryOptions

STATUS_SOME_FAILED = 1


def gallery_command(
    photos: Annotated[list[str], Parameter(negative="")],
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    variants: str | None = None,
    counts: str | None = None,
    peers: str = "",
    options: Annotated[GalleryOptions, Parameter(name="*", group="Gallery")] = GalleryOptions(),
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Write a gallery: pages that show what becomes of photos, to be opened from the disk.

    Parameters
    ----------
    photos
        The photos.
    output
        The folder for the pages; open its index.html. Run again after an interruption, or with
        more photos or variants: what is finished is kept.
    variants
        Presets to show, by commas: draft, fast, balanced, high, max. Without --counts too,
        draft,balanced,high.
    counts
        Numbers of Gaussians to show, by commas: 500,2000,8000.
    peers
        Other tools to show, by commas, where installed: vtracer, splatthis, primitive; or in
        another style of theirs, such as vtracer:detailed.
    quiet
        Show neither progress nor summary.

    """
    from gauss2svg.cli.progress_bar import counting_bar
    from gauss2svg.gallery.build import build_gallery

    with counting_bar(quiet) as update:
        gallery = build_gallery(
            photos,
            output,
            variants=None if variants is None else _words(variants),
            counts=None if counts is None else [_whole(word) for word in _words(counts)],
            peers=_words(peers),
            options=options,
            command=shlex.join(["gauss2svg", *sys.argv[1:]]),
            progress=lambda at: update("; ".join(at.now), at.done, at.total),
        )
    if gallery.absent:
        _tell(f"not installed, left out: {', '.join(gallery.absent)}")
    for failure in gallery.failures:
        named = failure.photo.name + (f", {failure.variant.name}" if failure.variant else "")
        _tell(f"failed: {named}: {failure.error}")
    if not quiet:
        count = len(gallery.rows)
        kept = f", {gallery.kept} of them kept from before" if gallery.kept else ""
        _tell(
            f"{count} SVG{'s' if count != 1 else ''}{kept}; {len(gallery.failures)} failed; "
            f"open {gallery.index}"
        )
    return STATUS_SOME_FAILED if gallery.failures else 0


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _whole(word: str) -> int:
    from gauss2svg.errors import InputError

    if not re.fullmatch("[0-9]{1,18}", word):
        raise InputError(f"count is {word!r}; needed are whole numbers by commas: 500,2000,8000")
    return int(word)


def _tell(line: str) -> None:
    from gauss2svg.errors import on_one_line

    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)
