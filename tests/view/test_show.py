"""A recording is opened at the moment that is worth a look."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.errors import RecordingError
from dtwin.signals import Event
from dtwin.view.shown.show import opening
from dtwin.view.write import write_recording
from tests.view.test_write import MODEL, run_to

FAULT, FINDING, STOP = (
    Event(1.0, "fault", "K2*=0.1@1 began"),
    Event(1.5, "monitor_failed", "voltage constant of joint 2"),
    Event(1.7, "stop", "safe stop: braking"),
)


@pytest.mark.parametrize(
    ("events", "moment"),
    [((), None), ((FAULT,), 1.0), ((FAULT, FINDING, STOP), 1.5), ((STOP,), 1.7)],
)
def test_it_opens_at_the_first_finding_or_else_fault_or_stop(
    events: Sequence[Event], moment: float | None, tmp_path: Path
) -> None:
    write_recording(replace(run_to("red"), events=tuple(events)), MODEL, tmp_path / "run.rrd")
    assert opening(tmp_path / "run.rrd") == moment


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.rrd: cannot be read: No such file"):
        opening(tmp_path / "none.rrd")
    (tmp_path / "text.rrd").write_text("no recording")
    with pytest.raises(RecordingError, match=r"text\.rrd: expected a recording of Rerun"):
        opening(tmp_path / "text.rrd")
