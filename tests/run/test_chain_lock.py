"""A locked joint of any arm stands, whatever its drive does."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import ChainPlant


@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
@pytest.mark.parametrize("machine", ["ideal", "nominal"])
def test_a_locked_joint_does_not_creep(name: str, machine: str) -> None:
    arm = arm_of(name)
    faults = [parse_chain_fault("lock2@0-2", len(arm))]
    plant = ChainPlant(machine_of(machine, arm), np.full(len(arm), 0.3), faults=faults)
    commands = np.array([0.9 * joint.actuator.limit for joint in arm.joints])
    moved = []
    for k in range(250):
        plant.apply((commands * np.where(np.arange(len(arm)) == 1, 1.0, 0.0)).tolist())
        plant.advance()
        moved.append(abs(float(plant.state[0][1]) - 0.3))
        if k == 199:
            assert moved[-1] < 5e-3
    assert moved[-1] > 10.0 * moved[199], "it is free again"


def test_other_joints_are_as_they_were() -> None:
    """The same motion of the first joint's drive with the second joint locked and with friction that holds it."""
    arm = arm_of("planar-2r")
    light = replace(machine_of("nominal", arm), encoders=False)
    free, locked = (
        ChainPlant(light, np.zeros(2), faults=[parse_chain_fault(text, 2)]) for text in ("K1*=1@0", "lock2@0")
    )
    for plant in (free, locked):
        for _ in range(20):
            plant.apply([2.0, 0.0])
            plant.advance()
    assert abs(locked.state[0][0]) > 1e-3
    assert abs(locked.state[0][1]) < 1e-3 < abs(free.state[0][1])
