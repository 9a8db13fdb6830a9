"""The file that tells where a cell is."""

import os
import subprocess
import sys

import pytest

from dtwin.services.runfile import RunFile, Up, find
from tests.support.desk import Desk


@pytest.fixture
def gone() -> int:
    """The id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait(60.0)
    return process.pid


def test_a_cell_that_begins_is_not_taken_for_the_killed_one_before_it(desk: Desk, gone: int) -> None:
    killed = Up(gone, "arm", "tcp/127.0.0.1:1", None, "unix:/x/61499", ready=True)
    here = Up(os.getpid(), "arm", "tcp/127.0.0.1:2", None, "unix:/x/61499")
    with RunFile("cell") as file:
        file.write(killed)
        left = file.path.read_bytes()
    assert find("cell") is None
    file.path.write_bytes(left)
    with RunFile("cell") as file:
        assert find("cell") is None, "it has not said yet where it is"
        file.write(here)
        assert find("cell") == here
    assert find("cell") is None
