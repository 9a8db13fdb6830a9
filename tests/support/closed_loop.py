"""What the FMUs are held to: the embedded controller and the twin's rollout in a loop, tick by tick."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import HANGING, PERIOD, ArmParameters, GripperParameters, JointVector
from dtwin.signals import DriveVector, Sensors
from dtwin.twin.dynamics import Array
from dtwin.twin.rollout import rollout


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """The loop at the end of a tick: state (6,) in rad and rad/s, gripper (rad), payload (kg), voltages (V)."""

    state: Array
    gripper: float
    payload: float
    volts: DriveVector


def closed_loop(ticks: int, colour: str = "", mass: float = 0.0, late: bool = False) -> Iterator[Instant]:
    """The loop from the hanging arm on, under the settings that controllers start with.

    Args:
        ticks: number of ticks.
        colour: colour of the boxes that wait for ever; "" for no boxes.
        mass: mass of a box, kg.
        late: whether voltages act a tick later, as where both are stepped at once and exchange values afterwards.
    """
    embedded, arm = EmbeddedController(ControlSettings()), ArmParameters()
    state = np.array((*HANGING, 0.0, 0.0, 0.0))
    gripper, speed, payload, gripped = GripperParameters().opened, 0.0, 0.0, False
    before: DriveVector = (0.0, 0.0, 0.0, 0.0)
    for tick in range(ticks):
        theta: JointVector = (state[0], state[1], state[2])
        command = embedded.step(Sensors(tick, tick * PERIOD, theta, gripper, bool(colour), colour))
        if command.box_gripped != gripped:
            gripped, payload = command.box_gripped, mass if command.box_gripped else 0.0
        acting, before = before if late else command.volts, command.volts
        state = rollout(arm, state, [acting[:3]], payload)[-1]
        gripper, speed = moved_gripper(gripper, speed, acting[3])
        yield Instant(state, gripper, payload, command.volts)


def moved_gripper(angle: float, speed: float, volts: float) -> tuple[float, float]:
    """I w' = K u - D w, solved exactly, until the stops at the end of the tick."""
    gripper = GripperParameters()
    rate, final = gripper.damping / gripper.inertia, gripper.voltage_constant * volts / gripper.damping
    share = -np.expm1(-rate * PERIOD)
    moved = angle + final * PERIOD + (speed - final) * share / rate
    if not gripper.closed <= moved <= gripper.opened:
        return min(max(moved, gripper.closed), gripper.opened), 0.0
    return float(moved), float(speed + (final - speed) * share)
