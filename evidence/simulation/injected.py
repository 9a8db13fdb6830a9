"""The sensitivity of the loop on the emulation, measured by sines that are added to the voltage of one motor.

With the sine d at the motor's terminals and the blocks' answer v, the motors get u = v + d, and u = S d with the
input sensitivity S of `dtwin.simulation.margins.measures`. A whole number of periods is looked at after the loop has
settled (Ljung, System Identification, ch. 6.2).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final

import numpy as np

from dtwin.controller.settings import ControlSettings
from dtwin.parameters import PERIOD, ArmParameters, JointVector, joint_vector
from dtwin.simulation.figures import Array
from dtwin.simulation.margins.loop import ComplexArray
from dtwin.simulation.whatif import MotionCase, Simulator
from evidence.simulation.emulated_arm import EmulatedArm

WINDOW: Final = 400
"""Number of ticks that are looked at; frequencies are whole multiples of its inverse."""
_SETTLING: Final = 600
"""Number of ticks before these in which the loop settles."""
_VOLTS: Final = 0.02
"""Amplitude of the sine, V: small enough for the arm to stay where it is linear."""


class InjectedArm:
    """The emulated arm with a sine on the voltage of one motor.

    Args:
        motor: motor, 0 to 2.
        cycles: number of periods of the sine in WINDOW ticks.
        case: case that is simulated.
        ticks: number of ticks of the motion.
    """

    def __init__(self, motor: int, cycles: int, case: MotionCase, ticks: int) -> None:
        self._arm = EmulatedArm(case.arm, case, ticks)
        self.states: Array = self._arm.states
        self._added = np.zeros((ticks, 3))
        self._added[:, motor] = _VOLTS * np.sin(2.0 * math.pi * cycles / WINDOW * np.arange(ticks))

    def advance(self, tick: int, volts: JointVector) -> JointVector:
        """Adds the sine to the voltages (V) of a tick, moves the arm to the next one and returns its angles (rad)."""
        return self._arm.advance(tick, joint_vector(np.array(volts) + self._added[tick]))


def frequency(cycles: int) -> float:
    """The frequency of a sine with a number of periods in the window, rad/s."""
    return 2.0 * math.pi * cycles / (WINDOW * PERIOD)


def measured_sensitivity(
    simulator: Simulator,
    settings: ControlSettings,
    arm: ArmParameters,
    payload: float,
    theta: JointVector,
    cycles: int,
) -> ComplexArray:
    """Measures the input sensitivity of the loop at one frequency, (3, 3).

    Args:
        simulator: simulator whose blocks control the arm.
        settings: settings of the blocks.
        arm: parameters of the emulated arm.
        payload: mass of the held box, kg.
        theta: angles at which the arm rests, rad.
        cycles: number of periods of the sine in WINDOW ticks.
    """
    ticks = _SETTLING + WINDOW
    case = MotionCase(theta, settings, theta, arm=arm, payload=payload, duration=ticks * PERIOD)
    wave = np.exp(-2j * math.pi * cycles / WINDOW * np.arange(_SETTLING, ticks))
    sine = _VOLTS * np.sin(2.0 * math.pi * cycles / WINDOW * np.arange(_SETTLING, ticks))
    columns = []
    for motor in range(3):
        volts = simulator.run(case, partial(InjectedArm, motor, cycles)).volts[_SETTLING:]
        column = wave @ volts / (wave @ sine)
        column[motor] += 1.0
        columns.append(column)
    found: ComplexArray = np.column_stack(columns)
    return found
