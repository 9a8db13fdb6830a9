"""Samples between two samples."""

import numpy as np
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP
from dtwin.emulation.emulation import Emulation
from dtwin.parameters import PERIOD
from dtwin.services.parts.strides import GAP, MOST, STRIDE, strides
from dtwin.signals import Sensors, Voltages


def sample(*theta: float, sequence: int = 0) -> Sensors:
    first, second, third = theta
    return Sensors(sequence, 0.01 * sequence, (first, second, third), 0.4, True, "red")


@pytest.mark.parametrize("end", [(3.0, -2.5, 0.1), (0.41, 0.0, 0.0), (-9.0, 9.0, 9.0)])
def test_no_joint_jumps_and_the_rest_is_that_of_the_later_sample(end: tuple[float, float, float]) -> None:
    before, now = sample(0.0, 0.0, 0.0), sample(*end, sequence=205)
    steps = strides(before, now)
    way = np.array([each.theta for each in (before, *steps, now)])
    assert np.abs(np.diff(way, axis=0)).max() <= STRIDE + 1e-12
    np.testing.assert_allclose(np.diff(way, axis=0), np.tile(np.diff(way, axis=0)[0], (len(way) - 1, 1)))
    assert {(s.sequence, s.gripper, s.box_present, s.box_colour) for s in steps} == {(205, 0.4, True, "red")}


def test_there_is_a_step_for_each_missed_tick() -> None:
    assert strides(sample(0.0, 0.0, 0.0), sample(STRIDE, 0.0, -STRIDE, sequence=1)) == []
    angles = [each.theta[0] for each in strides(sample(0.0, 0.0, 0.0), sample(0.03, 0.0, 0.0, sequence=3))]
    assert angles == pytest.approx([0.01, 0.02])
    assert len(strides(sample(0.0, 0.0, 0.0), sample(STRIDE, 0.0, 0.0, sequence=900))) == GAP - 1
    assert strides(sample(0.0, 0.0, 0.0), sample((MOST + 1) * STRIDE, 0.0, 0.0, sequence=9)) == []


@pytest.mark.parametrize("seed", [1, 2, 4, 7])
def test_an_arm_whose_commands_miss_one_tick_in_nine_is_not_stopped(seed: int) -> None:
    """The last voltages act on meanwhile; the observer would take what the arm does in many ticks for a jump."""
    plant, controller, missed = Emulation(noise=0.002, seed=seed), EmbeddedController(), np.random.default_rng(seed)
    before, silent = plant.read(), 0
    for _ in range(3000):
        if silent == 0:
            now = plant.read()
            for step in strides(before, now):
                controller.step(step)
            plant.apply(controller.step(now))
            before = now
            silent = int(missed.integers(1, GAP)) if missed.random() < 0.05 else 0
        else:
            silent -= 1
        plant.advance(PERIOD)
        assert controller.resource.read(STOP) == 0
    assert plant.box_counts.delivered >= 1


def after_a_gap() -> tuple[EmbeddedController, Sensors, Sensors]:
    """The blocks that carry a box, the last sample they saw, and one after a second in which the arm fell."""
    plant, controller = Emulation(seed=3), EmbeddedController()
    carried = 0
    while carried < 60:
        before = plant.read()
        command = controller.step(before)
        carried = carried + 1 if command.box_gripped else 0
        plant.apply(command)
        plant.advance(PERIOD)
    for _ in range(100):
        plant.apply(Voltages(0, 0.0, (0.0, 0.0, 0.0, command.volts[3]), True))
        plant.advance(PERIOD)
    return controller, before, plant.read()


def test_the_blocks_keep_a_box_when_they_are_led_and_let_go_of_another_arms() -> None:
    controller, before, now = after_a_gap()
    assert np.sum(np.abs(np.subtract(now.theta, before.theta)) > 0.5) >= 2
    commands = [controller.step(each) for each in (*strides(before, now), now, now)]
    assert all(command.box_gripped for command in commands)
    controller, _, now = after_a_gap()
    assert not [controller.step(now), controller.step(now)][-1].box_gripped
