"""The equations as machine code against those in numpy, and the twin's motion against MuJoCo's."""

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import STEPS, ChainPlant
from dtwin.equations.native import NativeChain
from dtwin.equations.rigid import forward_dynamics, inverse_dynamics, mass_matrix
from tests.support.chains import driven_arm


@pytest.mark.parametrize("arm", [driven_arm(1, 1), driven_arm(5, 2), driven_arm(7, 3), arm_of("six-axis")], ids=len)
def test_machine_code_solves_the_same_equations(arm: Arm) -> None:
    q, qd, tau = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 200, len(arm)))
    rotors = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    viscous = np.array([joint.friction.viscous for joint in arm.joints])
    masses = mass_matrix(arm, q) + np.diag(rotors)
    rest = tau - inverse_dynamics(arm, q, qd, np.zeros_like(q)) - viscous * qd
    expected = np.linalg.solve(masses, rest[:, :, None])[:, :, 0]
    found = NativeChain(arm).forward_dynamics(q, qd, tau)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())
    assert np.abs(found - forward_dynamics(arm, q, qd, tau)).max() > 1e-3  # rotors and friction count


@pytest.mark.parametrize("name", ["planar-2r", "six-axis", "thesis"])
def test_twenty_seconds_of_the_twin_are_those_of_the_emulation(name: str) -> None:
    arm = arm_of(name)
    n, start = len(arm), np.linspace(0.2, 0.5, len(arm))
    constant = np.array([joint.actuator.constant for joint in arm.joints], dtype=np.float64)
    largest = np.array([joint.largest for joint in arm.joints])
    weight = inverse_dynamics(arm, start[None], np.zeros((1, n)), np.zeros((1, n)))[0]
    plant = ChainPlant(machine_of("ideal", arm), start)
    time = np.arange(round(20.0 / arm.period))[:, None] * arm.period
    swing = 0.02 * largest * np.sin(2.0 * np.pi * (0.4 + 0.1 * np.arange(n)) * time)
    commands = (0.5 * weight + swing) / constant
    positions = []
    for command in commands:
        positions.append(plant.state[0])
        plant.apply(command)
        plant.advance()
    found, _ = NativeChain(arm).rollout(start, np.zeros(n), commands * constant, arm.period / STEPS, STEPS)
    assert np.ptp(positions, axis=0).min() > 0.1
    np.testing.assert_allclose(found[:-1], positions, rtol=0.0, atol=1e-9)
