"""The control application under the identification signal: the override of the function blocks, asked for and run."""

from __future__ import annotations

from pathlib import Path

from dtwin.controller.ports import BLOCKS, EMULATOR, REQUEST, SYSTEM, TWIN, sensor_values, voltages
from dtwin.identification.excitation.signal import Excitation
from dtwin.iec61499.library import Library
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.runtime.resource import Resource
from dtwin.parameters import Triple
from dtwin.signals import NO_COLOUR, Quad, Sensors


class SignalBlocks:
    """The application of the cell in the embedded runtime, no box in sight, its twin asked for the signal.

    Args:
        blocks: folder of the function-block library.

    Raises:
        FunctionBlockError: the library or its application cannot be used.
    """

    def __init__(self, blocks: Path = BLOCKS) -> None:
        library = Library([blocks])
        self._resource = Resource(resource_network(library.load_system(blocks / SYSTEM)), library)

    def begin(self, signal: Excitation, samples: int) -> None:
        """Starts the application anew and requests a signal, which comes with the next step."""
        resource = self._resource
        resource.reset()
        for joint in range(3):
            resource.write(f"{TWIN}.AMPLITUDE{joint + 1}", float(signal.amplitude[joint]))
            resource.write(f"{TWIN}.DELAY{joint + 1}", signal.delay[joint])
        resource.write(f"{TWIN}.UNIT", signal.unit)
        resource.write(f"{TWIN}.LENGTH", samples)
        cell, request = resource.server(EMULATOR.block), resource.server(REQUEST.block)
        resource.start()
        request.exchange((True,))
        self._exchange = cell.exchange

    def step(self, theta: Triple, gripper: float) -> Quad:
        """The voltages of the motors and the gripper (V) that answer measured angles (rad).

        Raises:
            FunctionBlockError: a block failed.
        """
        sensors = Sensors(0, 0.0, theta, gripper, False, NO_COLOUR)
        return voltages(sensors, self._exchange(sensor_values(sensors))).volts
