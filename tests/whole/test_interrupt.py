"""Laws of interrupted processes: whole files, one line, the status of the signal.

The short form of tests/shared/interrupt.py.
"""

import sys

import pytest
from interrupt import interrupted

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    return tmp_path_factory.mktemp("kernels")


@pytest.mark.parametrize("number", range(2))
def test_an_interrupted_process_leaves_whole_files_and_says_one_line(number, kernels):
    outcome, said = interrupted(0, number, kernels)
    assert not outcome.startswith("FINDING"), f"{outcome}: {said}"
