"""The command `gauss2svg placeholder`, imported only where it is run."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import quote

from cyclopts import Parameter

from gauss2svg.cli.parameters import Photos, Quiet
from gauss2svg.cli.streams import counting_bar, say, write_output
from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, quoted
from gauss2svg.files import (
    STANDARD_STREAM,
    check_outputs,
    expanded,
    reading,
    refuse_option_like,
    write_all_atomically,
)
from gauss2svg.options import OptionGroup
from gauss2svg.photo.listing import ListedPhoto, listed_photos
from gauss2svg.pipeline.placeholder import DEFAULT_BYTES, Placeholder, check_bytes, placeholder

STATUS_SOME_FAILED = 1
_IMAGE = '<img src="'  # with which a line of HTML begins


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
    photos: Photos,
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
    quiet: Quiet = False,
) -> int:
    """Write placeholders of about a kilobyte, which a page shows until its photos have come."""
    photos = expanded(photos)
    refuse_option_like(*photos, output)
    once = listed_photos(photos)
    targets = _targets(output, options.format, [photo.slug for photo in once])
    _check({photo.path: "a photo" for photo in once}, targets)
    before = {} if options.format == "svg" else _entries(output, options.format)
    made: dict[ListedPhoto, Placeholder] = {}
    failures = []
    with counting_bar(quiet) as update:
        for at, photo in enumerate(once):
            update(photo.name, at, len(once))
            try:
                if photo.problem is not None:
                    failures.append(f"failed: {photo.problem}")
                    continue
                made[photo] = placeholder(photo.path, options.max_bytes)
            except Gauss2SvgError as error:
                line = str(error).replace("max_bytes must", "--max-bytes must")
                failures.append(f"failed: {photo.name}: {line}")
    kept = _write(once, made, before, output, options.format) if made else 0
    if len(once) < len(photos):
        say(f"{len(photos) - len(once)} of {len(photos)} photos given more than once")
    for photo, one in made.items():
        if not one.gaussians:
            say(f"without Gaussians, for which it has no room or no need: {photo.name}")
    for line in failures:
        say(line)
    if not quiet:
        where = f" in {'standard output' if output == STANDARD_STREAM else output}"
        say(
            f"{len(made)} placeholder{'s' * (len(made) != 1)}{where if made else ''}; "
            f"{len(failures)} failed{'' if made else ', and nothing was written'}"
            + (f"; {kept} of them kept from before" if kept else "")
        )
    return STATUS_SOME_FAILED if failures else 0


def _targets(output: str, form: str, slugs: list[str]) -> list[Path]:
    """The files that are written; none for standard output."""
    if output != STANDARD_STREAM:
        if form == "svg" and Path(output).suffix.lower() == ".svg":
            raise InputError(
                f"--output must be a folder with --format svg; got {quoted(output)}. Try "
                f"{Path(output).with_suffix('')!s}"
            )
        return [Path(output) / f"{slug}.svg" for slug in slugs] if form == "svg" else [Path(output)]
    if form == "svg" and len(slugs) > 1:
        raise InputError("--output must be given for several SVGs. Try -o folder")
    return []


def _check(photos: dict[str, str], targets: list[Path]) -> None:
    """Refuse outputs that would overwrite a photo, or could not be written."""
    for folder in {target.parent for target in targets}:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                f"cannot write {folder}: {error.strerror or error}. Try another folder"
            ) from error
    check_outputs(photos, targets)


def _write(
    photos: list[ListedPhoto],
    made: dict[ListedPhoto, Placeholder],
    before: dict[str, Any],
    output: str,
    form: str,
) -> int:
    """Write what was made; what the file has of photos that failed is kept: returns how many."""
    if form == "svg" and output != STANDARD_STREAM:
        files = {Path(output) / f"{photo.slug}.svg": one.svg for photo, one in made.items()}
        write_all_atomically({path: svg.encode() for path, svg in files.items()})
        return 0
    folder = "." if output == STANDARD_STREAM else os.path.dirname(output) or "."
    names = {photo: photo.file if form == "json" else _url(photo.path, folder) for photo in photos}
    listed = [photo for photo in photos if photo in made or names[photo] in before]
    if form == "json":
        records = [
            made[photo].record(names[photo]) if photo in made else before[names[photo]]
            for photo in listed
        ]
        text = json.dumps(records, indent=2) + "\n"
    elif form == "html":
        text = "".join(
            f"{made[photo].snippet(names[photo]) if photo in made else before[names[photo]]}\n"
            for photo in listed
        )
    else:
        (one,) = made.values()
        text = one.svg
    if output == STANDARD_STREAM:
        write_output(text.encode())
    else:
        write_all_atomically({output: text.encode()})
    return len(listed) - len(made)


def _entries(output: str, form: str) -> dict[str, Any]:
    """What an earlier run has written for each photo, by its name or address.

    Raises InputError for a file that cannot be read as such: to replace it would lose what it has.
    """
    if output == STANDARD_STREAM or not Path(output).is_file():
        return {}
    with reading(output, "another name for --output") as file:
        data = file.read()
    try:
        text = data.decode()
        if form == "html":
            lines = [line for line in text.split("\n") if line.strip()]
            if not lines or not all(line.startswith(_IMAGE) for line in lines):
                raise ValueError("not lines of <img>")
            return {line.removeprefix(_IMAGE).partition('"')[0]: line for line in lines}
        records = json.loads(text)
        if not isinstance(records, list):
            raise TypeError("not a list")
        return {record["metadata"]["filename"]: record for record in records}
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise InputError(
            f"--output must be a file of placeholders in {form}, or none yet; got {output}, "
            "which has something else or is damaged. Try another name, or remove it"
        ) from error


def _url(path: str, folder: str) -> str:
    """The address of a photo in a page of this folder; any bytes of a name are escaped."""
    return quote(os.fsencode(Path(os.path.relpath(path, folder)).as_posix()))
