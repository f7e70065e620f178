"""Laws of interrupted processes: whole files, one line, the status of the signal.

The short form of tests/shared/interrupt.py.
"""

import os
import subprocess
import sys

import pytest
from interrupt import interrupted

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]


# A signal that comes while text is executed, as numba does where it compiles.
LOST_IN_EXEC = """
import signal
from gauss2svg.cli import main
from gauss2svg.cli.signals import status_of
def interrupted():
    try:
        exec("raise KeyboardInterrupt")
    except KeyboardInterrupt:
        return status_of(signal.SIGINT)
main.main = interrupted
main.run()
"""


def test_the_status_is_that_of_the_command_wherever_a_signal_is_raised(tmp_path):
    (tmp_path / "command.py").write_text(LOST_IN_EXEC)
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    command = [sys.executable, "-m", "command"]
    assert subprocess.run(command, env={**os.environ, "PYTHONPATH": path}).returncode == 130


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    return tmp_path_factory.mktemp("kernels")


@pytest.mark.parametrize("number", range(2))
def test_an_interrupted_process_leaves_whole_files_and_says_one_line(number, kernels):
    outcome, said = interrupted(0, number, kernels)
    assert not outcome.startswith("FINDING"), f"{outcome}: {said}"
