"""Holding brakes of any arm: its blocks engage them where nothing else is sure to hold a joint."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Brake, Transmission
from dtwin.controller.chain.application import inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import usual_inertia
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run

START = np.array([0.4, 0.9])
"""A posture of planar-2r that gravity pulls down, rad."""


def without_brakes(arm: Arm) -> Arm:
    return replace(arm, joints=tuple(replace(joint, brake=None) for joint in arm.joints))


def standing(arm: Arm) -> tuple[ChainPlant, ChainController]:
    """The arm at rest in START, held by its blocks."""
    blocks = ChainController(
        len(arm), inputs(arm, usual_inertia(arm), ArmCell(arm="planar-2r").settings(1.0).control, None)
    )
    return ChainPlant(machine_of("nominal", arm), START), blocks


def ticks(plant: ChainPlant, blocks: ChainController, count: int) -> None:
    for _ in range(count):
        plant.apply(blocks.step(plant.read().tolist()), blocks.brakes)
        plant.advance()


def test_a_joint_whose_encoder_lies_is_braked_and_the_others_stay_under_control() -> None:
    seen: list[tuple[int, tuple[bool, ...]]] = []

    def look(blocks: Any, *_: Any) -> None:
        seen.append((blocks.stop, blocks.brakes))

    ran = run(ArmCell(arm="planar-2r", machine="5", faults=("bias2+=0.3@1.2",)).settings(2.6, 3), beside=look)
    assert seen[-1] == (2, (False, True))
    assert not any(any(brakes) for stop, brakes in seen if not stop)
    assert ran.command[-1, 1] == 0.0 != ran.command[-1, 0]
    assert np.abs(np.diff(ran.true[-30:], axis=0)).max() < 1e-4  # it stands


def test_an_arm_without_torque_is_held_by_its_brakes_and_falls_without_them() -> None:
    moved = []
    for arm in (arm_of("planar-2r"), without_brakes(arm_of("planar-2r"))):
        plant, blocks = standing(arm)
        ticks(plant, blocks, 50)
        blocks.halt(angles_known=False)
        ticks(plant, blocks, 100)
        assert blocks.stop == 3
        assert blocks.brakes == tuple(joint.brake is not None for joint in arm.joints)
        moved.append(np.abs(plant.state[0] - START).max())
    assert moved[0] < 0.1 < 0.5 < moved[1]  # it sinks for the 50 ms that the brakes take


def test_a_release_takes_the_brakes_off() -> None:
    plant, blocks = standing(arm_of("planar-2r"))
    ticks(plant, blocks, 20)
    blocks.halt(angles_known=False)
    ticks(plant, blocks, 50)
    blocks.judge("nominal", 0.0, release=True)
    ticks(plant, blocks, 100)
    assert (blocks.stop, blocks.brakes) == (0, (False, False))
    assert np.abs(plant.state[1]).max() < 0.01


@pytest.mark.parametrize("torque", [4.0, 20.0])
def test_a_brake_holds_up_to_its_torque_once_it_has_had_its_time(torque: float) -> None:
    arm = arm_of("planar-2r")
    shoulder, elbow = arm.joints
    arm = replace(arm, joints=(replace(shoulder, brake=Brake(torque, 0.03)), replace(elbow, brake=Brake(20.0))))
    plant = ChainPlant(machine_of("nominal", arm), START)
    for _ in range(3):
        plant.apply((0.0, 0.0), (True, True))
        plant.advance()
    assert abs(plant.state[1][0]) > 0.1 > 1e-3 > abs(plant.state[1][1])
    for _ in range(40):
        plant.apply((9.0, 0.0), (True, True))  # 8.1 N m of the shoulder
        plant.advance()
    slips = abs(plant.state[1][0]) > 0.1
    assert slips == (torque < 8.0)


def test_brakes_hold_the_motors_of_gears_that_yield() -> None:
    arm = arm_of("planar-2r")
    gear = Transmission(400.0, 0.5, 0.0)
    joints = (replace(j, transmission=gear, actuator=replace(j.actuator, rotor=0.01)) for j in arm.joints)
    plant = ChainPlant(machine_of("nominal", replace(arm, joints=tuple(joints))), START)
    for _ in range(100):
        plant.apply((0.0, 0.0), (True, True))
        plant.advance()
    before = plant.state[0]
    for _ in range(100):
        plant.apply((0.0, 0.0), (True, True))
        plant.advance()
    assert np.abs(plant.state[0] - before).max() < 3e-3  # gears yield, and friction creeps a little
