"""The scorecard of the watched machines: what counts."""

import msgspec
import pytest

from dtwin.cli import main
from dtwin.experiments.monitoring.alarms import FAULTS, Outcome, WatchedMachine, alarms_report, good

RIGHT = [Outcome(fault, [], 1.0, names[0], 0.999) for fault, names in FAULTS.items()]
FINE = WatchedMachine(7, "identified", 0.2, [], RIGHT)


def changed(**values: object) -> WatchedMachine:
    """A machine whose first outcome differs."""
    return msgspec.structs.replace(FINE, outcomes=[msgspec.structs.replace(RIGHT[0], **values), *RIGHT[1:]])


def test_what_counts_against_the_monitor() -> None:
    assert good([FINE])
    assert not good([])
    for one in (
        msgspec.structs.replace(FINE, alarms=["voltage constant of joint 1"]),
        changed(after=2.5),
        changed(after=None, named=""),
        changed(named="K1", confidence=0.96),
    ):
        assert not good([one])
    assert good([changed(named="K1", confidence=0.9)])


def test_the_report_counts_every_fault_and_false_alarm() -> None:
    text = str(alarms_report([FINE, changed(after=None, named="K1")], 600.0))
    assert "0 false alarms in 0.40 h" in text
    assert "1 of 2" in text
    assert all(f"`{fault}`" in text for fault in FAULTS)


def test_machines_that_the_method_was_tuned_on_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(("experiment", "alarms", "--first", "500")) == 2
    assert "expected machines that nobody tuned to, got 501" in capsys.readouterr().err
