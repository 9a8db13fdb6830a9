"""Drawn faults answered by a script with the tools of the interface alone, judged as recovery is."""

from __future__ import annotations

import threading
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import anyio
from mcp import Client

from dtwin.ai.agent import Refused, Script, caller
from dtwin.ai.answering import Answered
from dtwin.ai.profiles import Limits
from dtwin.ai.serving import Place, Served, served
from dtwin.bus.messages import EVENTS
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.errors import DtwinError
from dtwin.monitoring.kinds import PUSH
from dtwin.recovery.answers import Measure
from dtwin.recovery.desk import CriticalFinding, DeadlinePassed, Desk, StoppedByController
from dtwin.recovery.measures import Taken
from dtwin.recovery.operator import Step
from dtwin.signals import MONITOR, Event
from evidence.recovery.cases import RecoveryCase
from evidence.recovery.demonstration import LIMIT, STANDS, make_faults
from evidence.recovery.known import KnownArm
from evidence.recovery.outcome import Story

LOOK: Final = 0.1
"""Time between two looks of the script, s."""
FREELY: Final = Limits(hourly=1000, pause=0.0)
"""The limits of a run: it is to be seen whether the answers are right."""


class ByTools:
    """Plays a run with a script at the tools in the place of the operator.

    Args:
        clocks: clocks of the server.
    """

    def __init__(self, clocks: Clocks) -> None:
        self._clocks = clocks

    def __call__(self, desk: Desk, healthy: KnownArm, case: RecoveryCase) -> Story:
        """Lets the cell work, makes faults, and has the script answer them until the time is over."""
        pushes: list[Event] = []
        desk.bus.subscribe(EVENTS, Event, lambda event: pushes.append(event) if _is_push(event) else None)
        with TemporaryDirectory() as folder:
            base = Path(folder)
            files = Files(base / "store", base / "history.jsonl")
            audit, alarms = base / "audit.jsonl", base / "alarms.jsonl"
            place = Place("cell", "arm", "act", "script", files, alarms, audit, FREELY, healthy.arm)
            with served(desk.bus, place, self._clocks) as found:
                return _played(desk, found, case, pushes)


def _played(desk: Desk, found: Served, case: RecoveryCase, pushes: list[Event]) -> Story:
    assert found.answering is not None
    started = began = None
    stopped = 0.0
    trouble = ""
    try:
        started = found.answering.prepared()
        began = make_faults(desk, case)
        desk.end = began + LIMIT
        script, error = _script(desk, found, began + LIMIT)
        trouble = error
        if script.stopped:
            desk.stopped, stopped = True, desk.time
            desk.pass_time(STANDS)
    except (DtwinError, DeadlinePassed, CriticalFinding, StoppedByController) as error:
        trouble = str(error)
    answers = found.answering.answers
    stops = [Step(stopped, tuple(desk.findings) or ("stop",), "stop", Taken(None, {}))] if desk.stopped else []
    told = [Step(event.time, (PUSH,), "go on", Taken(None, {})) for event in pushes]
    steps = [*told, *filter(None, map(_step, answers)), *stops]
    units = tuple(unit for each in answers for unit in each.findings) or tuple(desk.findings.values())
    measures = found.answering.measures
    offsets = () if measures is None else tuple(measures.offsets)
    return Story(began, started, units, tuple(steps), offsets, trouble)


def _script(desk: Desk, found: Served, end: float) -> tuple[Script, str]:
    """Lets the script work in a thread of its own while the desk hears the cell."""
    made: list[Script] = []
    trouble: list[str] = []

    async def converse() -> None:
        async with Client(found.server) as client:
            script = Script(caller(client), lambda: anyio.sleep(LOOK))
            made.append(script)
            await script.act(end)

    def work() -> None:
        try:
            anyio.run(converse)
        except Refused as refusal:
            trouble.append(str(refusal))

    thread = threading.Thread(target=work, name="script")
    thread.start()
    while thread.is_alive():
        try:
            for _ in desk.messages():
                if not thread.is_alive():
                    break
        except (CriticalFinding, StoppedByController):
            continue  # The script has to see it.
        except DeadlinePassed:
            break
    thread.join()
    return made[0], trouble[0] if trouble else ""


def _step(answered: Answered) -> Step | None:
    """An answer as a step of recovery; what was given up for a stop is that stop's."""
    measure: Measure = answered.measure
    if answered.outcome == "nothing to do":
        measure = "go on"
    if answered.outcome in ("done", "nothing to do", "taken back", "too weak"):
        return Step(answered.time, answered.parameters, measure, answered.taken)
    return None


def _is_push(event: Event) -> bool:
    return event.kind == MONITOR + PUSH
