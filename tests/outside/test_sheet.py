"""An arm that nobody has commissioned, with effects of other sizes than the table's: one message and grave faults."""

from dataclasses import replace

import pytest

import dtwin
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.readiness.sheet import WORDS, SheetTrial
from dtwin.signals import EventKind
from tests.outside import drives, readings, watched
from tests.outside.effect import Effect, later, nothing, together
from tests.outside.watched import Work, data_sheet, followed, work

JITTER = readings.jitter(0.0005)
EFFECTS: dict[str, Effect] = {"jitter": JITTER, "a bench that shakes": drives.rough_floor(0.004)}
GRAVE: dict[str, tuple[Effect, str]] = {
    "a stopped encoder": (readings.freeze(every=1e6, length=1e6, start=30.0, joints=(2,)), "freeze2"),
    "a dead amplifier": (later(drives.stuck_volts(0.0, joints=(3,)), 25.0), "cut3"),
}
"""What befalls an arm whose readings come at uneven times, and what it is called."""


def _watched(
    effect: Effect, seconds: float, monkeypatch: pytest.MonkeyPatch, seed: int = 31, acknowledged: bool = True
) -> Monitor:
    monkeypatch.setitem(watched.KINDS, "tried", effect)
    return followed(data_sheet(), work(Work("tried", seed, seed), seconds).log, acknowledged)


def _told(monitor: Monitor) -> list[str]:
    return [event.text for event in monitor.events if event.kind in (EventKind.MISFIT, EventKind.FAILED, "push")]


@pytest.mark.parametrize("name", ["jitter", pytest.param("a bench that shakes", marks=pytest.mark.thorough)])
def test_an_effect_is_told_once_and_names_what_helps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monitor = _watched(EFFECTS[name], 30.0, monkeypatch)
    assert _told(monitor) == [WORDS]
    assert "dtwin commission" in WORDS
    assert {unit.state for unit in monitor.verdict().units.values()} == {"not commissioned"}


@pytest.mark.parametrize("name", GRAVE)
def test_what_is_grave_is_found_all_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    effect, called = GRAVE[name]
    monitor = _watched(together(JITTER, effect), 32.0, monkeypatch)
    assert _told(monitor)[0] == WORDS
    assert [found.parameter for found in monitor.history] == [called]


def test_an_arm_that_is_its_data_sheets_is_nominal(monkeypatch: pytest.MonkeyPatch) -> None:
    monitor = _watched(nothing, 60.0, monkeypatch)
    assert _told(monitor) == []
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_a_stopped_encoder_is_told_of_an_arm_that_is_far_from_its_data_sheet(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise changes every reading of an encoder that works, whatever the model says."""
    effect = together(readings.jitter(0.001), readings.freeze(every=1e6, length=1e6, start=15.0, joints=(2,)))
    monitor = _watched(effect, 16.0, monkeypatch, 5, False)
    assert "joint 1 is up to" in _told(monitor)[0]
    assert [found.parameter for found in monitor.history] == ["freeze2"]
    states = {name: unit.state for name, unit in monitor.verdict().units.items()}
    assert states.pop("joint 2") == "failed"
    assert set(states.values()) == {"not commissioned"}


def test_a_data_sheet_that_did_not_fit_stays_so() -> None:
    trial = SheetTrial(data_sheet())
    assert trial.stays()
    assert trial.failed
    assert not SheetTrial(replace(data_sheet(), sheet=False)).stays()


def test_heavier_boxes_are_told_one_by_one_and_speak_for_no_other_arm() -> None:
    """Each of them weighs something else, and only the first has to show it as clearly as a data sheet asks."""
    run = dtwin.Cell(seed=46, noise=0.003, fault="payload+=0.03@70").run(seconds=140)
    events = dtwin.monitor(run).events
    assert not [event for event in events if event.kind in ("monitor_misfit", "monitor_dismissed")]
    failed = [event.text for event in events if event.kind == "monitor_failed"]
    assert len(failed) == 3
    assert all(text.startswith("payload differs") for text in failed)
