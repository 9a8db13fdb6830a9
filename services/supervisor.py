"""Keeps the services of a cell running: starts them in order, restarts what dies, gathers what they say.

The children hold one end of a pipe: when the supervisor goes, in whatever way, they notice and end.
`dtwin.services.parts.processes` says how their processes are made.
"""

from __future__ import annotations

import re
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from dtwin.bus.chain.messages import JointTicks
from dtwin.bus.messages import (
    EVENTS,
    JOINT_TICKS,
    MONITORING,
    REMEMBERED,
    STATUS,
    SUMMARY,
    TICKS,
    PassedTicks,
    ServiceSummary,
    Status,
    Summary,
    SummaryRequest,
)
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.bus.verdicts.opinion import Opinion, is_known
from dtwin.errors import CommunicationError
from dtwin.services.parts.processes.starter import Process, Starter
from dtwin.signals import Event

LIFELINE: Final = "DTWIN_LIFELINE"
"""Environment variable of the children: the descriptor that is at its end when the supervisor has gone."""
PREPARED: Final = "DTWIN_PREPARED"
"""Environment variable of a child that starts again: what it needs was compiled by an earlier one."""
AGAIN: Final = 75
"""Exit status of a service that has compiled what it needs, and starts again without the memory of the compiler."""
FIRST_DELAY: Final = 0.1
"""s before the first restart; every further one waits twice as long"""
LAST_DELAY: Final = 8.0
"""s, longest"""
SETTLED: Final = 30.0
"""s of life after which a service's restarts start from the first delay again"""
SILENT: Final = 3.0
"""s without a status after which a service that runs counts as silent"""
STOP_TIMEOUT: Final = 8.0
"""s to end in, then killed"""
_ANSI: Final = re.compile(r"\x1b\[[0-9;]*m")
_BAD_OPTIONS: Final = 2
"""Exit status of a service that will not start however often one tries"""


@dataclass(frozen=True)
class Program:
    """A service: its name, the command that runs it, and whether the cell's run is over when it ends by itself."""

    name: str
    command: Sequence[str]
    leading: bool = False


class _Child:
    """One service's process and what is known of it."""

    def __init__(self, program: Program, starter: Starter, key: bytes) -> None:
        self.program = program
        self._key = key
        self.restarts = 0
        self.status: Status | None = None
        self.heard = 0.0
        self.alive = False
        self.arrived = False
        self._prepared = False
        self.done = False
        self._starter = starter
        self._said: deque[str] = deque(maxlen=20)
        self._process: Process | None = None
        self._delay = FIRST_DELAY
        self._born = 0.0
        self._start_at = 0.0
        self.end = ""

    @property
    def running(self) -> bool:
        return self._process is not None

    def start(self) -> None:
        self._prepared |= self.arrived
        self._process = self._starter.start(
            self.program.command,
            {
                LIFELINE: str(self._starter.lifeline),
                KEY: self._key.hex(),
                **({PREPARED: "1"} if self._prepared else {}),
            },
        )
        self._born = self.heard = time.monotonic()
        self.arrived = False
        threading.Thread(target=self._listen, args=(self._process,), daemon=True).start()

    def look(self) -> None:
        """Notices the end of the process, and starts it again when it is time."""
        now = time.monotonic()
        if self._process is None:
            if not self.done and now >= self._start_at:
                self.restarts += 1
                self.start()
            return
        code = self._process.poll()
        if code is None:
            return
        self._process = None
        self.alive = False
        if code == AGAIN and not self._prepared:
            self._prepared = True
            self.start()
            return
        if code == 0 and self.program.leading:
            self.done = True
            return
        reason = f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with status {code}"
        self.end = f"{reason}: {self.last_words}" if code > 0 and self.last_words else reason
        if now - self._born > SETTLED:
            self._delay = FIRST_DELAY
        self._start_at = now + self._delay
        self._delay = min(2 * self._delay, LAST_DELAY)
        if code == _BAD_OPTIONS and self.restarts == 0 and self.status is None:
            raise CommunicationError(f"{self.program.name} cannot run: {self.last_words or reason}")

    @property
    def last_words(self) -> str:
        """The last line on its standard error."""
        return self._said[-1] if self._said else ""

    @property
    def doing(self) -> str:
        """What it says of how far it is, while it is not ready."""
        status, process = self.status, self._process
        if status is None or process is None or status.pid != process.pid or self.arrived:
            return ""
        return status.doing

    def send(self, number: int) -> None:
        if self._process is not None:
            self._process.send_signal(number)

    def stop(self) -> None:
        """Ends the process, by force if it does not end by itself."""
        self.done = True
        if self._process is None:
            return
        self._process.send_signal(signal.SIGTERM)
        self._process.send_signal(signal.SIGCONT)
        try:
            self._process.wait(STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process = None

    def summary(self) -> ServiceSummary:
        now = time.monotonic()
        status = self.status
        if self._process is None:
            wait = max(0.0, self._start_at - now)
            return ServiceSummary("ended" if self.done else "dead", 0.0, self.restarts, _wait(self.end, wait))
        if now - self._born > SETTLED and self.alive:
            self.end = ""
        error = (status.last_error if status else "") or self.end
        if not self.arrived:
            return ServiceSummary("starting", 0.0, self.restarts, error, self.doing)
        if not self.alive:
            return ServiceSummary("stopping", 0.0, self.restarts, error)
        if now - self.heard > SILENT:
            silence = f"no status for {now - self.heard:.0f} s" + (f"; {error}" if error else "")
            return ServiceSummary("silent", 0.0, self.restarts, silence)
        if status is None or status.state == "starting":
            # It has shown its token since, so it is ready; the next status says so within a second.
            return ServiceSummary("running", 0.0, self.restarts, error)
        return ServiceSummary(status.state, status.rate_hz, self.restarts, error)

    def _listen(self, process: Process) -> None:
        assert process.stderr is not None
        with process.stderr:
            for line in process.stderr:
                text = _ANSI.sub("", line).strip().removeprefix(f"{self.program.name}: ")[:1000]
                if text:
                    self._said.append(text)


class Supervisor:
    """Runs programs and answers for them on the bus.

    Args:
        bus: is watched for tokens and statuses.
        programs: The services, in the order in which they are started.
        key: The secret with which the services of this cell sign what they say.
        starter: starts their processes, and is closed when they have been stopped; a new one if not given.
    """

    def __init__(self, bus: Bus, programs: Iterable[Program], key: bytes, starter: Starter | None = None) -> None:
        self._starter = Starter() if starter is None else starter
        self._children = {program.name: _Child(program, self._starter, key) for program in programs}
        bus.watch_alive(self._note_token)
        self._opinion = Opinion()
        self._events: deque[Event] = deque(maxlen=REMEMBERED)
        bus.subscribe(STATUS, Status, self._note_status)
        bus.subscribe(EVENTS, Event, self._note_event)
        if MONITORING.sender in self._children:
            bus.subscribe(MONITORING, MonitoringVerdict, self._note_verdict)
            bus.subscribe(TICKS, PassedTicks, self._note_ticks)
            bus.subscribe(JOINT_TICKS, JointTicks, self._note_ticks)
        bus.answer(SUMMARY, SummaryRequest, None, self.summary)

    def start(self) -> None:
        """Starts all programs."""
        for child in self._children.values():
            child.start()

    def look(self) -> None:
        """Restarts what has died; it must be called several times a second.

        Raises:
            CommunicationError: a program refuses its options.
        """
        for child in self._children.values():
            child.look()

    @property
    def ready(self) -> bool:
        """Whether all programs have shown their tokens."""
        return all(child.alive for child in self._children.values())

    @property
    def progress(self) -> str:
        """How far the programs are that are not ready, in words; another text means that they have got on."""
        waiting = [child for child in self._children.values() if not child.alive]
        return "; ".join(f"{child.program.name} {child.doing or 'starts'}" for child in waiting)

    @property
    def finished(self) -> bool:
        """Whether a leading program has ended well."""
        return any(child.done and child.program.leading for child in self._children.values())

    def missing(self) -> str:
        """Who has not shown a token, and why not if it said so."""
        waiting = [child for child in self._children.values() if not child.alive]
        return "; ".join(
            f"{child.program.name} ({child.last_words or child.end or 'says nothing'})" for child in waiting
        )

    def stop(self) -> None:
        """Ends all programs, last started first."""
        for child in reversed(self._children.values()):
            child.stop()
        self._starter.close()

    def summary(self) -> Summary:
        """How everything does."""
        services = {name: child.summary() for name, child in self._children.items()}
        events = tuple(self._events)
        last = events[-1] if events else None
        leading = [child.status for child in self._children.values() if child.program.leading and child.status]
        if not leading:
            return Summary(services, verdict=self._verdict(), last_event=last, events=events)
        status = leading[0]
        return Summary(
            services,
            status.ticks,
            status.late_ticks,
            status.latency_ms,
            status.real_time_factor,
            status.boxes,
            self._verdict(),
            last,
            events,
        )

    def _verdict(self) -> str:
        """What the monitor thinks of the arm now, in words; "" in a cell without one."""
        monitor = self._children.get(MONITORING.sender)
        if monitor is None:
            return ""
        if monitor.alive and monitor.status is not None and monitor.status.state == "off":
            return "off: the monitor was switched off"
        return in_words(self._opinion.current(time.monotonic()))[:1000]

    def _note_token(self, name: str, alive: bool) -> None:
        if name in self._children:
            self._children[name].alive = alive
            self._children[name].arrived |= alive
            self._children[name].heard = time.monotonic()

    def _note_status(self, status: Status) -> None:
        child = self._children.get(status.service)
        if child is not None:
            child.status = status
            child.heard = time.monotonic()

    def _note_event(self, event: Event) -> None:
        self._events.append(event)

    def _note_verdict(self, verdict: MonitoringVerdict) -> None:
        self._opinion.update(verdict, time.monotonic())

    def _note_ticks(self, passed: PassedTicks | JointTicks) -> None:
        self._opinion.sample(passed.ticks[-1].sensors.time, time.monotonic())


def in_words(verdict: MonitoringVerdict) -> str:
    """What a monitor thinks of the arm, in one line: what is wrong with every unit that is not nominal."""
    if not is_known(verdict):
        return "unknown: the monitor is silent"
    units = {name: unit for name, unit in verdict.units.items() if unit.state != "nominal"}
    first, *others = verdict.units.values()
    if others and first.state != "nominal" and all(unit == first for unit in others):
        return f"{first.state}, {first.text}"
    wrong = (f"{name} {unit.state}" + (f", {unit.text}" if unit.text else "") for name, unit in units.items())
    return "; ".join(wrong) or "nominal"


def _wait(reason: str, seconds: float) -> str:
    return f"{reason}; starts again in {seconds:.1f} s" if seconds else reason
