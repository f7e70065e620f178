"""The command `gauss2svg placeholder`, imported only where it is run."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal
from urllib.parse import quote

from cyclopts import Parameter

from gauss2svg.options import OptionGroup
from gauss2svg.pipeline.placeholder import DEFAULT_BYTES, Placeholder, check_bytes

if TYPE_CHECKING:
    from gauss2svg.gallery.photos import GalleryPhoto

STATUS_SOME_FAILED = 1


@dataclass(frozen=True, kw_only=True)
class PlaceholderOptions(OptionGroup):
    """What is written for each photo."""

    max_bytes: Annotated[int | str, check_bytes] = DEFAULT_BYTES
    """Maximum size of each SVG, 20k or less."""

    format: Literal["json", "html", "svg"] = "json"
    """json: a list with SVG, data URIs, size and mean colour of each photo, by SQIP's keys; html:
    an img element for each, with the placeholder behind it; svg: files."""


_DEFAULTS = PlaceholderOptions()


def placeholder_command(
    photos: Annotated[list[str], Parameter(negative="", help="Photos.")],
    *,
    output: Annotated[
        str,
        Parameter(
            name=["--output", "-o"],
            allow_leading_hyphen=True,
            help="File to write, with svg the folder for them; - is standard output.",
        ),
    ] = "-",
    options: Annotated[PlaceholderOptions, Parameter(name="*", group="Placeholders")] = _DEFAULTS,
    quiet: Annotated[
        bool, Parameter(negative="", help="Show neither progress nor summary.")
    ] = False,
) -> int:
    """Write placeholders of about a kilobyte, which a page shows until its photos have come."""
    from gauss2svg.cli.progress_bar import counting_bar
    from gauss2svg.errors import Gauss2SvgError
    from gauss2svg.files import STANDARD_STREAM, refuse_option_like
    from gauss2svg.gallery.photos import gallery_photos
    from gauss2svg.pipeline.placeholder import placeholder

    refuse_option_like(*photos, output)
    once = gallery_photos(photos)
    targets = _targets(output, options.format, [photo.slug for photo in once])
    _check({photo.path: "a photo" for photo in once}, targets)
    made: list[tuple[GalleryPhoto, Placeholder]] = []
    failures = []
    with counting_bar(quiet) as update:
        for at, photo in enumerate(once):
            update(photo.name, at, len(once))
            try:
                if photo.problem is not None:
                    failures.append(f"failed: {photo.problem}")
                    continue
                made.append((photo, placeholder(photo.path, options.max_bytes)))
            except Gauss2SvgError as error:
                line = str(error).replace("max_bytes must", "--max-bytes must")
                failures.append(f"failed: {photo.name}: {line}")
    _write(made, output, options.format)
    if len(once) < len(photos):
        _print(f"{len(photos) - len(once)} of {len(photos)} photos given more than once")
    for photo, one in made:
        if not one.gaussians:
            _print(f"without Gaussians, for which it has no room or no need: {photo.name}")
    for line in failures:
        _print(line)
    if not quiet:
        where = "standard output" if output == STANDARD_STREAM else output
        _print(
            f"{len(made)} placeholder{'s' * (len(made) != 1)} in {where}; {len(failures)} failed"
        )
    return STATUS_SOME_FAILED if failures else 0


def _targets(output: str, form: str, slugs: list[str]) -> list[Path]:
    """The files that are written; none for standard output."""
    from gauss2svg.errors import InputError, must_be
    from gauss2svg.files import STANDARD_STREAM

    if output != STANDARD_STREAM:
        if form == "svg" and Path(output).suffix.lower() == ".svg":
            needed = "a folder with --format svg"
            raise InputError(must_be("--output", needed, output, str(Path(output).with_suffix(""))))
        return [Path(output) / f"{slug}.svg" for slug in slugs] if form == "svg" else [Path(output)]
    if form == "svg" and len(slugs) > 1:
        raise InputError("--output must be given for several SVGs. Try -o folder")
    return []


def _check(photos: dict[str, str], targets: list[Path]) -> None:
    """Refuse outputs that would overwrite a photo, or could not be written."""
    from gauss2svg.errors import OutputError
    from gauss2svg.files import check_outputs

    for folder in {target.parent for target in targets}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot write {folder}: {error.strerror or error}. Try another folder"
            ) from error
    check_outputs(photos, targets)


def _write(made: list[tuple["GalleryPhoto", Placeholder]], output: str, form: str) -> None:
    import json

    from gauss2svg.cli.streams import standard_stream
    from gauss2svg.files import STANDARD_STREAM, write_all_atomically

    if form == "svg" and output != STANDARD_STREAM:
        write_all_atomically(
            {Path(output) / f"{photo.slug}.svg": one.svg.encode() for photo, one in made}
        )
        return
    if form == "json":
        records = [one.record(photo.name) for photo, one in made]
        text = json.dumps(records, indent=2) + "\n"
    elif form == "html":
        folder = "." if output == STANDARD_STREAM else os.path.dirname(output) or "."
        text = "".join(f"{one.snippet(_url(photo.path, folder))}\n" for photo, one in made)
    elif not made:
        return
    else:
        text = made[0][1].svg
    if output == STANDARD_STREAM:
        stdout = standard_stream(sys.stdout, "output")
        stdout.write(text.encode())
        stdout.flush()
    else:
        write_all_atomically({output: text.encode()})


def _url(path: str, folder: str) -> str:
    """The address of a photo in a page of this folder; any bytes of a name are escaped."""
    return quote(os.fsencode(Path(os.path.relpath(path, folder)).as_posix()))


def _print(line: str) -> None:
    from gauss2svg.errors import on_one_line

    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)
