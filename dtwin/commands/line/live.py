"""What is said to a running line: `dtwin line status`, `dtwin line settle`, `dtwin line release`, `dtwin line setup`
and `dtwin line fault`."""

from __future__ import annotations

import getpass
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

import tyro

from dtwin.bus.line.messages import LineState, SetUpDone, SetUpRequest, StationWord
from dtwin.bus.line.topics import LINE_RELEASE, LINE_SETTLE, LINE_STATE, SET_UP
from dtwin.bus.messages import FAULT, Done, FaultRequest
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import ParameterError, choices
from dtwin.services.runfile import join_line
from dtwin.terminal import print_json, printable

NAME: Final = "line"


@dataclass(frozen=True, kw_only=True)
class _AtLine:
    """The line that is meant."""

    name: str = NAME
    """Name of the line."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a line on another machine."""

    def joined(self) -> Bus:
        """Its bus. Raises CommunicationError when it is not up."""
        return join_line(self.name, self.zenoh)


@dataclass(frozen=True, kw_only=True)
class LineStatus(_AtLine):
    """Show how a running line does: stations, vehicles, what its twins have decided, and what waits for a person."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        with self.joined() as bus:
            state = bus.ask(LINE_STATE, None, LineState)
        if self.json:
            print_json(state)
        else:
            show(state)
        return 0


@dataclass(frozen=True, kw_only=True)
class _Word(_AtLine):
    """A word about the arm of a station."""

    topic: ClassVar[Topic]

    station: tyro.conf.Positional[str]
    """Name of the station."""
    why: str = "by hand"
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""

    def execute(self) -> int:
        with self.joined() as bus:
            word = StationWord(self.who or getpass.getuser(), self.why, self.station)
            show(bus.ask(self.topic, word, LineState))
        return 0


@dataclass(frozen=True, kw_only=True)
class LineSettle(_Word):
    """Have the arm of a station work with the settings that its twin has found, as it proposes. One that is stopped
    is released with them, if its twin says that it can work then."""

    topic: ClassVar = LINE_SETTLE


@dataclass(frozen=True, kw_only=True)
class LineRelease(_Word):
    """Let the stopped arm of a station move again, as one that is repaired, and give an arm that works with other
    settings its own; its work comes back."""

    topic: ClassVar = LINE_RELEASE


@dataclass(frozen=True, kw_only=True)
class LineFault(_AtLine):
    """Let a fault happen to the emulated arm of a station of a running line."""

    station: tyro.conf.Positional[str]
    """Name of the station."""
    fault: tyro.conf.Positional[str]
    """TARGET OP VALUE [@ START[-END]], e.g. K2*=0.1; without a start it begins now."""

    def execute(self) -> int:
        with self.joined() as bus:
            names = [station.name for station in bus.ask(LINE_STATE, None, LineState).stations]
            if self.station not in names:
                raise ParameterError(f"station: expected {choices(names)}, got {self.station!r}")
            done = bus.beside(self.station).ask(FAULT, FaultRequest((self.fault,)), Done)
        print(printable(f"{done.time:.2f} s: {self.station}: {done.text}"))
        return 0


@dataclass(frozen=True, kw_only=True)
class LineSetUp(_AtLine):
    """Have other stations do operations from now on, if the twins and the zones let it pass."""

    changes: tyro.conf.Positional[tuple[str, ...]]
    """OPERATION=STATION, such as mark=a1, or mark.light=a1 for boxes of a class; repeatable."""
    why: str = "by hand"
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""

    def execute(self) -> int:
        pairs = [each.partition("=") for each in self.changes]
        if not pairs or not all(station for _, _, station in pairs):
            raise ParameterError(f"changes: expected OPERATION=STATION, such as mark=a1, got {list(self.changes)}")
        changes = {operation: station for operation, _, station in pairs}
        with self.joined() as bus:
            seen = bus.ask(LINE_STATE, None, LineState).version
            asked = SetUpRequest(self.who or getpass.getuser(), self.why, seen, changes)
            done = bus.ask(SET_UP, asked, SetUpDone)
        for line in done.effect.difference:
            print(printable(line))
        print(f"set-up {done.version}: {done.effect.rate:.1f} boxes/h expected, before {done.effect.rate_now:.1f}")
        return 0


def show(state: LineState) -> None:
    """Prints how a line does."""
    rate = f"{state.rate:.1f} boxes/h" if state.rate else "no rate yet"
    print(printable(f"{state.name}: {state.time:.1f} s, {state.left} of {state.entered} boxes left, {rate}"))
    print(printable(f"set-up {state.version}: {', '.join(f'{name} at {at}' for name, at in state.set_up.items())}"))
    for station in state.stations:
        box = f" box {station.box}" if station.box else ""
        box += f", with {station.settings}" if station.settings else ""
        print(printable(f"  {station.name}: {station.doing}{box}; can do {station.ability}: {station.why}"))
    for vehicle in state.vehicles:
        box = f" with box {vehicle.box}" if vehicle.box else ""
        trouble = f"; no orders: {vehicle.trouble}" if vehicle.trouble else ""
        print(printable(f"  {vehicle.name}: {vehicle.doing}{box}, {vehicle.battery:.0f} %{trouble}"))
    for each in state.decisions:
        print(printable(f"{each.time:8.1f} s  {each.who}: {each.what}: {each.why}"))
