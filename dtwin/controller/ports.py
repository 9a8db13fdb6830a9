"""The one table of the controller's blocks, ports and messages, and the one conversion of samples and commands.

Block names are those of fb/dtwin.sys, the layouts those of its SERVER blocks. The wire format is in
`dtwin.iec61499.net.wire`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dtwin.errors import CommunicationError
from dtwin.iec61499.net.wire import Signature
from dtwin.iec61499.types import BOOL, DINT, LREAL, STRING
from dtwin.parameters import ROOT
from dtwin.signals import Sensors, Voltages

BLOCKS: Final = ROOT / "fb"
"""Folder of the function-block library."""
SYSTEM: Final = "dtwin.sys"
"""The system in that folder which holds the application."""
MOTION_SYSTEM: Final = "motion.sys"
"""The system in that folder which holds planner and controller alone."""
_JOINTS: Final = (1, 2, 3)

TUNING: Final = (*(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in _JOINTS), "PLANNER.T")
"""Inputs that one message changes together: gains and target time, in the order of the message."""
MODEL: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in "KMILCD" for joint in _JOINTS)
"""Inputs that another message changes together: the model, in the order of the message."""
PATH: Final = tuple(f"PLANNER.THETA_D{joint}" for joint in _JOINTS)
"""Outputs with the angles (rad) of the path."""
PATH_END: Final = tuple(f"PLANNER.THETA_T{joint}" for joint in _JOINTS)
"""Inputs with the angles (rad) at which the path ends."""
TWIN: Final = "TWIN"
"""Block DIGITAL_TWIN of the application."""
STOP: Final = f"{TWIN}.STOP"
"""Output with the number of the safe stop in force."""
SIGNAL: Final = tuple(
    f"{TWIN}.IDENTIFICATION.BLOCK.SIGNAL.{name}"
    for name in ("AMPLITUDE1", "AMPLITUDE2", "AMPLITUDE3", "UNIT", "DELAY1", "DELAY2", "DELAY3", "LENGTH")
)
"""Inputs of the block that plays the identification signal: V, then counts of ticks."""


@dataclass(frozen=True, slots=True)
class Port:
    """A SERVER block of the application.

    Attributes:
        block: its dotted name in the resource.
        number: TCP port at which the library lets it listen.
        receives: layout of the messages to the block.
        sends: layout of its answers.
    """

    block: str
    number: int
    receives: Signature
    sends: Signature


_NOTHING: Final = Signature([])
EMULATOR: Final = Port(
    "EMULATOR",
    61500,
    Signature([LREAL, LREAL, LREAL, LREAL, BOOL, STRING]),
    Signature([LREAL, LREAL, LREAL, LREAL, BOOL]),
)
"""A sample in, a command out: see `sensor_values` and `voltages`."""
REQUEST: Final = Port(f"{TWIN}.IDENTIFICATION.REQUEST", 61501, Signature([BOOL]), _NOTHING)
"""Whether the identification signal shall be played."""
GAINS: Final = Port(f"{TWIN}.SIMULATION.GAIN_PORT", 61504, Signature([LREAL] * len(TUNING)), _NOTHING)
"""The inputs TUNING."""
ARM_MODEL: Final = Port(f"{TWIN}.SIMULATION.MODEL_PORT", 61505, Signature([LREAL] * len(MODEL)), _NOTHING)
"""The inputs MODEL."""
VERDICT: Final = Port(f"{TWIN}.MONITORING.VERDICT", 61506, Signature([DINT, LREAL, BOOL]), Signature([DINT]))
"""Number of the arm's state, its probability, whether to release the arm; answered by the number of the stop."""


def sensor_values(sensors: Sensors) -> tuple[Any, ...]:
    """A sample in the order of the message to EMULATOR."""
    return (*sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour)


def voltages(sensors: Sensors, answer: Sequence[Any]) -> Voltages:
    """The command that an answer of EMULATOR to a sample stands for."""
    v_1, v_2, v_3, v_gripper, gripped = answer
    return Voltages(sensors.sequence, sensors.time, (v_1, v_2, v_3, v_gripper), gripped)


def received_voltages(sensors: Sensors, answer: Sequence[Any], sender: object) -> Voltages:
    """The same for an answer from outside this process.

    Raises:
        CommunicationError: a voltage is not finite; names the sender.
    """
    command = voltages(sensors, answer)
    if not all(map(math.isfinite, command.volts)):
        raise CommunicationError(f"{sender}: expected finite volts, got {command.volts}")
    return command
