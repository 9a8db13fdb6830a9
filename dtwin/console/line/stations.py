"""The arms of stations that pages look at: their readings are heard only as long as somebody does."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec

from dtwin.bus.chain.messages import JointCommands, JointSensors
from dtwin.bus.messages import JOINT_COMMANDS, JOINT_SENSORS, PATH, SENSORS, VOLTAGES, Path
from dtwin.bus.pairs import Pairs
from dtwin.bus.session import Bus, Subscription
from dtwin.console.motion import BEHIND
from dtwin.console.telling import Frame
from dtwin.signals import Sensors, Voltages


class StationFace(msgspec.Struct, frozen=True, tag_field="tell", tag="station"):
    """The arm of a station at its last sample.

    Attributes:
        name: name of the station.
        frame: the arm; without positions as long as nothing of it is heard.
    """

    name: str
    frame: Frame


@dataclass
class _Watched:
    """What is heard of one arm: of the usual one, or of one of another kind."""

    subscriptions: list[Subscription]
    sensors: Sensors | None = None
    acted: Voltages | None = None
    heard: tuple[float, float] = (0.0, 0.0)
    pairs: Pairs[Sensors, Path] = field(default_factory=Pairs)
    on_path: tuple[Sensors, Path] | None = None
    joints: JointSensors | None = None
    answered: Pairs[JointSensors, JointCommands] = field(default_factory=Pairs)
    tick: tuple[JointSensors, JointCommands] | None = None


class Stations:
    """Listens to arms of stations.

    Args:
        bus: session of the line.
        steady: gives a time that only grows, s.
        wall: gives the time since 1970, s.
    """

    def __init__(self, bus: Bus, steady: Callable[[], float], wall: Callable[[], float]) -> None:
        self._bus, self._steady, self._wall = bus, steady, wall
        self._watched: dict[str, _Watched] = {}
        self._pairing = threading.Lock()

    def watch(self, names: frozenset[str]) -> None:
        """Listens to these stations and to no others."""
        for name in self._watched.keys() - names:
            for subscription in self._watched.pop(name).subscriptions:
                subscription.end()
        for name in names - self._watched.keys():
            self._watched[name] = self._listen(name)

    def face(self, name: str) -> StationFace | None:
        """What was last heard of a station's arm; None for one that is not watched."""
        found = self._watched.get(name)
        if found is None:
            return None
        newest, acted = found.sensors, found.acted
        if found.joints is not None:
            return StationFace(name, self._frame_of_joints(found, found.joints))
        if newest is None:
            return StationFace(name, Frame())
        # A position and a path of two samples would look like a distance from the path.
        both = found.on_path
        kept = both is not None and 0 <= newest.sequence - both[0].sequence < BEHIND
        sensors, path = both if both is not None and kept else (newest, None)
        return StationFace(
            name,
            Frame(
                sensors.time,
                round(max(0.0, self._steady() - found.heard[0]), 3),
                round(1e3 * found.heard[1], 1),
                sensors.theta,
                None if path is None else path.theta,
                volts=None if acted is None else acted.volts,
                gripper=sensors.gripper,
                gripped=acted is not None and acted.box_gripped,
                box=sensors.box_colour if sensors.box_present else "",
            ),
        )

    def _frame_of_joints(self, found: _Watched, newest: JointSensors) -> Frame:
        """An arm of another kind at the last sample whose answer is known, or else at its last one."""
        tick = found.tick
        kept = tick is not None and 0 <= newest.sequence - tick[0].sequence < BEHIND
        sample, command = tick if tick is not None and kept else (newest, None)
        return Frame(
            sample.time,
            round(max(0.0, self._steady() - found.heard[0]), 3),
            round(1e3 * found.heard[1], 1),
            sample.theta,
            None if command is None else command.target,
            volts=None if command is None else command.commands,
            gripped=command is not None and command.gripped,
        )

    def _listen(self, name: str) -> _Watched:
        watched, bus = _Watched([]), self._bus.beside(name)

        def take_sensors(sensors: Sensors) -> None:
            watched.sensors, watched.heard = sensors, (self._steady(), self._wall())
            with self._pairing:
                watched.on_path = watched.pairs.first(sensors) or watched.on_path

        def take_path(path: Path) -> None:
            with self._pairing:
                watched.on_path = watched.pairs.second(path) or watched.on_path

        def take_acted(acted: Voltages) -> None:
            watched.acted = acted

        def take_joints(sample: JointSensors) -> None:
            watched.joints, watched.heard = sample, (self._steady(), self._wall())
            with self._pairing:
                watched.tick = watched.answered.first(sample) or watched.tick

        def take_commands(answer: JointCommands) -> None:
            with self._pairing:
                watched.tick = watched.answered.second(answer) or watched.tick

        watched.subscriptions = [
            bus.subscribe(JOINT_SENSORS, JointSensors, take_joints),
            bus.subscribe(JOINT_COMMANDS, JointCommands, take_commands),
            bus.subscribe(SENSORS, Sensors, take_sensors),
            bus.subscribe(VOLTAGES, Voltages, take_acted),
            bus.subscribe(PATH, Path, take_path),
        ]
        return watched
