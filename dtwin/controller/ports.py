"""Table of the blocks, ports and messages of the control application, and the conversion of samples and commands.

Block names are those of fb/dtwin.sys, message layouts those of its SERVER blocks. The wire format is in
`iec61499.net.wire`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from dtwin.signals import Sensors, Voltages
from iec61499.net.wire import Signature
from iec61499.types import BOOL, DINT, LREAL, STRING

BLOCKS: Final = ROOT / "fb"
"""Folder of the function-block library."""
SYSTEM: Final = "dtwin.sys"
"""File of the system with the control application, in the folder BLOCKS."""
MOTION_SYSTEM: Final = "motion.sys"
"""File of the system with path planner and controller alone, in the folder BLOCKS."""
APPLICATION: Final = "CELL"
"""Name of the application in the system; on a device the names of its blocks begin with it."""
_JOINTS: Final = (1, 2, 3)

TUNING: Final = (*(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in _JOINTS), "PLANNER.T")
"""Inputs with gains and target time, which one message sets together, in the order of the message."""
MODEL: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in (*"KMILCD", "MU") for joint in _JOINTS)
"""Inputs with the arm model, which one message sets together, in the order of the message."""
WIDENED: Final = "SEQUENCE.WIDENED"
"""Input with the factor on the tolerance of an arm that does not come to rest."""
PAYLOAD: Final = "CONTROLLER.PAYLOAD_MASS"
"""Input with the mass of a box that the controller assumes, kg."""
CONFIRM: Final = "DETECTOR.CONFIRM"
"""Input with the samples by which another arm is known, after the first one."""
LOAD: Final = (PAYLOAD,)
OFFSETS: Final = tuple(f"ENCODERS.OFFSET{joint}" for joint in _JOINTS)
"""Inputs with the known offsets of the encoders, rad."""
GROUPS: Final = (TUNING, MODEL, LOAD, OFFSETS)
"""The inputs that are changed together."""
REPEATS: Final = tuple(f"OBSERVER.REPEATS{joint}" for joint in _JOINTS)
"""Inputs with the repetitions of a reading that the noise of an encoder makes impossible; 0 for none."""
PULL: Final = tuple(f"OBSERVER.PULL{joint}" for joint in _JOINTS)
"""Inputs with the share of the torque of unknown drives that leaves the readings of a joint as they are."""
PATH: Final = tuple(f"PLANNER.THETA_D{joint}" for joint in _JOINTS)
"""Outputs with the desired angles of the path, rad."""
LAST_SAMPLE: Final = ("SEQUENCE.SYSTEM_TIME", *(f"DETECTOR.THETA{joint}" for joint in _JOINTS))
"""Time of the last sample since the first one, s, and the angles of it, rad."""
PATH_END: Final = tuple(f"PLANNER.THETA_T{joint}" for joint in _JOINTS)
"""Inputs with the angles at which the path ends, rad."""
MEMORY: Final = (
    tuple(f"CONTROLLER.{name}{joint}" for name in ("Y1", "Y2", "SUM", "ALPHA") for joint in _JOINTS),
    tuple(f"OBSERVER.{name}{joint}" for name in ("TH", "OM", "LAST") for joint in _JOINTS),
)
"""Variables that carry the feedback of an arm at rest from one tick to the next, block by block."""
TWIN: Final = "TWIN"
"""Name of the block of type DIGITAL_TWIN."""
STOP: Final = f"{TWIN}.STOP"
"""Output with the number of the safe stop in force."""
STOPPED: Final = "SELECTOR.STOP"
"""Input with the number of the safe stop that the last command obeys; a device that was built block by block has no
output STOP."""
SIGNAL: Final = tuple(
    f"{TWIN}.IDENTIFICATION.BLOCK.SIGNAL.{name}"
    for name in ("AMPLITUDE1", "AMPLITUDE2", "AMPLITUDE3", "UNIT", "DELAY1", "DELAY2", "DELAY3", "LENGTH")
)
"""Inputs of the block that plays the identification signal: amplitudes in V, all others in ticks."""


@dataclass(frozen=True, slots=True)
class Port:
    """A SERVER block of the application (IEC 61499-1, Annex F).

    Attributes:
        block: dotted name of the block in the resource.
        number: port at which the block listens in the library.
        receives: layout of the messages to the block.
        sends: layout of the answers of the block.
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
"""Receives samples and answers with commands; see `sensor_values` and `voltages`."""
REQUEST: Final = Port(f"{TWIN}.IDENTIFICATION.REQUEST", 61501, Signature([BOOL]), _NOTHING)
"""Receives whether the identification signal is to be played."""
GAINS: Final = Port(f"{TWIN}.SIMULATION.GAIN_PORT", 61504, Signature([LREAL] * len(TUNING)), _NOTHING)
"""Receives the values of the inputs TUNING."""
ARM_MODEL: Final = Port(f"{TWIN}.SIMULATION.MODEL_PORT", 61505, Signature([LREAL] * len(MODEL)), _NOTHING)
"""Receives the values of the inputs MODEL."""
VERDICT: Final = Port(f"{TWIN}.MONITORING.VERDICT", 61506, Signature([DINT, LREAL, BOOL]), Signature([DINT]))
"""Receives the number of the arm's state, its probability and whether to release the arm.

It answers with the number of the stop in force.
"""


def on_device(name: str) -> str:
    """What a block or port of the application is called on a device, as 4diac IDE calls it."""
    return f"{APPLICATION}.{name}"


def sensor_values(sensors: Sensors) -> tuple[Any, ...]:
    """The values of a sample in the order of the message to EMULATOR."""
    return (*sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour)


def voltages(sensors: Sensors, answer: Sequence[Any]) -> Voltages:
    """The command in an answer of EMULATOR to a sample."""
    v_1, v_2, v_3, v_gripper, gripped = answer
    return Voltages(sensors.sequence, sensors.time, (v_1, v_2, v_3, v_gripper), gripped)


def received_voltages(sensors: Sensors, answer: Sequence[Any], sender: object) -> Voltages:
    """The command in an answer from outside this process, checked to be finite.

    Raises:
        CommunicationError: a voltage is not finite; the message names the sender.
    """
    command = voltages(sensors, answer)
    if not all(map(math.isfinite, command.volts)):
        raise CommunicationError(f"{sender}: expected finite volts, got {command.volts}")
    return command
