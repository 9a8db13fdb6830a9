"""What of a cell is an alarm: one table, and the messages that raise and clear what is in it.

Only what an operator has to answer is an alarm (ISA-18.2, definition of an alarm); the rest is an event. Every alarm
says what to do. While identification excites the arm, what monitoring says means nothing and is suppressed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from dtwin.bus.messages import ServiceSummary
from dtwin.bus.twin_messages import IdentificationPhase, MonitoredUnit, MonitoringVerdict
from dtwin.bus.verdicts.opinion import is_known
from dtwin.console.alarms.alarm_list import AlarmList
from dtwin.console.alarms.states import Alarm, Priority
from dtwin.controller.sequence import CALLS
from dtwin.errors import ParameterError
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.verdict import units_of
from dtwin.recovery.answers import order
from dtwin.signals import MONITOR, Event, EventKind, Stop

FINDING: Final = "finding/"
FORECAST: Final = "forecast/"
SERVICE: Final = "service/"
EXCITED: Final = "identification excites the arm"
TROUBLED: Final = ("dead", "silent")
"""States in which a service does not work and nobody has asked it to end."""
WRITTEN_AGAIN: Final = "is written again"
"""What is said of a file that could not be written before."""


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table.

    Attributes:
        priority: Urgency, from how soon something is lost if nobody answers.
        consequence: What follows if nobody answers.
        response: What the operator has to do.
    """

    priority: Priority
    consequence: str
    response: str


FAILED: Final = Row("high", "boxes are lost or something breaks", "")
DEGRADING: Final = Row("medium", "the joint may fail", "see Monitoring; have it looked at before it fails")
UNCOMMISSIONED: Final = Row("low", "findings mean nothing", "commission the arm: `dtwin commission`")
FORECASTED: Final = Row("low", "a limit will be reached", "plan the maintenance")
STOPPED: Final = Row("high", "no box is sorted", "find the cause, make the arm safe, then release the stop")
SILENT: Final = Row("high", "nobody knows what the arm does", "see to the network and the emulator or plant")
UNWATCHED: Final = Row("high", "a failure of the arm is not noticed", "see the monitor's last error; stop the arm")
MAIN_SERVICE: Final = Row("high", "the arm loses its voltage", "see the service's last error; it is started again")
OTHER_SERVICE: Final = Row("medium", "a function of the twin is missing", "see the service's last error")
ONCE: Final[dict[str, Row]] = {
    EventKind.COLLISION: Row("high", "something may be bent", "look at the arm and what it touched"),
    EventKind.MISPLACED: Row("medium", "a box lies in the way or is of another order", "put the box in its place"),
    EventKind.SLIPPED: Row("medium", "a box lies in the way", "pick up the box that was lost"),
    EventKind.DIVERGED: Row(
        "high", "the emulation began anew with the torque off", "check gains and faults, release"
    ),
    EventKind.RIVALS: Row("high", "somebody else tries to drive the arm", "find who publishes voltages"),
    EventKind.TROUBLE: Row("medium", "settings may be lost or no sample is answered", "do what the text says"),
    EventKind.JOURNAL: Row("medium", "what was set before may be lost", "check faults and settings, keep the file"),
    EventKind.ROLL_BACK: Row("medium", "uploaded settings did not hold", "see Simulation before trying others"),
    MONITOR + EventKind.STOP: Row("high", "monitoring could not stop the arm", "stop it by hand"),
}
"""By event: what is over when it is told; it stands until it is acknowledged."""
SAFE: Final = Row("high", "the arm hangs without voltage", "see to controller and bridge; it goes on by itself")
HELP: Final = Row("medium", "the sequence waits", "do what the text says")
DISK: Final = Row("medium", "what happens is not recorded", "make room on the disk")
ON_DELAY: Final = 2.0
"""Time for which a monitor is silent before that is an alarm, s (on-delay of ISA-18.2)."""
_MAIN: Final = frozenset({"emulator", "bridge", "controller"})


class Sources:
    """Passes what a cell says on to its list of alarms; times `at` are wall time, s since 1970.

    Args:
        alarms: List that is kept up to date.
    """

    def __init__(self, alarms: AlarmList) -> None:
        self._alarms = alarms
        self._unknown_since: float | None = None

    def verdict(self, verdict: MonitoringVerdict, at: float) -> None:
        """Raises what the monitor finds, and clears what it finds no more; what a silent one found stands.

        Nothing has been said of an arm that has not begun, or of a cell that was joined a moment ago. So silence is
        an alarm after ON_DELAY alone.
        """
        known = is_known(verdict)
        if known or verdict.time <= 0.0:
            self._unknown_since = None
        elif self._unknown_since is None:
            self._unknown_since = at
        silent = self._unknown_since is not None and at - self._unknown_since >= ON_DELAY
        self._condition(
            "unwatched", silent, "the monitor is silent: nothing is known of the arm", UNWATCHED, at, verdict.time
        )
        if not known:
            return
        told = [(name, unit) for name, unit in verdict.units.items() if unit.state != "nominal"]
        told += [(name, each) for each in verdict.findings for name in _units(each.parameter)]
        found = {alarm.name: alarm for alarm in (_of_finding(name, unit) for name, unit in told)}
        for text in verdict.forecasts:
            name = FORECAST + text.partition(" is ")[0][:80]
            found[name] = Alarm(name, text, FORECASTED.priority, FORECASTED.response)
        self._replace((FINDING, FORECAST), found, at, verdict.time)

    def services(self, services: Mapping[str, ServiceSummary], at: float, plant: float) -> None:
        """Raises an alarm for every service that does not work."""
        found: dict[str, Alarm] = {}
        for name, service in services.items():
            if service.state in TROUBLED:
                row = MAIN_SERVICE if name in _MAIN else OTHER_SERVICE
                why = f": {service.last_error}" if service.last_error else ""
                text = f"{name} is {service.state}{why}"
                found[SERVICE + name] = Alarm(SERVICE + name, text, row.priority, row.response)
        self._replace((SERVICE,), found, at, plant)

    def stop(self, stop: Stop, at: float, plant: float) -> None:
        """Raises an alarm while the arm is stopped."""
        self._condition("stop", stop != "none", f"the arm is stopped: {stop}", STOPPED, at, plant)

    def silence(self, silent: bool, at: float, plant: float) -> None:
        """Raises an alarm while no sample comes."""
        self._condition("silence", silent, "no sample comes from the arm", SILENT, at, plant)

    def identification(self, phase: IdentificationPhase, at: float) -> None:
        """Suppresses by design what monitoring says while the arm is excited."""
        self._alarms.suppress(FINDING, EXCITED if phase == "measuring" else "", at)

    def event(self, event: Event, at: float) -> None:
        """Raises an alarm for an event that wants an answer."""
        if row := ONCE.get(event.kind):
            name = f"event/{event.kind}"
            self._alarms.clear(name, at)
            self._condition(name, True, event.text, row, at, event.time)
            self._alarms.clear(name, at)
        elif event.kind in (EventKind.SAFE, EventKind.RESUMED):
            self._condition("safe", event.kind == EventKind.SAFE, event.text, SAFE, at, event.time)
        elif event.kind == EventKind.HELP:
            self._condition("help", event.text != CALLS[0], event.text, HELP, at, event.time)
        elif event.kind == EventKind.DISK:
            self._condition(str(event.kind), WRITTEN_AGAIN not in event.text, event.text, DISK, at, event.time)

    def _condition(self, name: str, holds: bool, text: str, row: Row, at: float, plant: float) -> None:
        if holds:
            self._alarms.raise_(name, text, at, plant, priority=row.priority, response=row.response)
        else:
            self._alarms.clear(name, at)

    def _replace(self, prefixes: tuple[str, ...], found: Mapping[str, Alarm], at: float, plant: float) -> None:
        """Makes the conditions whose names begin with a prefix those that were found."""
        for alarm in self._alarms.alarms():
            if alarm.active and alarm.name.startswith(prefixes) and alarm.name not in found:
                self._alarms.clear(alarm.name, at)
        for alarm in found.values():
            self._alarms.raise_(alarm.name, alarm.text, at, plant, priority=alarm.priority, response=alarm.response)


def _of_finding(name: str, unit: MonitoredUnit) -> Alarm:
    """The alarm for a unit that is not nominal."""
    if unit.state == "not commissioned":
        row, what = UNCOMMISSIONED, "model"
    else:
        row = FAILED if unit.state == "failed" else DEGRADING
        what = unit.parameter or unit.cause or "unknown"
    response = row.response or _order(unit.parameter)
    return Alarm(f"{FINDING}{name}/{what}"[:100], f"{name}: {unit.text}"[:1000], row.priority, response)


def _units(parameter: str) -> tuple[str, ...]:
    """The units that a finding is about."""
    try:
        return units_of(parse_fault_id(parameter))
    except ParameterError:
        return ()


def _order(parameter: str) -> str:
    """What a person has to do about a finding."""
    try:
        return order(parse_fault_id(parameter))
    except ParameterError:
        return "find out what is wrong, then `dtwin release`"


def table() -> str:
    """The table for people, as Markdown."""
    head = "| alarm | priority | if nobody answers | what to do |\n|---|---|---|---|\n"
    rows: dict[str, Row] = {
        "a joint or the gripper has failed": FAILED,
        "a joint or the gripper may be degrading": DEGRADING,
        "the model does not fit the arm": UNCOMMISSIONED,
        "a slow change will reach its limit": FORECASTED,
        "the arm is stopped": STOPPED,
        "no sample comes": SILENT,
        "the monitor is silent": UNWATCHED,
        "emulator, bridge or controller does not work": MAIN_SERVICE,
        "another service does not work": OTHER_SERVICE,
        "no command came in time": SAFE,
        "the sequence calls for help": HELP,
        "the disk is full": DISK,
        **{f"event `{kind}`": row for kind, row in ONCE.items()},
    }
    return head + "".join(
        f"| {name} | {row.priority} | {row.consequence} | {row.response or 'the order of the finding'} |\n"
        for name, row in rows.items()
    )
