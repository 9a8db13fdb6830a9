"""The history of the settings survives what happens to its writers."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.errors import RecordingError
from dtwin.parameters import Gains
from dtwin.simulation.history import Entry, History


def entry(version: int, why: str = "") -> Entry:
    settings = ControlSettings(gains=usual_gains("computed_torque", kp=(float(version), 0.1, 1 / 3)))
    return Entry(version, 1.5, "upload", "somebody", why, "gains", settings, "ok", (0.1, 0.2, 0.3))


def test_entries_come_back_as_they_were(tmp_path: Path) -> None:
    history = History(tmp_path / "h.jsonl")
    assert history.entries() == []
    assert history.last() is None
    written = [entry(k, 'quotes " and\nnew lines, åäö') for k in range(5)]
    for each in written:
        history.append(each)
    assert history.entries() == written
    assert history.last() == written[-1]
    assert history.path.read_bytes().count(b"\n") == 5


@given(cut=st.integers(1, 400))
def test_a_line_that_was_cut_off_is_no_line(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    history = History(tmp_path_factory.mktemp("history") / "h.jsonl")
    for k in range(3):
        history.append(entry(k))
    os.truncate(history.path, history.path.stat().st_size - cut)
    assert [each.version for each in history.entries()] == [0, 1]
    history.append(entry(7))
    assert [each.version for each in history.entries()] == [0, 1, 7]


def test_what_is_no_entry_is_named(tmp_path: Path) -> None:
    history = History(tmp_path / "h.jsonl")
    history.append(entry(1))
    with history.path.open("ab") as file:
        file.write(msgspec.json.encode({"schema": 1, "version": -1}) + b"\n")
    with pytest.raises(RecordingError, match=r"h\.jsonl:2: expected an entry of the history: "):
        history.entries()
    with history.path.open("ab") as file:
        file.write(b"\xff\n")
    with pytest.raises(RecordingError, match=r"h\.jsonl:2"):
        History(history.path).entries()


def test_values_out_of_range_are_no_entry(tmp_path: Path) -> None:
    history = History(tmp_path / "h.jsonl")
    history.append(entry(1))
    broken = history.path.read_text().replace("0.1,", "-0.1,", 1)
    history.path.write_text(broken)
    with pytest.raises(RecordingError, match="kp2"):
        history.entries()


def test_a_folder_is_no_history(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        History(tmp_path).entries()
    with pytest.raises(RecordingError, match="cannot be written"):
        History(tmp_path / "no" / "h.jsonl").append(entry(1))


WRITER = """
import sys
from pathlib import Path
from dtwin.controller.embedded import EmbeddedController
from dtwin.parameters import Gains
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import History
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.settings.change import Change, Proposal
from dtwin.simulation.upload import Uploader

uploader = Uploader(EmbeddedPort(EmbeddedController()), History(Path(sys.argv[1])), Checker().expected_tracking)
for number in range(1, 100000):
    gain = 200.0 + number % 50
    gains = Gains((gain,) * 3, (gain - 100.0,) * 3, (gain / 100.0,) * 3)
    change = Change.of(ControlSettings, {"gains": gains, "target_time": gain / 100.0})
    uploader.upload(Proposal("loop", "again", uploader.version, change), 0.0)
    uploader.trial = None
    print(number, flush=True)
"""


@pytest.mark.parametrize("uploads", [1, 4])
def test_kill_9_in_the_middle_of_uploads_leaves_old_or_new(tmp_path: Path, uploads: int) -> None:
    path = tmp_path / "h.jsonl"
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(uploads):
        assert process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    acknowledged = uploads + len(process.stdout.readlines())
    process.wait()
    process.stdout.close()
    last = History(path).last()
    assert last is not None
    number = last.version - 1
    # The last acknowledged upload, or one that was in force without its acknowledgement having come out.
    assert number in (acknowledged, acknowledged + 1)
    gain = 200.0 + number % 50
    settings = last.settings
    assert settings.gains == Gains((gain,) * 3, (gain - 100.0,) * 3, (gain / 100.0,) * 3)
    assert settings.target_time == gain / 100.0
