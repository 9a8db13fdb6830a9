"""The twin inside the running application: what its ports send and take, and how it borrows the arm."""

from typing import Any

import numpy as np
import pytest

from dtwin.parameters import ArmParameters, Gains
from tests.support.driven import THESIS, Application, Array, step, triple

REQUEST = "TWIN.IDENTIFICATION.REQUEST"
RESPONSE = "TWIN.IDENTIFICATION.BLOCK.DATA"
MONITORING = "TWIN.MONITORING.DATA"
GAIN_PORT = "TWIN.SIMULATION.GAIN_PORT"
MODEL_PORT = "TWIN.SIMULATION.MODEL_PORT"


class ControlledArm:
    """The application controls the true arm, which starts at rest and gets no boxes."""

    def __init__(self, application: Application) -> None:
        self.application = application
        self.state: Array = np.zeros(6)
        self.volts: list[tuple[float, ...]] = []
        self.angles: list[Array] = []

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.angles.append(self.state[:3])
            answer = self.application.tick(self.state[:3].tolist())
            self.volts.append(answer[:4])
            self.state = step(self.state, answer[:3])


def override(application: Application) -> bool:
    return bool(application.resource.read("SELECTOR.OVERRIDE"))


def test_request_overrides_the_next_sample_for_the_length_of_the_signal() -> None:
    application = Application()
    response, monitoring = application.received(RESPONSE), application.received(MONITORING)
    run = ControlledArm(application)
    run.ticks(250)
    assert not override(application)
    assert len(monitoring) == 25
    application.send(REQUEST, True)
    run.ticks(1)
    assert override(application)
    assert run.volts[-1] == (6.0, 4.0, 3.0, 3.0)
    run.ticks(349)
    assert override(application)
    assert run.volts[-1][:3] == (-6.0, -4.0, -3.0)
    assert len(monitoring) == 25
    run.ticks(1)
    assert not override(application)
    # what was sent: angles and voltages of the same sample
    assert len(response) == 350
    np.testing.assert_array_equal([sent[:3] for sent in response], run.angles[250:600])
    np.testing.assert_array_equal([sent[3:] for sent in response], run.volts[250:600])


@pytest.mark.parametrize("start", [5, 130, 300, 431])
def test_the_arm_is_handed_back_without_a_jump(start: int) -> None:
    application = Application(THESIS)
    run = ControlledArm(application)
    run.ticks(start)
    application.send(REQUEST, True)
    run.ticks(351)
    assert not override(application)
    assert application.resource.read("PLANNER.$ECC") == "HELD"
    back = len(run.volts) - 1
    assert np.linalg.norm(run.state[3:]) > 1.0  # rad/s: the arm swings
    path = np.array([application.resource.read(f"PLANNER.THETA_D{j}") for j in (1, 2, 3)])
    np.testing.assert_array_equal(path, run.angles[back])
    for joint in (1, 2, 3):
        assert abs(application.resource.read(f"CONTROLLER.SUM{joint}")) < 1e-12
    run.ticks(400)
    volts = np.array(run.volts[back:])[:, :3]
    assert np.abs(np.diff(volts, axis=0)).max() < 0.5
    assert np.abs(volts).max() < 8
    target = [application.resource.read(f"PLANNER.THETA_T{j}") for j in (1, 2, 3)]
    np.testing.assert_allclose(run.state[:3], target, atol=2e-3)


def test_signal_goes_on_without_anybody_at_the_ports() -> None:
    run = ControlledArm(Application())
    run.ticks(10)
    run.application.send(REQUEST, True)
    run.ticks(400)
    volts = np.array(run.volts)
    assert set(volts[10:360, 0]) == {-6.0, 6.0}


def test_request_can_be_taken_back() -> None:
    application = Application()
    run = ControlledArm(application)
    run.ticks(5)
    application.send(REQUEST, True)
    run.ticks(20)
    application.send(REQUEST, False)
    run.ticks(1)
    assert not override(application)


def test_monitoring_sends_angles_targets_gripper_and_time() -> None:
    application = Application({"TWIN.COUNT_LIMIT": 1})
    monitoring = application.received(MONITORING)
    for tick in range(3):
        application.tick((0.1, 0.2, 0.3))
        assert monitoring[-1] == (0.1, 0.2, 0.3, -0.6699, -1.5931, 2.2630, False, pytest.approx(0.01 * tick))


def test_gains_and_target_time_reach_controller_and_planner() -> None:
    application = Application()
    acknowledged = application.received(GAIN_PORT)
    application.tick((0.0, 0.0, 0.0))
    gains = Gains((20.0, 30.0, 40.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    application.send(GAIN_PORT, *gains.kp, *gains.ki, *gains.kd, 3.5)
    assert acknowledged == [()]
    expected: dict[str, Any] = {**triple("KP", gains.kp), **triple("KI", gains.ki), **triple("KD", gains.kd)}
    assert {name: application.resource.read(f"CONTROLLER.{name}") for name in expected} == expected
    assert application.resource.read("PLANNER.T") == 3.5
    assert application.resource.read("PLANNER.DURATION") == 2.0  # of the path that runs


def test_model_reaches_the_controller() -> None:
    application = Application()
    application.tick((0.0, 0.0, 0.0))
    vector = [1.1 * value for value in (*ArmParameters().vector()[:18], 0.01, 0.02, 0.03)]
    application.send(MODEL_PORT, *vector)
    names = [f"{symbol}{joint}" for symbol in (*"KMILCD", "MU") for joint in (1, 2, 3)]
    assert [application.resource.read(f"CONTROLLER.{name}") for name in names] == vector
    weight = 9.81 * vector[5] * vector[14]
    assert application.resource.read("CONTROLLER.W3") == pytest.approx(weight, rel=1e-14)


def test_gains_and_model_of_the_start_count_until_the_twin_sends_others() -> None:
    application = Application({"CONTROLLER.KP1": 123.0, "PLANNER.T": 1.25, "CONTROLLER.K1": 0.5})
    for _ in range(3):
        application.tick((0.0, 0.0, 0.0))
    assert application.resource.read("CONTROLLER.KP1") == 123.0
    assert application.resource.read("CONTROLLER.K1") == 0.5
    assert application.resource.read("PLANNER.DURATION") == 1.25
