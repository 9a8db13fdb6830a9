"""RESTART_DETECTOR, and the application that begins anew when it finds itself with another arm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.faults import parse_fault
from dtwin.run.cell import Cell
from dtwin.run.loop import run
from dtwin.run.settings import CellSettings
from tests.support.driven import Application, Driven, step, triple

JUMP = 0.5
angles = st.lists(st.floats(-4, 4), min_size=3, max_size=3)


@given(angles, st.lists(st.lists(st.floats(-0.8, 0.8), min_size=3, max_size=3), min_size=1, max_size=6))
def test_two_joints_that_jump_mean_another_arm(start: list[float], steps: list[list[float]]) -> None:
    block = Driven("RESTART_DETECTOR")
    assert block.fire("REQ", **triple("THETA", start)) == ["CNF"]
    theta = start
    for moved in steps:
        last, theta = theta, [a + b for a, b in zip(theta, moved, strict=True)]
        jumps = sum(abs(a - b) > JUMP for a, b in zip(theta, last, strict=True))
        expected = ["RESTART", "CNF"] if jumps >= 2 else ["CNF"]
        assert block.fire("REQ", **triple("THETA", theta)) == expected


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


@pytest.fixture(scope="module")
def fresh() -> Cell:
    cell = Cell(CellSettings(duration=8.0, seed=2))
    cell.run()
    return cell


@pytest.mark.parametrize("duration", [1.0, 5.0, 12.3, 15.0, 24.7])
def test_a_second_run_is_as_the_first_of_a_new_application(duration: float, fresh: Cell) -> None:
    controller = EmbeddedController()
    Cell(CellSettings(duration=duration, seed=1), controller).run()
    second = Cell(fresh.settings, controller)
    second.run()
    one, other = fresh.log.freeze(), second.log.freeze()
    for name in ("theta", "target", "volts"):
        np.testing.assert_array_equal(one.stack(name), other.stack(name))
    assert one.events == other.events


def test_a_restart_ends_the_identification_signal(fresh: Cell) -> None:
    controller = EmbeddedController()
    first = Cell(CellSettings(duration=24.0, seed=1), controller)
    first.run()
    controller.resource.port("TWIN.IDENTIFICATION.REQUEST").deliver((True,))
    run(first.emulation, controller, 20)
    assert controller.resource.read("TWIN.OVERRIDE")
    second = Cell(fresh.settings, controller)
    second.run()
    np.testing.assert_array_equal(fresh.log.freeze().stack("volts"), second.log.freeze().stack("volts"))


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 2), (1, 2)])
def test_gains_of_the_twin_stay(one: int, other: int) -> None:
    application = Application()
    gains = [float(k) for k in range(1, 10)]
    application.tick((0.0, 0.0, 0.0))
    application.send("TWIN.SIMULATION.GAIN_PORT", *gains, 3.0)
    theta = [0.0, 0.0, 0.0]
    theta[one] = theta[other] = 1.0
    application.tick(theta)
    assert application.resource.read("SEQUENCE.SYSTEM_TIME") == 0.0
    assert [application.resource.read(f"CONTROLLER.K{k}{j}") for k in "PID" for j in (1, 2, 3)] == gains
    assert application.resource.read("PLANNER.DURATION") == 3.0


def test_a_frozen_encoder_does_not_restart_the_sequence() -> None:
    settings = CellSettings(duration=30.0, seed=1, faults=(parse_fault("freeze2@0.5-1.5"),))
    application = EmbeddedController()
    Cell(settings, application).run()
    assert application.resource.read("SEQUENCE.SYSTEM_TIME") == pytest.approx(settings.duration - 0.01)
