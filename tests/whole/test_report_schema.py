"""gauss2svg/report.schema.json: reports of all commands have the types that it says."""

import json
import re
from pathlib import Path

import jsonschema
import pytest
from batches import PoolHere
from gallery_site import hastily

import gauss2svg
from gauss2svg.cli.main import main

SCHEMA = json.loads((Path(gauss2svg.__file__).parent / "report.schema.json").read_text())


@pytest.fixture
def check():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    return jsonschema.Draft202012Validator(SCHEMA).validate


@pytest.mark.process
@pytest.mark.usefixtures("hasty", "drawn_here", "pool_here")
def test_reports_of_all_commands_are_of_the_schema(two, tmp_path, check, capsys, monkeypatch):
    monkeypatch.setattr("gauss2svg.compare.table.Pool", PoolHere)
    monkeypatch.chdir(tmp_path)
    first = str(two[0])
    more = "--scores --target-psnr 20 --inks #000,#fff --size 30mm --alt A"
    make = [first, "-o", "o.svg", "--overwrite", "--quiet", "--report", "r.json"]
    for words in ("", more, "--blend add", "--max-bytes 900", "--animate 2"):
        assert main([*make, *words.split()]) == 0
        check(report := json.loads(Path("r.json").read_text()))
        assert not [key for key in report if not is_declared(key)]
    assert main(["check", first, "o.svg", "--report", "c.json"]) == 0
    check(report := json.loads(Path("c.json").read_text()))
    assert not [key for key in report if not is_declared(key)]
    Path("bad.png").write_bytes(b"none")
    capsys.readouterr()
    both = [str(path) for path in two]
    assert main(["batch", *both, "bad.png", "-o", "out", "--log", "json", "--quiet"]) == 1
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    with hastily():
        assert main(["gallery", *both, "-o", "site", "--counts", "9", "--peers", "jpeg"]) == 0
    assert main(["bench", *both, "-o", "bench", "--axis", "gaussians=9", "--peers", "b=out"]) == 0
    for name in ("site/gallery.json", "bench/bench.json"):
        lines += json.loads(Path(name).read_text())["rows"]
    lines += [json.loads(path.read_text()) for path in Path("site").rglob("report.json")]
    assert len(lines) == 3 + 4 + 4 + 4
    for line in lines:
        check(line)


def is_declared(key: str) -> bool:
    row = SCHEMA["$defs"]["row"]
    return key in row["properties"] or any(re.search(one, key) for one in row["patternProperties"])
