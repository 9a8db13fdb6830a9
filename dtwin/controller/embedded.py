"""The control application run in this process; the control law itself is in the function blocks alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from dtwin.controller.kept import application
from dtwin.controller.ports import BLOCKS, EMULATOR, LAST_SAMPLE, PATH, SYSTEM, sensor_values, voltages
from dtwin.controller.runtime import running
from dtwin.controller.sequence import CALLS, HELP, STRAIGHT, SequenceSettings
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import JointVector
from dtwin.signals import Event, EventKind, Sensors, Voltages
from iec61499.runtime.resource import Resource
from iec61499.trace.ctf import TraceWriter


class EmbeddedController:
    """The control application in the embedded runtime, stepped by calls.

    Args:
        settings: values for the inputs of the blocks; the default settings when None.
        blocks: folder of the function-block library.
        sequence: how boxes are fetched and brought to their places.
        prepare: does something to the application before it starts, which then runs in Python.
        writer: writes a trace of all events until it is closed, if nothing is prepared.

    Attributes:
        resource: the running application, whose block variables can be read and written between steps.

    Raises:
        FunctionBlockError: the library or its application cannot be used.
        NativeError: machine code is asked for and cannot be made here.
    """

    def __init__(
        self,
        settings: ControlSettings | None = None,
        blocks: Path = BLOCKS,
        sequence: SequenceSettings = STRAIGHT,
        prepare: Callable[[Resource], None] | None = None,
        writer: TraceWriter | None = None,
    ) -> None:
        network, library = application(blocks, SYSTEM)
        if prepare is None:
            self.resource = running(network, library, writer)
        else:
            prepared = Resource(network, library)
            prepare(prepared)
            self.resource = prepared
        for name, value in {**(settings or ControlSettings()).inputs(), **sequence.inputs()}.items():
            self.resource.write(name, value)
        server = self.resource.server(EMULATOR.block)
        self.resource.start()
        self._exchange = server.exchange
        self._target = self.resource.reader(PATH)
        self._help = self.resource.reader((HELP, LAST_SAMPLE[0]))
        self._calls = 0
        self._events: list[Event] = []

    def step(self, sensors: Sensors) -> Voltages:
        """The application's answer to a sample: one IND event of its SERVER block, run until nothing is left to do.

        Raises:
            FunctionBlockError: a block failed. CommunicationError: the application did not answer.
        """
        return self.command(sensors, self._exchange(sensor_values(sensors)))

    def command(self, sensors: Sensors, answer: Sequence[Any]) -> Voltages:
        """The command in the application's answer to a sample, which may call for help."""
        command = voltages(sensors, answer)
        calls, _ = self._help()
        if calls != self._calls:
            self._calls = calls
            self._events.append(Event(sensors.time, EventKind.HELP, CALLS[calls]))
        return command

    def drain_events(self) -> list[Event]:
        """The sequence's calls for help since the last call of this method."""
        events, self._events = self._events, []
        return events

    def target(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""
        theta_1, theta_2, theta_3 = self._target()
        return (theta_1, theta_2, theta_3)
