"""The documentation: its code runs, and its reference is complete. The source keeps its rules."""

from __future__ import annotations

import gzip
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import COMMANDS, command_of, main
from gauss2svg.cli.summary import STOPPED

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
# <!-- not run: REASON --> before a block leaves it out, <!-- not run where TEXT: REASON --> the
# lines of it that contain the text.
BLOCK = re.compile(
    r"(?P<marks>(?:^<!-- not run.*? -->\n)*)^```(?P<kind>\w+)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
MARK = re.compile(r"<!-- not run(?: where (?P<text>[^:]*))?: (?P<reason>[^>]+) -->")
SHELL, PYTHON, TOML = ("sh", "bash"), "python", "toml"
NO_CODE = ("text", "dockerfile", "xml", "html", "json")


def blocks_of(page: Path) -> list[tuple[str, str, int]]:
    """Kind, code and line of each block of code that runs."""
    text, found = page.read_text(), []
    for match in BLOCK.finditer(text):
        marks = [mark.groupdict() for mark in MARK.finditer(match["marks"])]
        assert all(mark["reason"].strip() for mark in marks)
        if match["kind"] in NO_CODE or any(mark["text"] is None for mark in marks):
            continue
        lines = match["code"].splitlines()
        for mark in marks:
            kept = [line for line in lines if mark["text"] not in line]
            assert len(kept) < len(lines), f"{page}: no line has {mark['text']}"
            lines = kept
        line = text.count("\n", 0, match.start("code")) + 1
        found.append((match["kind"], "\n".join(lines), line))
    return found


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


WITH_CODE = [page for page in PAGES if blocks_of(page)]


@pytest.fixture
def pictures(photo, tmp_path, monkeypatch) -> None:
    """A folder with the files that the documentation names, as small as can be."""
    monkeypatch.chdir(tmp_path)
    levels = np.uint8(255 * photo[44:52, 50:62])
    svg = gauss2svg.vectorize(levels, gaussians=5).svg
    small = Image.fromarray(levels)
    for name in ("photo", "photos/one", "more/two", "public/photos/lake", "sketch"):
        name = f"{name}.jpg"
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        small.save(name, quality=95, dpi=(300, 300))
    small.save("logo.png")
    alpha = np.full(levels.shape[:2], 255, np.uint8)
    alpha[:, :4] = 0
    Image.fromarray(np.dstack([levels, alpha])).save("cutout.png")
    Image.fromarray(np.uint8(levels[:, :, 0] > 99)).save("labels.png")
    Path("list.txt").write_text("logo.png\n")
    Path("theirs.svgz").write_bytes(gzip.compress(svg.encode()))
    for name in ("any.svg", "out.svg"):
        Path(name).write_text(svg)


@pytest.fixture
def in_this_process(hasty, drawn_here, asked, pool_here) -> None:
    """Fits are short, nothing starts a process, and SVGs of galleries are made up."""


def run_line(line: str) -> None:
    """A line of a shell: the program in this process, anything else by bash."""
    words = shlex.split(line, comments=True)
    if not words:
        return
    if words[0] == "gauss2svg" and not {"|", "||", ">"} & set(words):
        assert main(words[1:]) == 0, line
        return
    program = f'gauss2svg() {{ "{sys.executable}" -P -m gauss2svg "$@"; }}\n{line}'
    run = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", program], capture_output=True, text=True
    )
    assert run.returncode == 0, f"{line}\n{run.stderr}"


@pytest.mark.example
@pytest.mark.parametrize("page", WITH_CODE, ids=named)
def test_every_block_of_code_runs(page, pictures, in_this_process, monkeypatch):
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    monkeypatch.setenv("PYTHONPATH", path)
    names: dict = {"__name__": "__main__"}
    for kind, code, begins in blocks_of(page):
        try:
            if kind in SHELL:
                for line in code.replace("\\\n", "").splitlines():
                    run_line(line)
            elif kind == PYTHON:
                exec(compile(code, named(page), "exec"), names)
            else:
                assert kind == TOML, f"unknown kind of code: {kind}"
                gauss2svg.Options().changed(**tomllib.loads(code))
        except Exception as error:
            error.add_note(f"{named(page)}, the block at line {begins}")
            raise


@pytest.mark.sweep
def test_commands_that_are_left_out_have_options_that_exist():
    blocks = [block for page in PAGES for block in BLOCK.finditer(page.read_text())]
    left_out = [one["code"] for one in blocks if one["marks"] or one["kind"] in NO_CODE]
    code = "".join(left_out).replace("\\\n", "")
    for line in set(re.findall(r"^gauss2svg .*$", code, re.MULTILINE)):
        words = shlex.split(re.split(r" [|>]", line)[0], comments=True)
        _, parser, rest = command_of(words[1:])
        given = parser.read(rest)
        for group in parser.groups:
            group.of(given)


def test_links_of_the_readme_lead_to_files():
    readme = ROOT / "README.md"
    for link in re.findall(r"\]\(([^)#]+)", readme.read_text()):
        assert (ROOT / link).exists(), link


def test_citations_have_the_present_version():
    assert f"version = {{{gauss2svg.__version__}}}," in (DOCS / "guide/research.md").read_text()
    assert f"\nversion: {gauss2svg.__version__}\n" in (ROOT / ".github/CITATION.cff").read_text()


def test_tables_of_pages_are_those_of_the_code():
    tables, text = run_path(str(DOCS / "tables.py")), "".join(page.read_text() for page in PAGES)
    for page in PAGES:
        assert tables["updated"](page.read_text()) == page.read_text(), "run python docs/tables.py"
    assert {f"<!-- table: {name}" in text for name in tables["TABLES"]} == {True}
    commands = set(re.findall(r"<!-- table: options (\w+)", text))
    assert commands == {"gauss2svg", *COMMANDS}


def test_every_public_name_is_in_the_reference():
    pages = "".join(p.read_text() for p in (DOCS / "reference").glob("*.md"))
    documented = set(re.findall(r"^\.\. auto\w+:: (\w+)$", pages, re.MULTILINE))
    options = set(re.findall(r"^`gauss2svg\.(\w+)`", pages, re.MULTILINE))  # above a list of them
    assert {name for name in gauss2svg.__all__ if name[0] != "_"} <= documented | options


def test_every_key_of_a_report_is_in_the_reference(photo):
    page = (DOCS / "reference" / "report.md").read_text()
    report = gauss2svg.vectorize(photo[:16, :16], gaussians=3).report
    options = gauss2svg.Options().flat()
    said = set(re.findall(r"`(\w+)`", page))
    assert not [key for key in report if key not in said | set(options)]
    parts = page.split("\n## ")
    keys = {part.partition("\n")[0]: first_column(part) for part in parts}
    assert not (keys["What was reached"] | keys["What the fit did"]) - set(report)
    assert keys["Stop reasons"] - {"stop_reason"} == set(STOPPED)


def test_every_array_of_a_scene_file_is_in_the_guide(tmp_path):
    gauss2svg.Scene(4, 3).save(tmp_path / "scene.npz")
    part = (DOCS / "guide" / "python.md").read_text().partition("| array |")[2]
    with np.load(tmp_path / "scene.npz") as stored:
        assert set(stored.files) == first_column(part.partition("\n\n")[0])


def first_column(part: str) -> set[str]:
    """Words of code that stand in the first column of a table."""
    cells = re.findall(r"^\| (.+?) \|", part, re.MULTILINE)
    return {word for cell in cells for word in re.findall(r"`(\w+)`", cell)}


def test_every_shell_takes_the_lines_for_a_shell():
    """cmd of Windows knows no single quotes, no comments and no backslash at the end of a line."""
    for page in PAGES:
        lines = [
            line
            for block in BLOCK.finditer(page.read_text())
            for line in block["code"].splitlines()
        ]
        commands = [line for line in lines if line.startswith(("gauss2svg", "pip"))]
        assert not [line for line in commands if re.search(r"'| # |\\$", line)], page
