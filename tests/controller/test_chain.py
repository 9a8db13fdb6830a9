"""The application of a serial arm against its equations, its limits, its stops, and in both runtimes."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtwin.arm.chain import Actuator, Arm, Link
from dtwin.arm.poses import Poses
from dtwin.controller.chain.application import ARM, LIBRARY, STOP, TWIN, VERDICT, Control, inputs, joint_name, network
from dtwin.controller.chain.embedded import ChainController, started_network
from dtwin.controller.runtime import Runtime, chosen
from dtwin.equations.rigid import inverse_dynamics, usual_inertia
from dtwin.errors import ModelError
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from tests.support.chains import driven_arm

NOWHERE = Control(following=1e9)


def controller(arm: Arm, poses: Poses | None, control: Control = NOWHERE) -> ChainController:
    return ChainController(len(arm), inputs(arm, usual_inertia(arm), control, poses))


def gathered(blocks: ChainController, joints: int, variable: str) -> np.ndarray:
    return np.array([blocks.resource.read(f"{joint_name(k)}.{variable}") for k in range(joints)])


@pytest.mark.parametrize("joints", [1, 4, 7])
def test_links_give_the_torques_of_the_equations(joints: int) -> None:
    arm = driven_arm(joints, joints)
    poses = Poses(np.random.default_rng(3).uniform(-1.5, 1.5, (3, joints)), 0.0, True)
    load = 0.7
    blocks = controller(arm, poses)
    blocks.resource.write("SEQUENCE.LOAD", load)
    last = arm.links[-1]
    held = Link("load", load, arm.tool, np.zeros((3, 3)))
    heavy = replace(arm, links=(*arm.links[:-1], Link.from_parameters(last.name, last.parameters + held.parameters)))
    generator = np.random.default_rng(8)
    for _ in range(40):
        blocks.step(generator.uniform(-0.5, 0.5, joints).tolist())
        state = [gathered(blocks, joints, f"FEEDBACK.{name}")[None] for name in ("Q_M", "QD_M", "U")]
        expected = inverse_dynamics(heavy, *state)[0]
        np.testing.assert_allclose(gathered(blocks, joints, "LINK.TAU"), expected, rtol=1e-11, atol=1e-11)


def test_paths_keep_speed_and_acceleration_and_arrive_together() -> None:
    arm = driven_arm(3, 1)
    goals = np.array([[0.0, 0.0, 0.0], [1.5, 0.1, -0.3], [-1.9, 1.9, 3.0]])
    blocks = controller(arm, Poses(goals, 0.05))
    positions, rows = [0.0] * 3, []
    while not blocks.done:
        blocks.step(positions)
        rows.append(blocks.desired())
        positions = rows[-1][0].tolist()
    q, qd = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    speeds = np.array([joint.speed for joint in arm.joints])
    limits = np.array([joint.acceleration for joint in arm.joints])
    reached = np.abs(qd) / speeds
    assert reached.max() <= 1.0 + 1e-12
    assert np.abs(np.diff(qd, axis=0) / arm.period / limits).max() <= 1.0
    assert np.maximum(reached.max(), (np.abs(np.diff(qd, axis=0)) / arm.period / limits).max()) > 0.95
    np.testing.assert_allclose(q[-1], [-1.9, 1.9, 2.0], atol=1e-12)  # the last joint goes no farther than its range
    np.testing.assert_allclose(np.cumsum(qd, axis=0)[-1] * arm.period, q[-1], atol=1e-3)


def test_a_single_reading_off_the_path_stops_nothing() -> None:
    blocks = controller(driven_arm(3, 1), Poses(np.zeros((2, 3)), 0.0, True), Control(following=0.2))
    for tick in range(100):
        blocks.step([0.0, 0.3 if tick == 40 else 0.0, 0.0])
    assert blocks.stop == 0


def test_a_joint_that_leaves_its_path_stops_the_arm_along_the_path() -> None:
    arm = driven_arm(3, 1)
    blocks = controller(arm, Poses(np.array([[0.0, 0.0, 0.0], [1.5, 1.0, -0.5]]), 0.0, True), Control(following=0.2))
    positions = np.zeros(3)
    desired = []
    for tick in range(200):
        away = np.array([0.0, 0.3 if 40 <= tick < 60 else 0.0, 0.0])
        blocks.step((positions + away).tolist())
        desired.append(blocks.desired())
        positions = desired[-1][0]
    q, qd = np.array([row[0] for row in desired]), np.array([row[1] for row in desired])
    assert blocks.stop == 2
    assert np.abs(qd[39]).max() > 0.1
    assert np.abs(qd[60 + 30 :]).max() < 1e-12
    way = (q[-1] - q[39]) / np.array([1.5, 1.0, -0.5])
    np.testing.assert_allclose(way, way[0], rtol=1e-9)  # all joints stayed on the path
    assert way[0] > 0.0


def test_without_torque_the_commands_are_zero_and_the_way_begins_anew_after_the_release() -> None:
    arm = driven_arm(2, 4)
    goals = np.array([[0.0, 0.0], [1.0, -1.0]])
    blocks = controller(arm, Poses(goals, 0.0, True), Control(following=0.2))
    verdict = blocks.resource.server("VERDICT")
    positions = np.zeros(2)
    for _ in range(60):
        blocks.step(positions.tolist())
        positions = blocks.desired()[0]
    assert verdict.exchange((3, 1.0, False)) == (3,)
    for _ in range(20):
        positions = positions - 0.01
        assert blocks.step(positions.tolist()) == (0.0, 0.0)
    assert verdict.exchange((0, 1.0, True)) == (0,)
    blocks.step(positions.tolist())
    np.testing.assert_array_equal(blocks.desired()[0], positions)
    for _ in range(300):
        blocks.step(positions.tolist())
        positions = blocks.desired()[0]
    assert blocks.pose in (0, 1)
    assert blocks.stop == 0


def test_both_runtimes_give_the_same_bits() -> None:
    arm = driven_arm(4, 2)
    poses = Poses(np.random.default_rng(3).uniform(-1.5, 1.5, (3, 4)), 0.1, True)
    answers = []
    runtimes: tuple[Runtime, ...] = ("python", "native")
    for runtime in runtimes:
        generator = np.random.default_rng(1)
        with chosen(runtime):
            blocks = controller(arm, poses)
        answers.append([blocks.step(generator.uniform(-1.0, 1.0, 4).tolist()) for _ in range(100)])
    assert answers[0] == answers[1]


@pytest.mark.parametrize(
    ("joint", "words"),
    [
        ({"actuator": Actuator("current")}, "joints.j0: expected a drive commanded in V, N m or A"),
        ({"actuator": Actuator("position", 1.0)}, "joints.j0: expected a drive"),
        ({"speed": np.inf}, "joints.j0: expected speed"),
    ],
)
def test_an_arm_that_is_not_known_enough_is_refused(joint: dict[str, Any], words: str) -> None:
    arm = driven_arm(2, 4)
    arm = replace(arm, joints=(replace(arm.joints[0], **joint), arm.joints[1]))
    with pytest.raises(ModelError, match=words):
        inputs(arm, np.ones(2), Control(), None)


def test_a_sample_that_comes_with_the_answer_to_the_last_one_finds_the_stop_decided() -> None:
    arm = driven_arm(2, 1)
    values = inputs(arm, usual_inertia(arm), Control(following=0.02), Poses(np.array([[0.0, 0.0], [1.5, 0.3]]), 0.05))
    samples = [(1e-4 * k, 0.0) for k in range(80)]
    blocks, expected = ChainController(2, values), []
    for sample in samples:
        expected.append((*blocks.step(sample), blocks.stop))
    resource = Resource(started_network(network(2)), Library([LIBRARY]))
    for name, value in values.items():
        resource.write(name, value)
    port, answers = resource.port(ARM), list[tuple[float, float, int]]()

    def answered(given: tuple[Any, ...]) -> None:
        answers.append((given[0], given[1], resource.read(f"{STOP}.STOP")))
        if len(answers) < len(samples):
            port.deliver((*samples[len(answers)], 0))

    port.attach(answered)
    for server in (VERDICT, TWIN):
        resource.port(server).attach(lambda given: None)
    resource.start()
    port.deliver((*samples[0], 0))
    resource.run_until_idle()
    assert {stop for *_, stop in expected} >= {0, 1}
    assert answers == expected
