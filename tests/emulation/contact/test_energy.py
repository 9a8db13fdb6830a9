"""Contact and friction take energy and never make any: the balance of a cell in which an arm and boxes fall."""

import mujoco
import numpy as np
import pytest

from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.machine.sections import Contact
from dtwin.emulation.plant import Plant
from dtwin.parameters import PHYSICS_STEP, JointVector

SHALLOW = -2e-4
"""Penetration up to which contacts hold next to no elastic energy, m."""


def energy(plant: Plant, scratch: mujoco.MjData) -> float:
    """Kinetic and potential energy of all bodies, J."""
    scratch.qpos[:], scratch.qvel[:] = plant.data.qpos, plant.data.qvel
    mujoco.mj_forward(plant.model, scratch)
    mujoco.mj_energyPos(plant.model, scratch)
    mujoco.mj_energyVel(plant.model, scratch)
    return float(scratch.energy.sum())


@pytest.mark.parametrize(
    ("theta", "boxes", "duration"),
    [
        ((2.5, -2.0, -0.5), [(0.2, 0.005, 0.2), (0.15, 0.0, 0.5)], 8.0),
        ((1.0, 0.5, -2.0), [(0.2, -0.002, -0.2), (0.05, 0.0, 0.3)], 60.0),
    ],
)
def test_the_balance_of_energy_never_rises(
    theta: JointVector, boxes: list[tuple[float, float, float]], duration: float
) -> None:
    bodies = Bodies(Contact(enabled=True))
    plant = Plant(bodies=bodies)
    plant.reset(theta)
    for index, position in enumerate(boxes):
        bodies.put(index, position, 0.2)
    damping = plant.model.dof_damping[:4].copy()
    scratch = mujoco.MjData(plant.model)
    balances = [energy(plant, scratch)]
    damped = 0.0
    for _ in range(round(duration / PHYSICS_STEP)):
        before = plant.data.qvel[:4].copy()
        plant.advance(PHYSICS_STEP)
        after = plant.data.qvel[:4]
        damped += float((damping * 0.5 * (before + after) * after).sum()) * PHYSICS_STEP
        if not plant.data.ncon or plant.data.contact.dist.min() > SHALLOW:
            balances.append(energy(plant, scratch) + damped)
    balance = np.array(balances)
    lost = balance[0] - balance[-1]
    assert lost > 1.0
    assert (balance - np.minimum.accumulate(balance)).max() < 1e-3 * lost
