"""What the tests of services have in common."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.desk import Desk


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Desk]:
    folder = tmp_path / "runtime"
    folder.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    desk = Desk(folder, capsys)
    yield desk
    for pid in desk.processes():
        os.kill(pid, signal.SIGKILL)
