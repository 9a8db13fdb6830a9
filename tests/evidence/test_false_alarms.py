"""Days of healthy work on the twin: its plant, and how alarms are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dtwin.logs.log import Log
from dtwin.parameters import HANGING, PERIOD
from dtwin.run.options import ControlOptions
from dtwin.signals import ARM_STATES
from dtwin.twin.machine import MACHINE_NAMES, SUBSTEP, integrate_machine
from evidence.monitoring.false_alarms import Shift, WatchedShift, false_alarms_report, interval, watch_shift
from evidence.monitoring.twin_cell import TwinCell
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.records import recorded

pytestmark = needs_compiler


def cell(seed: int = 1) -> TwinCell:
    return TwinCell(901, seed, ControlOptions().control())


def same(first: Log, second: Log) -> bool:
    """Whether logs are equal to the bit."""
    return all(first.columns[name].tobytes() == second.columns[name].tobytes() for name in first.columns)


def test_work_does_not_depend_on_how_it_is_divided() -> None:
    whole, divided = cell(), cell()
    log = whole.run(60.0)
    parts = [divided.run(seconds) for seconds in (0.01, 17.3, 42.69)]
    for name, column in log.columns.items():
        assert np.concatenate([part.columns[name] for part in parts]).tobytes() == column.tobytes(), name
    assert whole.box_counts == divided.box_counts
    assert whole.box_counts.delivered > 0
    assert same(log, cell().run(60.0))
    assert not same(log, cell(2).run(60.0))


def test_the_arm_obeys_the_equations_of_the_twin_with_effects() -> None:
    found = cell()
    found._readings.deviation, found._readings.loss, found._device.resolution[:] = 0.0, 0.0, 0.0
    p, late = found._device.p, len(found._state.commands)
    log = found.run(2.0)
    assert not log.columns["box_gripped"].any()
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    eccentric = MACHINE_NAMES.index("eccentric_sin1")
    sine, cosine = p[eccentric : eccentric + 3], p[eccentric + 3 : eccentric + 6]
    state, acting, commands = np.array([*HANGING, 0.0, 0.0, 0.0]), np.full(3, np.nan), np.zeros((late, 3))
    for row in range(len(log)):
        assert measured[row] == pytest.approx(
            state[:3] + sine * np.sin(state[:3]) + cosine * np.cos(state[:3]), abs=1e-15
        )
        commands = np.vstack((commands[1:], volts[row]))
        states = np.vstack((state, state))
        integrate_machine(p, commands, np.zeros(late), PERIOD, SUBSTEP, late - 1, acting, states)
        state = states[1]
    assert np.abs(measured[-1] - HANGING).max() > 0.1


def test_amplifiers_encoders_and_losses_have_their_resolution_and_rate() -> None:
    found = cell()
    found._readings.loss = 0.3
    log = found.run(60.0)
    steps = log.stack("measured") / found._device.resolution[1]
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    again = (np.diff(log.stack("measured"), axis=0) == 0.0).all(axis=1) & (np.abs(log.stack("volts")[1:, 0]) > 0.0)
    assert 0.25 < again.mean() < 0.6


def test_alarms_are_counted_and_acknowledged() -> None:
    shift = Shift(recorded(), 901, 3, 20.0)
    watched = watch_shift(shift)
    assert watched.hours == pytest.approx(20.0 / 3600.0)
    # the arm of the record is another one
    assert watched.alarms
    assert watch_shift(shift) == watched


def test_a_stopped_arm_is_let_go_on() -> None:
    found, stopped = cell(), []
    for step in (
        lambda: None,
        lambda: found._blocks.verdicts.exchange((ARM_STATES.index("failed"), 1.0, False)),
        found.release,
    ):
        step()
        found.run(60.0)
        stopped.append((found.stopped, found.box_counts.delivered))
    assert [stop for stop, _ in stopped] == [False, True, False]
    assert stopped[1][1] < stopped[2][1]


@pytest.mark.parametrize("alarms", [0, 1, 7])
def test_the_interval_leaves_two_and_a_half_percent_on_either_side(alarms: int) -> None:
    from scipy.stats import poisson  # takes long to load

    low, high = interval(alarms, 2.0)
    assert poisson.cdf(alarms, 2.0 * high) == pytest.approx(0.025)
    if alarms:
        assert poisson.sf(alarms - 1, 2.0 * low) == pytest.approx(0.025)
    else:
        assert low == 0.0


def test_the_report_tells_the_rate() -> None:
    shifts = [WatchedShift(901, 12.0, 40, ["1.00 s: joint 2"]), WatchedShift(902, 12.0, 41, [])]
    text = false_alarms_report(shifts, 3).text
    assert "2 of 3 drawn machines" in text
    assert "1 false alarms, 1 a day" in text
    assert "joint 2" in text
    assert not math.isnan(interval(1, 1.0)[1])
