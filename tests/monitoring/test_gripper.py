"""The gripper watched by its own encoder."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.sections import Contact, Machine
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.parameters import PERIOD, ArmParameters, GripperParameters
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings
from dtwin.signals import EventKind

GRIPPER = GripperParameters()
BOX = 0.4955
"""Angle at which a box stops the jaw, rad."""


def driven(volts: list[float], strength: float = 1.0, stop: float = GRIPPER.closed) -> list[float]:
    """Readings of a jaw that starts open at rest and has a share of its motor's torque, by its equation of motion."""
    angle, speed, seen = GRIPPER.opened, 0.0, []
    for u in volts:
        seen.append(angle)
        for _ in range(10):
            torque = strength * GRIPPER.voltage_constant * u - GRIPPER.damping * speed
            speed += 0.1 * PERIOD * torque / GRIPPER.inertia
            angle += 0.1 * PERIOD * speed
            if not stop <= angle <= GRIPPER.opened:
                angle, speed = min(max(angle, stop), GRIPPER.opened), 0.0
    return seen


def judged(volts: list[float], angles: list[float]) -> list[tuple[int, bool]]:
    """Samples at which the opinion changes, and what it is then."""
    watch = GripperWatch()
    return [
        (k, watch.fails) for k, (u, angle) in enumerate(zip(volts, angles, strict=True)) if watch.update(k, angle, u)
    ]


@pytest.mark.parametrize(
    ("moves", "waits"),
    [
        ([0.01, 0.012, 0.01, 0.0, -0.01, -0.03], [True, True, True, False, False, False]),
        ([0.01, 0.02, 0.03, 0.06], [True, True, True, False]),
        ([0.01] * 70, [True] * 60 + [False] * 10),
        ([-0.01, -0.03], [False, False]),
        ([0.004, -0.004], [False, False]),
    ],
)
def test_a_jaw_that_is_pushed_open_has_yet_to_show_whether_its_motor_closes_it(
    moves: list[float], waits: list[bool]
) -> None:
    """A box that slips out pushes the jaw as far as one that a dead motor does not hold, but not for long."""
    watch = GripperWatch()
    volts = [3.0] * 100 + [-3.0] * 200
    for k, (u, angle) in enumerate(zip(volts, driven(volts, stop=BOX), strict=True)):
        watch.update(k, angle, u)
    assert not watch.undecided
    seen = []
    for k, move in enumerate(moves, len(volts)):
        watch.update(k, BOX + move, -3.0)
        seen.append(watch.undecided)
    assert (seen, watch.fails) == (waits, max(moves) > 0.05)


CYCLE = [3.0] * 100 + [-3.0] * 200 + [3.0] * 150 + [-3.0] * 200 + [3.0] * 150


@pytest.mark.parametrize("stop", [GRIPPER.closed, BOX])
@pytest.mark.parametrize("strength", [0.6, 1.0, 1.4])
def test_a_jaw_that_goes_where_it_is_driven_does_not_fail(strength: float, stop: float) -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.003, len(CYCLE))
    assert judged(CYCLE, (np.array(driven(CYCLE, strength, stop)) + noise).tolist()) == []


REVERSED = [*CYCLE, *[-3.0] * 200]


@pytest.mark.parametrize("turns", range(5, 40, 5))
@pytest.mark.parametrize("begins", [450, 650, 800])
@pytest.mark.parametrize("strength", [0.6, 1.0, 1.4])
def test_a_jaw_that_is_driven_back_in_mid_course_is_braked_first(turns: int, begins: int, strength: float) -> None:
    """An arm that is stopped, or leaves its place, while its gripper opens has it closed again."""
    volts = [*REVERSED[: begins + turns], *[-u for u in REVERSED[begins : begins + 100]]]
    noise = np.random.default_rng(begins + turns).normal(0.0, 0.001, len(volts))
    assert judged(volts, (np.array(driven(volts, strength)) + noise).tolist()) == []


def test_a_jaw_that_is_not_braked_fails() -> None:
    """Its motor has died in mid-course: it goes on to its stop."""
    volts = [*CYCLE[:675], *[-3.0] * 100]
    angles = driven([*CYCLE[:675], *[0.0] * 100])
    (at, fails), *_ = judged(volts, angles)
    assert fails
    assert 675 < at < 675 + 70


@pytest.mark.parametrize("start", [100, 300, 450, 650])
def test_a_jaw_that_stays_fails_within_half_a_second_of_its_command(start: int) -> None:
    angles = driven(CYCLE)
    angles[start:] = [angles[start]] * len(angles[start:])
    found = judged(CYCLE, angles)
    if start == 100:  # it has never been seen to move
        assert found == []
    else:
        (at, fails), *_ = found
        assert fails
        assert 0.2 < PERIOD * (at - start) < 0.7


def test_a_jaw_that_gives_way_fails_and_one_that_goes_again_recovers() -> None:
    angles = driven(CYCLE)
    angles[250:300] = np.linspace(angles[250], angles[250] + 0.2, 50).tolist()
    angles[300:] = np.interp(range(len(angles[300:])), [0, 60], [angles[299], GRIPPER.opened]).tolist()
    (gave, fails), (went, again) = judged(CYCLE[:450], angles[:450])
    assert (fails, again) == (True, False)
    assert 250 < gave < 270
    assert 300 < went < 350


@pytest.mark.parametrize(("missing", "fails"), [(5, True), (30, False)])
def test_a_jaw_may_have_been_driven_elsewhere_while_nobody_saw_it(missing: int, fails: bool) -> None:
    watch, opened = GripperWatch(), 0.1
    for k, (u, angle) in enumerate(zip(CYCLE[:300], driven(CYCLE[:300], stop=BOX), strict=True)):
        watch.update(k, angle, u)
    watch.update(300 + missing, BOX + opened, -3.0)
    assert watch.fails == fails


def test_a_gripper_without_an_encoder_is_not_judged() -> None:
    assert judged(CYCLE, [0.0] * len(CYCLE)) == []
    assert judged(CYCLE, [math.nan] * len(CYCLE)) == []


@given(st.data())
def test_many_samples_at_once_are_judged_as_one_after_the_other(data: st.DataObject) -> None:
    parts = data.draw(st.lists(st.tuples(st.sampled_from([3.0, -3.0, 0.0]), st.integers(1, 80)), max_size=8))
    volts = [3.0] * 5 + [-3.0] * 90 + [u for u, count in parts for _ in range(count)]
    angles = np.array(driven(volts))
    stuck = data.draw(st.integers(95, len(volts)))
    angles[stuck:] = angles[stuck - 1] + data.draw(st.floats(-0.1, 0.1))
    samples, values = np.arange(len(volts)), np.array(volts)
    one, many, row = GripperWatch(), GripperWatch(), 0
    while row < len(volts):
        rows = slice(row, row + data.draw(st.integers(1, 60)))
        calm = many.calm(samples[rows], angles[rows], values[rows])
        news = [one.update(k, float(angles[k]), volts[k]) for k in range(row, row + calm)]
        passed = slice(row, row + calm)
        many.pass_over(samples[passed], angles[passed], values[passed])
        assert not any(news)
        row += calm
        if row < min(rows.stop, len(volts)):
            assert one.update(row, float(angles[row]), volts[row])
            assert many.update(row, float(angles[row]), volts[row])
            row += 1
        assert (one.fails, one.since, one.stirred) == (many.fails, many.since, many.stirred)


def watched(log: Log) -> Monitor:
    monitor, seen = Monitor(assumed(ArmParameters(), (1e-3,) * 3)), stream(log)
    seen.feed(monitor, 0, len(seen))
    return monitor


def test_a_gripper_without_voltage_is_named_and_the_joints_are_well(run_cell: Callable[..., Log]) -> None:
    """Without contact the jaw stays where it is, so that the next command shows it."""
    monitor = watched(run_cell(35.0, 3, "cutgripper@18", noise=0.001))
    units = monitor.verdict().units
    assert units["gripper"].state == "failed"
    assert units["gripper"].text.startswith("gripper does not follow")
    assert {units[f"joint {j}"].state for j in (1, 2, 3)} == {"nominal"}
    (finding,) = monitor.history
    assert 0.3 < finding.detected - finding.since < 0.7
    assert monitor.acknowledge("grip") == ["grip"]
    assert monitor.verdict().units["gripper"].state == "nominal"


def test_a_gripper_that_loses_its_voltage_with_a_box_is_told_before_the_box_is_lost() -> None:
    """With contact the box pushes the jaw open."""
    machine, control = Machine(contact=Contact(enabled=True)), ControlOptions().control()
    cell = Cell(CellSettings(20.0, 3, machine=machine, control=control, faults=(parse_fault("cutgripper@10.5"),)))
    cell.run()
    log = cell.log.freeze()
    assert log.columns["box_gripped"][1049]
    slipped = next(event.time for event in log.events if event.kind == EventKind.SLIPPED)
    first = watched(log).history[0]
    assert first.parameter == "grip"
    assert 10.5 < first.detected < min(slipped, 11.0)


def test_a_box_that_moves_between_the_pads_is_noticed_once_for_each_grip() -> None:
    watch, angles = GripperWatch(), driven(CYCLE, stop=BOX)
    angles[250:] = [angle + 0.01 if 250 <= k < 280 else angle for k, angle in enumerate(angles[250:], 250)]
    stirred = []
    for k, (u, angle) in enumerate(zip(CYCLE, angles, strict=True)):
        watch.update(k, angle + (0.002 if k % 2 else 0.0), u)
        stirred.append(watch.stirred)
    assert set(stirred) == {-1, 250}
    assert stirred.index(250) == 250


def test_a_mass_that_changes_while_the_box_moves_between_the_pads_is_a_slip(run_cell: Callable[..., Log]) -> None:
    """The readings of the arm alone tell of a box that weighs less."""
    log = run_cell(35.0, 3, "payload+=-0.1@30", noise=0.001)
    held = log.columns["gripper"].copy()
    rests = np.arange(len(log)) * PERIOD
    held[(rests > 30.03) & log.columns["box_gripped"]] += 0.01
    moved = replace(log, columns={**log.columns, "gripper": held})
    assert [watched(each).history[0].parameter for each in (log, moved)] == ["payload", "slip"]
