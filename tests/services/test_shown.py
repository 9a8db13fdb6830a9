"""What `dtwin up` shows: lines where nobody looks at a terminal, a table there, the verdict and the last event."""

import subprocess
import sys
from contextlib import redirect_stderr
from io import StringIO

import pytest
from rich.console import Console

from dtwin.bus.messages import ServiceSummary, Summary
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict
from dtwin.commands.live.status import table
from dtwin.commands.live.up import Lines
from dtwin.parameters import ROOT
from dtwin.services.supervisor import in_words
from dtwin.signals import Event

RUNNING = ServiceSummary("running", 100.0, 0, "")
FAILED = ServiceSummary("dead", 0.0, 1, "killed by SIGKILL")
ARRIVED = Event(1.25, "arrived", "a red box arrived")


def lines(*summaries: Summary) -> list[str]:
    shown, out = Lines(), StringIO()
    with redirect_stderr(out):
        for summary in summaries:
            shown.show(summary)
    return out.getvalue().splitlines()


def test_lines_tell_what_has_changed_and_nothing_else() -> None:
    first = Summary({"emulator": RUNNING, "bridge": RUNNING})
    later = Summary({"emulator": FAILED, "bridge": RUNNING}, ticks=7, verdict="nominal", last_event=ARRIVED)
    assert lines(first, first, later, later) == [
        "emulator: running",
        "bridge: running",
        "emulator: dead (killed by SIGKILL)",
        "verdict: nominal",
        "last event: 1.25 s a red box arrived",
    ]


def test_the_table_has_the_verdict_and_the_last_event() -> None:
    out = StringIO()
    summary = Summary({"emulator": RUNNING}, verdict="joint_2 failed, K2 -90 %", last_event=ARRIVED)
    Console(file=out, width=80).print(table(summary))
    assert "verdict: joint_2 failed, K2 -90 %" in out.getvalue()
    assert "last event: 1.25 s a red box arrived" in out.getvalue()


def test_a_verdict_in_words_names_what_is_wrong() -> None:
    fine = {"joint_1": MonitoredUnit("nominal"), "joint_2": MonitoredUnit("nominal")}
    assert in_words(MonitoringVerdict(1.0, fine, (), (), 0, 0)) == "nominal"
    wrong = {
        **fine,
        "joint_2": MonitoredUnit("failed", text="K2 -90 %"),
        "gripper": MonitoredUnit("may be degrading"),
    }
    assert in_words(MonitoringVerdict(1.0, wrong, (), (), 0, 0)) == (
        "joint_2 failed, K2 -90 %; gripper may be degrading"
    )


@pytest.mark.usefixtures("desk")
def test_up_prints_lines_as_states_change_where_there_is_no_terminal() -> None:
    # The event happens long before the end, so that it is heard however busy the machine is.
    command = [sys.executable, "-m", "dtwin", "up", "--pace", "lockstep", "--duration", "20", "--fault", "D1*=1.5@2"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=180)
    assert done.returncode == 0, done.stderr
    said = done.stderr.splitlines()
    assert not any(mark in done.stderr for mark in "┃│━")
    assert [line for line in said if line.startswith("emulator: ")][-1] == "emulator: ended"
    assert {line.partition(":")[0] for line in said} >= {"controller", "bridge", "emulator", "last event"}
