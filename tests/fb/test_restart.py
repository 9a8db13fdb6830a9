"""RESTART_DETECTOR, and the application that begins anew when it finds itself with another arm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import CONFIRMED, ControlSettings
from dtwin.emulation.faults import parse_fault
from dtwin.parameters import Law
from dtwin.run.cell import Cell
from dtwin.run.loop import run
from dtwin.run.settings import CellSettings
from dtwin.signals import StepRecord
from tests.support.driven import Application, Driven, step, triple

JUMP = 0.5
angles = st.lists(st.floats(-4, 4), min_size=3, max_size=3)


def detector() -> Driven:
    block = Driven("RESTART_DETECTOR")
    block.resource.write("DUT.CONFIRM", CONFIRMED)
    return block


@given(angles, st.lists(st.lists(st.floats(-0.8, 0.8), min_size=3, max_size=3), min_size=1, max_size=12))
def test_two_joints_that_have_jumped_and_stay_there_mean_another_arm(
    start: list[float], steps: list[list[float]]
) -> None:
    block = detector()
    assert block.fire("REQ", **triple("THETA", start)) == ["CNF"]
    known, before, still, exchanged = start, start, 0, False
    for moved in steps:
        theta = [a + b for a, b in zip(known, moved, strict=True)]
        far = [abs(a - b) > JUMP for a, b in zip(theta, known, strict=True)]
        jumped = sum(far) >= 2
        exchanged = jumped and (exchanged or reads_others(theta, known, far))
        near = all(abs(a - b) <= 0.2 for a, b in zip(theta, before, strict=True))
        still = still + 1 if jumped and near and not exchanged else still if exchanged else 0
        other = still == CONFIRMED and not exchanged
        assert block.fire("REQ", **triple("THETA", theta)) == (["RESTART", "CNF"] if other else ["CNF"])
        assert block["SUSPECT"] == (jumped and not other and not exchanged)
        if other:
            known, still = theta, 0
        elif not jumped:  # a single wild reading is nowhere that the arm was seen
            known = [a if abs(a - b) <= 0.2 else c for a, b, c in zip(theta, before, known, strict=True)]
        before = theta


def reads_others(theta: list[float], known: list[float], far: list[bool]) -> bool:
    """Whether every joint that has jumped reads within 0.1 rad what another joint did."""
    return all(
        any(abs(theta[i] - known[k]) <= 0.1 for k in range(3) if k != i) for i, jumped in enumerate(far) if jumped
    )


@pytest.mark.parametrize("order", [(1, 0, 2), (0, 2, 1), (2, 1, 0), (1, 2, 0), (2, 0, 1)])
def test_encoders_that_change_places_are_no_other_arm(order: tuple[int, int, int]) -> None:
    block = detector()
    theta = [-0.7, -1.9, 2.3]
    block.fire("REQ", **triple("THETA", theta))
    for k in range(50):
        swapped = [theta[i] + 0.01 * k for i in order]
        assert block.fire("REQ", **triple("THETA", swapped)) == ["CNF"]
        assert not block["SUSPECT"]
    assert block.fire("REQ", **triple("THETA", theta)) == ["CNF"]
    answers = [block.fire("REQ", **triple("THETA", [1.0, 1.0, 0.0])) for _ in range(3)]
    assert answers == [["CNF"], ["CNF"], ["RESTART", "CNF"]]


def test_another_arm_is_told_from_a_burst_with_its_third_sample() -> None:
    block = detector()
    block.fire("REQ", **triple("THETA", [0.0, 0.0, 0.0]))
    generator = np.random.default_rng(0)
    for _ in range(50):
        assert block.fire("REQ", **triple("THETA", generator.uniform(-3, 3, 3))) == ["CNF"]
    for _ in range(3):
        assert block.fire("REQ", **triple("THETA", [0.42, 0.0, 2.9])) == ["CNF"]
        for _ in range(5):
            assert block.fire("REQ", **triple("THETA", [0.01, 0.0, 0.0])) == ["CNF"]
    answers = [block.fire("REQ", **triple("THETA", [1.0, 1.0, 0.001 * k])) for k in range(4)]
    assert answers == [["CNF"], ["CNF"], ["RESTART", "CNF"], ["CNF"]]


def test_no_voltages_move_two_joints_that_fast() -> None:
    generator = np.random.default_rng(0)
    fastest = 0.0
    for _ in range(20):
        state = np.array([-math.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0])
        for _ in range(60):
            volts = generator.choice([-8.0, 8.0], 3)
            for _ in range(5):
                before, state = state, step(state, volts.tolist())
                fastest = max(fastest, sorted(np.abs(state - before)[:3])[1])
    assert fastest < JUMP


@pytest.fixture(scope="module", params=["computed_torque", "cascade"])
def law(request: pytest.FixtureRequest) -> Law:
    found: Law = request.param
    return found


@pytest.mark.parametrize("duration", [1.0, 5.0, 12.3, 15.0, 24.7])
def test_a_second_run_is_as_the_first_of_a_new_application(duration: float, law: Law) -> None:
    control = ControlSettings(law=law)
    controller = EmbeddedController(control)
    Cell(CellSettings(duration=duration, seed=1, control=control), controller).run()
    assert_begins_anew(controller, control)


def assert_begins_anew(controller: EmbeddedController, control: ControlSettings) -> None:
    """Under the cascade once the application knows that the arm is another one, which takes two samples more."""
    settings = CellSettings(duration=8.0, seed=2, control=control)
    records: list[StepRecord] = []
    run(Cell(settings, controller).emulation, controller, 800, record=records.append)
    alone = EmbeddedController(control)
    for record in records[CONFIRMED if control.law == "cascade" else 0 :]:
        assert alone.step(record.sensors) == record.voltages
    assert controller.resource.read("SEQUENCE.SYSTEM_TIME") == alone.resource.read("SEQUENCE.SYSTEM_TIME")


def test_a_restart_ends_the_identification_signal() -> None:
    control = ControlSettings()
    controller = EmbeddedController(control)
    first = Cell(CellSettings(duration=24.0, seed=1, control=control), controller)
    first.run()
    controller.resource.port("TWIN.IDENTIFICATION.REQUEST").deliver((True,))
    run(first.emulation, controller, 20)
    assert controller.resource.read("TWIN.OVERRIDE")
    assert_begins_anew(controller, control)


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 2), (1, 2)])
def test_gains_of_the_twin_stay(one: int, other: int) -> None:
    application = Application()
    gains = [float(k) for k in range(1, 10)]
    application.tick((0.0, 0.0, 0.0))
    application.send("TWIN.SIMULATION.GAIN_PORT", *gains, 3.0)
    theta = [0.0, 0.0, 0.0]
    theta[one] = theta[other] = 1.0
    for _ in range(1 + CONFIRMED):
        application.tick(theta)
    assert application.resource.read("SEQUENCE.SYSTEM_TIME") == 0.0
    assert [application.resource.read(f"CONTROLLER.K{k}{j}") for k in "PID" for j in (1, 2, 3)] == gains
    assert application.resource.read("PLANNER.DURATION") == 3.0


def test_a_frozen_encoder_does_not_restart_the_sequence() -> None:
    settings = CellSettings(duration=30.0, seed=1, faults=(parse_fault("freeze2@0.5-1.5"),))
    application = EmbeddedController()
    Cell(settings, application).run()
    assert application.resource.read("SEQUENCE.SYSTEM_TIME") == pytest.approx(settings.duration - 0.01)
