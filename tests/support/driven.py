"""Blocks of fb/ under test: events go in by name, those that come out are listed; and the arm they control."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from dtwin.controller.settings import APPLICATION_LAW, ControlSettings
from dtwin.parameters import ROOT, ArmParameters
from dtwin.task import DEFAULT_TASK
from dtwin.twin.rollout import rollout
from iec61499 import model
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.resource import Resource

FOLDER: Final = ROOT / "fb"
JOINTS: Final = (1, 2, 3)
Array = npt.NDArray[np.float64]
DEPLOYED: Final = ControlSettings(law=APPLICATION_LAW)
"""The settings of the program as it is drawn, and of a run for which nothing else is asked."""
THESIS: Final = ControlSettings(law="computed_torque").inputs()
"""Inputs of the application for the thesis's law, gains and paths."""


def triple(prefix: str, values: Iterable[float]) -> dict[str, float]:
    """Values for the three inputs that begin with prefix."""
    return {f"{prefix}{joint}": float(value) for joint, value in zip(JOINTS, values, strict=True)}


def to(destination: str) -> dict[str, Any]:
    """Values for the inputs of PATH_PLANNER that name a destination, and say where it is if it is a usual place."""
    place = DEFAULT_TASK.all_places.get(destination)
    return {
        "DESTINATION": destination,
        "GIVEN": place is not None,
        **triple("GOAL", place.theta if place else (0.0, 0.0, 0.0)),
    }


class Driven:
    """One block of the library, each event input fed and each event output watched from outside."""

    def __init__(self, type_name: str, **parameters: Any) -> None:
        library = Library([FOLDER])
        ports = library.find(type_name).interface
        self.events: list[str] = []
        outer = {f"IN_{event.name}": "SUBSCRIBE_0" for event in ports.event_inputs}
        outer |= {f"OUT_{event.name}": "PUBLISH_0" for event in ports.event_outputs}
        blocks = [model.Block("START", "E_RESTART"), model.Block("DUT", type_name)]
        wires = [model.Connection("START.COLD", f"{name}.INIT") for name in outer]
        wires += [model.Connection(f"IN_{e.name}.IND", f"DUT.{e.name}") for e in ports.event_inputs]
        wires += [model.Connection(f"DUT.{e.name}", f"OUT_{e.name}.REQ") for e in ports.event_outputs]
        for name, kind in outer.items():
            given = (model.Parameter("QI", "TRUE"), model.Parameter("ID", f"'{name}'"))
            blocks.append(model.Block(name, kind, given))
        self.resource = Resource(model.FBNetwork(tuple(blocks), (), tuple(wires)), library)
        for event in ports.event_outputs:
            self.resource.port(f"OUT_{event.name}").attach(self._recorder(event.name))
        self.resource.start()
        if "INIT" in {event.name for event in ports.event_inputs}:
            assert self.fire("INIT", **parameters)[-1] == "INITO"

    def _recorder(self, event: str) -> Callable[[tuple[Any, ...]], None]:
        return lambda _: self.events.append(event)

    def fire(self, event: str, **inputs: Any) -> list[str]:
        """Sets inputs, issues an event, and gives the events that come out."""
        for name, value in inputs.items():
            self.resource.write(f"DUT.{name}", value)
        self.events.clear()
        self.resource.port(f"IN_{event}").deliver(())
        self.resource.run_until_idle()
        return list(self.events)

    def __getitem__(self, variable: str) -> Any:
        return self.resource.read(f"DUT.{variable}")

    def triple(self, prefix: str) -> Array:
        """The three variables that begin with prefix."""
        return np.array([self[f"{prefix}{joint}"] for joint in JOINTS])


class Application:
    """The whole application; every tick goes through its EMULATOR block."""

    def __init__(self, writes: Mapping[str, Any] | None = None) -> None:
        library = Library([FOLDER])
        system = library.load_system(FOLDER / "dtwin.sys")
        self.resource = Resource(resource_network(system), library)
        for name, value in (writes or {}).items():
            self.resource.write(name, value)
        self._exchange = self.resource.server("EMULATOR").exchange
        self.resource.start()

    def tick(self, theta: Sequence[float], gripper: float = 0.9, box: str = "") -> tuple[Any, ...]:
        """What the application answers to a sample; box is the colour of a waiting box."""
        return self._exchange((*map(float, theta), gripper, bool(box), box))

    def send(self, port: str, *values: Any) -> None:
        """What a client of the twin's port sends."""
        self.resource.port(port).deliver(values)
        self.resource.run_until_idle()

    def received(self, port: str) -> list[tuple[Any, ...]]:
        """What a client of the twin's port gets, from now on."""
        values: list[tuple[Any, ...]] = []
        self.resource.port(port).attach(values.append)
        return values


def step(state: Array, volts: Sequence[float], payload: float = 0.0) -> Array:
    """The state of the true arm 10 ms later."""
    return rollout(ArmParameters(), state, np.array([volts]), payload)[1]
