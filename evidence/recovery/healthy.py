"""The cell without its fault: what a recovery is held against."""

from __future__ import annotations

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import MODEL
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters, JointVector
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.signals import Event, Sensors, Voltages


class _Relieved:
    """A controller that is given a model at a plant time (s), as the operator gives it to the running one."""

    def __init__(self, controller: EmbeddedController, model: ArmParameters, time: float) -> None:
        self._controller = controller
        self._port = EmbeddedPort(controller)
        self._model: ArmParameters | None = model
        self._time = time

    def step(self, sensors: Sensors) -> Voltages:
        if self._model is not None and sensors.time >= self._time:
            self._port.put(MODEL, ControlSettings(model=self._model))
            self._model = None
        return self._controller.step(sensors)

    def target(self) -> JointVector:
        return self._controller.target()

    def drain_events(self) -> list[Event]:
        return self._controller.drain_events()


def healthy_run(settings: CellSettings, model: ArmParameters, started: float) -> Log:
    """The log of the same cell without the fault.

    Args:
        settings: what the cell is run with.
        model: the model that its controller is given.
        started: plant time at which it is given, s.
    """
    cell = Cell(
        settings,
        _Relieved(EmbeddedController(settings.control, settings.blocks, sequence_of(settings)), model, started),
    )
    cell.run()
    return cell.log.freeze()
