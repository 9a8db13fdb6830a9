"""The control application in process, playing the identification signal in place of the controller's commands.

The signal is that of the function block SYS_IDENT_3211SIG; the block DIGITAL_TWIN requests it.
"""

from __future__ import annotations

from pathlib import Path

from dtwin.controller.kept import application
from dtwin.controller.ports import BLOCKS, EMULATOR, REQUEST, SYSTEM, TWIN, sensor_values, voltages
from dtwin.parameters import JointVector
from dtwin.signals import NO_COLOUR, DriveVector, Sensors
from iec61499.runtime.resource import Resource


class ExcitationController:
    """The control application in the embedded runtime, asked for the identification signal while no box waits.

    Args:
        blocks: folder of the function-block library.

    Raises:
        FunctionBlockError: the library or its application cannot be used.
    """

    def __init__(self, blocks: Path = BLOCKS) -> None:
        self._resource = Resource(*application(blocks, SYSTEM))

    def start(self, amplitude: JointVector, unit: int, delay: tuple[int, ...], samples: int) -> None:
        """Starts the application anew and requests a 3-2-1-1 signal, which comes with the next step.

        Args:
            amplitude: voltages of joints 1 to 3 in the positive half of the signal, V.
            unit: length of the shortest pulse, ticks.
            delay: ticks at 0 V before the signal of joints 1 to 3 starts.
            samples: length of the whole signal, ticks.
        """
        resource = self._resource
        resource.reset()
        for joint in range(3):
            resource.write(f"{TWIN}.AMPLITUDE{joint + 1}", float(amplitude[joint]))
            resource.write(f"{TWIN}.DELAY{joint + 1}", delay[joint])
        resource.write(f"{TWIN}.UNIT", unit)
        resource.write(f"{TWIN}.LENGTH", samples)
        cell, request = resource.server(EMULATOR.block), resource.server(REQUEST.block)
        resource.start()
        request.exchange((True,))
        self._exchange = cell.exchange

    def step(self, theta: JointVector, gripper: float) -> DriveVector:
        """Voltages of motors 1 to 3 and of the gripper (V) that answer measured angles (rad).

        Raises:
            FunctionBlockError: a block failed.
        """
        sensors = Sensors(0, 0.0, theta, gripper, False, NO_COLOUR)
        return voltages(sensors, self._exchange(sensor_values(sensors))).volts
