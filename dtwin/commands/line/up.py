"""`dtwin line up`: a line that runs and can be asked."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import tyro

from dtwin.bus.line.messages import LineState
from dtwin.bus.line.topics import LINE_STATE
from dtwin.bus.signature import KEY, new_key
from dtwin.commands.line.live import NAME, show
from dtwin.commands.line.run import LONGEST
from dtwin.commands.live.up import Display, Lines, detached
from dtwin.console.people.desk import keep_zone_desks
from dtwin.controller.runtime import RuntimeOption, chosen
from dtwin.errors import ParameterError
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.live.serving import LiveLine
from dtwin.line.records.kept import kept, prepare, write
from dtwin.line.records.tables import write_tables
from dtwin.line.run import LineRun, LineSettings, fault_of
from dtwin.line.twins.decisions import Mode
from dtwin.services import runfile
from dtwin.services.line.launching import launched_line
from dtwin.services.line.overall import HISTORY
from dtwin.services.parts.launched import LOOK
from dtwin.services.runfile import LINE, RunFile
from dtwin.services.service import Link, Service, free_port
from dtwin.simulation.proposals.book import Book
from dtwin.terminal import print_json

_LOCKSTEP: Final = 3600.0
"""Plant time of a run in lockstep without --duration, s."""
_PREPARING: Final = "the twins, which find out what every way to share out the work brings"


@dataclass(frozen=True, kw_only=True)
class LineUp(RuntimeOption):
    """Run a production line that can be asked: people, twins and an AI see it, propose set-ups and approve them.

    Its plant, the twin of each zone and the twin of the line are processes, joined like a cell, with signed messages;
    what dies is started again. In lockstep all is in one process.
    """

    line: tyro.conf.Positional[str] = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines, such as default; docs/line.md explains it."""
    name: str = NAME
    """Name of the line, by which it is joined."""
    pace: Literal["realtime", "lockstep"] = "realtime"
    """realtime, or lockstep: as fast as it goes, for an hour if --duration says nothing."""
    duration: float | None = None
    """Plant time, s; until it is stopped if not given."""
    fault: tuple[str, ...] = ()
    """A fault of the arm of a station, as STATION:FAULT, such as a2:K2*=0.1@122-270; repeatable. When one that ends
    is over, the arm counts as repaired and is released."""
    twins: Mode = "propose"
    """What the twins do with what they decide: propose it to people, act, or off."""
    served: bool = False
    """The blocks are served elsewhere, such as by `dtwin fb run --all fb/line/line.sys`."""
    host: tuple[str, ...] = ()
    """A process that runs on this machine: plant, overall, or zone-NAME; repeatable, all if not given. The machines
    of a line need --zenoh and the same key in DTWIN_KEY."""
    console: bool = False
    """Start the operators' console too: a web page of the line on this machine, whose address is printed."""
    out: Path | None = None
    """New folder in which it is kept how the line goes, every five minutes and at its end, for `dtwin line report`
    and `dtwin line query`; the history lies in it, too."""
    history: Path = HISTORY
    """File that every decision is appended to; the proposals lie beside it."""
    zenoh: Path | None = None
    """Zenoh configuration file, or a folder with line.json5; else peers on this machine."""
    detach: bool = False
    """Return when it is ready, and leave the line running."""
    json: bool = False
    """Print one JSON object at the end and nothing else."""

    def execute(self) -> int:
        if self.duration is not None and not 1.0 <= self.duration <= LONGEST:
            raise ParameterError(f"--duration: expected 1 to {LONGEST:g} s, got {self.duration:g}")
        for text in self.fault:
            fault_of(text)
        if self.out is not None and self.history != HISTORY:
            raise ParameterError("--history: expected without --out, in whose folder the history lies")
        if self.pace == "lockstep" and (self.served or self.host or self.console):
            apart = "expected no --served, --host or --console, since all is in one process"
            raise ParameterError(f"--pace lockstep: {apart}")
        if self.detach:
            line_of(self.line)
            up = detached(self.name, "line")
            down = f"dtwin down --cell {self.name}"
            status = "dtwin line status" + ("" if self.name == NAME else f" --name {self.name}")
            print(f"line {self.name!r} is up: see it with `{status}`, stop it with `{down}`")
            if up.console:
                print(_at(up.console))
            return 0
        own = self if self.out is None else replace(self, history=prepare(self.out))
        if self.pace == "realtime":
            state = own._processes()
        else:
            with chosen(self.runtime):
                state = own._lockstep()
        if state is None:
            return 0
        if self.json:
            print_json(state)
        else:
            show(state)
        return int(state.lost > 0 or state.collisions > 0)

    def _processes(self) -> LineState | None:
        """Runs its processes until the end, or until somebody ends it; how it was then, None if not known here."""
        display = Display() if self.json else Lines()
        with launched_line(self) as line:
            line.await_ready(display.show)
            if line.up.console:
                display.tell(_at(line.up.console))
            while not (line.over or line.stop.wait(LOOK)):
                display.show(line.supervisor.summary())
            overall = not self.host or "overall" in self.host
            return line.bus.ask(LINE_STATE, None, LineState) if overall else None

    def _lockstep(self) -> LineState:
        """Runs it in this process to its end, or until somebody ends it; how it was then."""
        line = line_of(self.line)
        duration = _LOCKSTEP if self.duration is None else self.duration
        settings = LineSettings(duration, self.twins, tuple(map(fault_of, self.fault)))
        book = Book(self.history.with_name(f"{self.history.stem}-proposals.jsonl"))
        meet, key = f"tcp/127.0.0.1:{free_port()}", new_key()
        zenoh = None if self.zenoh is None else self.zenoh.resolve()
        with RunFile(self.name) as file:
            file.write_key(key)
            up = runfile.Up(os.getpid(), LINE, meet, None if zenoh is None else str(zenoh), "", progress=_PREPARING)
            file.write(up)
            os.environ[KEY] = key.hex()
            with Service(LINE, Link(cell=self.name, arm=LINE, zenoh=zenoh, meet=meet)) as service:
                with service.interruptible():
                    run = LineRun(line, settings, self.history)
                    run.work.prepare()
                live = LiveLine(run, book, service.bus, time.monotonic)
                keep_zone_desks(service.bus, [zone.name for zone in line.zones])
                service.ready()
                file.write(runfile.ready(up))

                def report(late: int) -> None:
                    if service.report_due():
                        service.report("running", round(10 * run.time), time=run.time, late_ticks=late)

                try:
                    live.run(False, lambda: service.stopping, report)
                    live.between.serve()
                finally:
                    if self.out is not None:
                        write(run, self.out)
                        write_tables(kept(run), self.out)
            return live.state()


def _at(address: str) -> str:
    return f"its operators' console is at {address}"
