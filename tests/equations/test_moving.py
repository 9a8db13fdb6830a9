"""Ticks of one step against many short ones."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Array, Friction
from dtwin.emulation.chain.arms import arm_of
from dtwin.equations.native import DryFriction, MovingChain, NativeChain
from dtwin.equations.rigid import inverse_dynamics

TICKS = 100


def frictionless(arm: Arm) -> Arm:
    joints = (replace(joint, friction=Friction(joint.friction.viscous)) for joint in arm.joints)
    return replace(arm, joints=tuple(joints))


def dry_friction(arm: Arm) -> DryFriction:
    friction = [joint.friction for joint in arm.joints]
    return DryFriction(np.array([f.coulomb for f in friction]), np.array([f.load for f in friction]), 0.005)


def torques(arm: Arm, start: Array) -> Array:
    """The arm's weight at the start, and swings in which its joints start, stop and turn round, (TICKS, n)."""
    n = len(arm)
    still = np.zeros((1, n))
    weight = inverse_dynamics(arm, start[None], still, still)[0]
    dry = np.array([0.05 * joint.largest + 1.5 * joint.friction.coulomb for joint in arm.joints])
    time = np.arange(TICKS)[:, None] * arm.period
    found: Array = weight + dry * np.sin(2.0 * np.pi * (1.5 + 0.3 * np.arange(n)) * time)
    return found


def path(moving: MovingChain, torque: Array, calls: int) -> Array:
    """Positions after every tick, each of which is some calls, (TICKS, n)."""
    rows = []
    for held in torque:
        for _ in range(calls):
            assert moving.advance(held)
        rows.append(moving.q.copy())
    return np.array(rows)


@pytest.mark.parametrize("dry", [False, True], ids=["frictionless", "dry"])
@pytest.mark.parametrize("name", ["planar-2r", "servo-2r", "six-axis", "thesis"])
def test_ticks_of_one_step_are_about_as_exact_as_short_steps(name: str, dry: bool) -> None:
    """Against 64 steps a tick they are off by less than twice what the four steps of the emulation are off by."""
    arm = arm_of(name)
    if not dry:
        arm = frictionless(arm)
    chain, friction, start = NativeChain(arm), dry_friction(arm) if dry else None, np.full(len(arm), 0.3)
    torque = torques(arm, start)

    def moved(steps: int, calls: int) -> Array:
        step = arm.period / (steps * calls)
        return path(chain.moving(start, np.zeros(len(arm)), step, steps, friction), torque, calls)

    exact, short, found = moved(1, 64), moved(1, 4), moved(4, 1)
    assert np.ptp(exact, axis=0).min() > 0.005
    off = [np.sqrt(np.mean((one - exact) ** 2)) for one in (found, short)]
    assert off[0] < max(2.0 * off[1], 1e-10)
