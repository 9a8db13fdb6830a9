"""What the twin has found of the joints reaches the blocks of any arm, and counts there."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.runtime import Runtime, chosen
from dtwin.equations.rigid import usual_inertia
from tests.support.chains import driven_arm

ARM = driven_arm(3, 5)
NONE = Adjustment.none(3)
POSITIONS = [0.1, -0.2, 0.3]


def controller() -> ChainController:
    return ChainController(3, inputs(ARM, usual_inertia(ARM), Control(), None))


def test_an_offset_is_taken_off_slowly() -> None:
    blocks = controller()
    angle = blocks.resource.reader(("JOINT_2.READING.ANGLE",))
    blocks.step(POSITIONS)
    blocks.adjust(replace(NONE, offset=(0.0, 0.0025, 0.0)))
    seen = []
    for _ in range(4):
        blocks.step(POSITIONS)
        seen.append(float(angle()[0]))
    np.testing.assert_allclose(seen, [-0.201, -0.202, -0.2025, -0.2025], rtol=0.0, atol=1e-12)


def test_a_drive_of_half_its_torque_is_commanded_twice_as_much() -> None:
    healthy, weak = controller(), controller()
    weak.adjust(replace(NONE, strength=(1.0, 1.0, 0.5)))
    for _ in range(3):
        one, two = healthy.step(POSITIONS), weak.step(POSITIONS)
        np.testing.assert_allclose(two, np.array(one) * [1.0, 1.0, 2.0], rtol=1e-12)


def test_a_further_load_is_carried_as_the_last_link_carries_its_own_mass() -> None:
    held = ARM.parameters
    x, y, z = ARM.tool
    mass = 0.4
    held[-10:] += mass * np.array([1.0, x, y, z, y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    loaded = ARM.with_parameters(held)
    one, two = controller(), ChainController(3, inputs(loaded, usual_inertia(ARM), Control(), None))
    one.adjust(replace(NONE, load=mass))
    for _ in range(3):
        np.testing.assert_allclose(one.step(POSITIONS), two.step(POSITIONS), rtol=1e-9, atol=1e-9)


def test_friction_counts_with_its_factor_and_both_runtimes_give_the_same_bits() -> None:
    answers = []
    runtimes: tuple[Runtime, ...] = ("python", "native")
    for runtime in runtimes:
        generator = np.random.default_rng(1)
        with chosen(runtime):
            blocks = controller()
        rows = [blocks.step(generator.uniform(-1.0, 1.0, 3).tolist()) for _ in range(5)]
        blocks.adjust(Adjustment((0.01, 0.0, -0.02), (0.9, 1.0, 0.7), (2.0, 1.5, 1.0), 0.3))
        answers.append(rows + [blocks.step(generator.uniform(-1.0, 1.0, 3).tolist()) for _ in range(20)])
    assert answers[0] == answers[1]
    generator = np.random.default_rng(1)
    plain = controller()
    others = [plain.step(generator.uniform(-1.0, 1.0, 3).tolist()) for _ in range(25)]
    assert others[:5] == answers[0][:5]
    assert others[5] != answers[0][5]


def test_a_halt_brakes_where_the_angles_are_known_and_takes_the_torque_off_where_not() -> None:
    stops = []
    for known in (True, False):
        blocks = controller()
        blocks.step(POSITIONS)
        blocks.halt(known)
        blocks.step(POSITIONS)
        stops.append(blocks.stop)
    assert stops[0] in (1, 2)
    assert stops[1] == 3


@pytest.mark.parametrize("count", [1, 6])
def test_what_was_found_has_a_number_for_every_joint(count: int) -> None:
    assert len(Adjustment.none(count).message) == 3 * count + 1
