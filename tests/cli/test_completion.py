"""Completions of shells know the commands, their options, and the choices of these."""

import subprocess

import pytest

from gauss2svg.cli.parser import COMMANDS

pytest.importorskip("shtab")

from gauss2svg.cli.completion import completion

BASH = """
source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_shtab_gauss2svg gauss2svg "${COMP_WORDS[COMP_CWORD]}" ""; echo "${COMPREPLY[*]}"
"""


@pytest.mark.posix
@pytest.mark.parametrize(
    ("words", "completed"),
    [("ga", "gallery"), ("--qual", "--quality"), ("photo.jpg --quality dr", "draft"),
     ("gallery --fr", "--from"), ("batch --log j", "json"), ("check README.m", "README.md")],
)  # fmt: skip
def test_bash_completes_commands_options_choices_and_files(words, completed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "README.md").touch()
    (tmp_path / "completion.bash").write_text(completion("bash"))
    command = ["bash", "-c", BASH, "bash", "./completion.bash", "gauss2svg", *words.split()]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split() == [completed]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_have_all_commands(shell):
    script = completion(shell)
    assert not [name for name in (*COMMANDS, "quality", "balanced") if name not in script]
