"""`dtwin line up`: a line that runs and can be asked; `dtwin line status` and `dtwin line release`."""

from __future__ import annotations

import getpass
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import tyro

from dtwin.bus.line.messages import LineState, SetUpDone, SetUpRequest, StationWord
from dtwin.bus.messages import LINE_RELEASE, LINE_STATE, SET_UP
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY, new_key
from dtwin.commands.line.run import LONGEST, fault_of
from dtwin.commands.live.up import detached
from dtwin.console.people.desk import keep_zone_desks
from dtwin.controller.runtime import RuntimeOption, chosen
from dtwin.errors import ParameterError
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.live.asked import AskedRun
from dtwin.line.live.seen import state_of
from dtwin.line.live.serving import LiveLine
from dtwin.line.run import LineSettings, Mode
from dtwin.services import runfile
from dtwin.services.runfile import LINE, RunFile, join_line
from dtwin.services.service import Link, Service, free_port
from dtwin.simulation.proposals.book import Book
from dtwin.terminal import print_json, printable

HISTORY: Final = Path("line-history.jsonl")
NAME: Final = "line"
_PREPARING: Final = "the twins, which find out what every way to share out the work brings"


@dataclass(frozen=True, kw_only=True)
class LineUp(RuntimeOption):
    """Run a production line that can be asked: people, twins and an AI see it, propose set-ups and approve them.

    It is in one process, and joined like a cell, with signed messages.
    """

    line: tyro.conf.Positional[str] = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines, such as default; docs/line.md explains it."""
    name: str = NAME
    """Name of the line, by which it is joined."""
    pace: Literal["realtime", "lockstep"] = "realtime"
    """realtime, or lockstep: as fast as it goes."""
    duration: float = 3600.0
    """Plant time, s; the logs of all stations stay in memory until then."""
    fault: tuple[str, ...] = ()
    """A fault of the arm of a station, as STATION:FAULT, such as a2:K2*=0.1@122-270; repeatable. When one that ends
    is over, the arm counts as repaired and is released."""
    twins: Mode = "propose"
    """What the twins do with what they decide: propose it to people, act, or off."""
    history: Path = HISTORY
    """File that every decision is appended to; the proposals lie beside it."""
    zenoh: Path | None = None
    """Zenoh configuration file, or a folder with line.json5; else a peer on this machine."""
    detach: bool = False
    """Return when it is ready, and leave the line running."""
    json: bool = False
    """Print one JSON object at the end and nothing else."""

    def execute(self) -> int:
        if not 1.0 <= self.duration <= LONGEST:
            raise ParameterError(f"--duration: expected 1 to {LONGEST:g} s, got {self.duration:g}")
        settings = LineSettings(self.duration, self.twins, tuple(map(fault_of, self.fault)))
        if self.detach:
            line_of(self.line)
            detached(self.name, "line")
            print(f"line {self.name!r} is up: see it with `dtwin line status`, stop it with `dtwin down --cell NAME`")
            return 0
        with chosen(self.runtime):
            state = self._run(settings)
        if self.json:
            print_json(state)
        else:
            _show(state)
        return int(state.lost > 0 or state.collisions > 0)

    def _run(self, settings: LineSettings) -> LineState:
        """Runs it to its end, or until somebody ends it; how it was then."""
        line = line_of(self.line)
        book = Book(self.history.with_name(f"{self.history.stem}-proposals.jsonl"))
        meet, key = f"tcp/127.0.0.1:{free_port()}", new_key()
        zenoh = None if self.zenoh is None else self.zenoh.resolve()
        with RunFile(self.name) as file:
            file.write_key(key)
            up = runfile.Up(os.getpid(), LINE, meet, None if zenoh is None else str(zenoh), "", progress=_PREPARING)
            file.write(up)
            os.environ[KEY] = key.hex()
            with Service(NAME, Link(cell=self.name, arm=LINE, zenoh=zenoh, meet=meet)) as service:
                with service.interruptible():
                    run = AskedRun(line, settings, self.history)
                    run.prepare()
                live = LiveLine(run, book, service.bus, time.monotonic)
                keep_zone_desks(service.bus, [zone.name for zone in line.zones])
                service.ready()
                file.write(runfile.ready(up))

                def report() -> None:
                    if service.report_due():
                        service.report("running", round(10 * run.time), time=run.time, late_ticks=live.late)

                live.run(self.pace == "realtime", lambda: service.stopping, report)
                live.serve()
            return state_of(run, live.late)


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
            _show(state)
        return 0


@dataclass(frozen=True, kw_only=True)
class LineRelease(_AtLine):
    """Let the stopped arm of a station move again, as one that is repaired; its work comes back."""

    station: tyro.conf.Positional[str]
    """Name of the station."""
    why: str = "by hand"
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""

    def execute(self) -> int:
        with self.joined() as bus:
            word = StationWord(self.who or getpass.getuser(), self.why, self.station)
            _show(bus.ask(LINE_RELEASE, word, LineState))
        return 0


@dataclass(frozen=True, kw_only=True)
class LineSetUp(_AtLine):
    """Have other stations do operations from now on, if the twins and the zones let it pass."""

    changes: tyro.conf.Positional[tuple[str, ...]]
    """OPERATION=STATION, such as mark=a1; repeatable."""
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


def _show(state: LineState) -> None:
    rate = f"{state.rate:.1f} boxes/h" if state.rate else "no rate yet"
    print(printable(f"{state.name}: {state.time:.1f} s, {state.left} of {state.entered} boxes left, {rate}"))
    print(printable(f"set-up {state.version}: {', '.join(f'{name} at {at}' for name, at in state.set_up.items())}"))
    for station in state.stations:
        box = f" box {station.box}" if station.box else ""
        print(printable(f"  {station.name}: {station.doing}{box}; can do {station.ability}: {station.why}"))
    for vehicle in state.vehicles:
        box = f" with box {vehicle.box}" if vehicle.box else ""
        print(printable(f"  {vehicle.name}: {vehicle.doing}{box}, {vehicle.battery:.0f} %"))
    for each in state.decisions:
        print(printable(f"{each.time:8.1f} s  {each.who}: {each.what}: {each.why}"))
