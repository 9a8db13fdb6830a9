"""Answers what the monitor finds: proposes measures to people, or takes them itself, as it is told to.

What the table of answers says is done through the doors that people have: identification, uploads on trial, stop.
A finding that stops the arm waits for nobody.
"""

from __future__ import annotations

import contextlib
import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeVar

from dtwin.bus.messages import ANSWER, Done
from dtwin.bus.proposals.messages import AnswerRequest
from dtwin.bus.twin_messages import MonitoringVerdict, Upload
from dtwin.errors import CommunicationError, ParameterError
from dtwin.identification.machine.record import MachineRecord, read_record
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.recovery.desk import CriticalFinding, DeadlinePassed, Desk, StoppedByController
from dtwin.recovery.margins import control_settings, gains_with_margins
from dtwin.recovery.measures import SAME, Measures
from dtwin.recovery.modes import RecoveryMode
from dtwin.recovery.operator import Operator
from dtwin.recovery.proposals import NAME, Proposals
from dtwin.recovery.strength import holding
from dtwin.run.options import CellFileOption
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.service import Link, Service, main
from dtwin.simulation.proposal import controllable

log = logging.getLogger(__name__)

T = TypeVar("T")
RETRY: Final = 0.2
"""Time between two attempts to reach the other services, s."""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Answer the findings of the monitor of a running cell."""

    mode: RecoveryMode = "propose"
    """propose (a person approves) or act."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote."""

    def run(self) -> int:
        record = None if self.commissioned is None else read_record(self.commissioned)
        with Service(NAME, self) as service:
            Recovery(service, self, record).run()
        return 0


class Recovery:
    """Recovery at a cell, one answer after another.

    Args:
        service: frame of the service.
        options: its options.
        record: record of the healthy arm; None for an arm that obeys the equations of motion.
    """

    def __init__(self, service: Service, options: Options, record: MachineRecord | None) -> None:
        self._service = service
        self._record = record
        self._task = options.task()
        self._acts = options.mode == "act"
        self._state: Literal["starting", "waiting", "running"] = "starting"
        self._answered = 0
        self._desk = Desk(service.bus, self._over, lambda time: None, who=NAME)
        self._proposals = Proposals(self._desk)
        service.bus.answer(ANSWER, AnswerRequest, self._ask)

    def run(self) -> None:
        """Works until it is asked to end."""
        service, desk = self._service, self._desk
        in_force = self._reached(desk.settings)
        if in_force is None:
            return
        arm = known_arm(in_force, self._record)
        parts = (
            ("what the arm can hold", lambda: holding(arm, 0.0, self._task)),
            ("the search for settings", lambda: _rehearse(in_force, arm, self._record)),
        )
        prepare(service, parts)
        measures = Measures(desk, arm, self._record, self._task)
        if self._reached(measures.refer) is None:
            return
        propose = None if self._acts else self._proposals.propose
        operator = Operator(desk, measures, propose, lambda: self._proposals.look(operator))
        self._state = "running"
        service.ready()
        self._leave_old(operator)
        while not service.stopping:
            operator.watch()
            self._answered = len(operator.steps)
            self._await_release()

    def _ask(self, asked: AnswerRequest) -> Done:
        if self._state != "running":
            raise CommunicationError("recovery is not ready yet; try again")
        if self._desk.stopped:
            raise CommunicationError("recovery has stopped the arm: release it first")
        taken = self._proposals.request(asked)
        return Done(self._desk.time, f"proposal {taken.number} is being carried out")

    def _over(self) -> bool:
        """Whether the service shall end; reports meanwhile, since this is asked all the time."""
        if self._service.report_due():
            self._service.report(self._state, self._answered, time=self._desk.time)
        return self._service.stopping

    def _reached(self, ask: Callable[[], T]) -> T | None:
        """What others answer once they do; None when the service is asked to end before."""
        self._state = "waiting"
        while not self._service.stopping:
            try:
                return ask()
            except CommunicationError as error:
                log.info("%s", error)
                self._service.next(RETRY)
                self._over()
        return None

    def _leave_old(self, operator: Operator) -> None:
        """Leaves findings that stood before the first verdict to people: nobody knows whether they were answered."""
        with contextlib.suppress(DeadlinePassed, CriticalFinding, StoppedByController):
            for message in self._desk.messages():
                if isinstance(message, MonitoringVerdict):
                    break
        if names := operator.pass_over():
            self._desk.say(f"leaves {' and '.join(names)}, which stood before, to a person")

    def _await_release(self) -> None:
        """Waits until a stopped arm is released."""
        with contextlib.suppress(DeadlinePassed, CriticalFinding, StoppedByController):
            while self._desk.stopped:
                next(self._desk.messages())


def known_arm(in_force: Upload, record: MachineRecord | None) -> ArmParameters:
    """The arm as it is known: as recorded but for what the controller's model was given since; else that model."""
    if record is None:
        return in_force.model
    healthy = controllable(record)
    changed = {
        name: value
        for name in PARAMETER_NAMES
        if abs((value := in_force.model.get(name)) - healthy.get(name)) > SAME * abs(healthy.get(name))
    }
    return record.arm.with_values(changed)


def _rehearse(in_force: Upload, arm: ArmParameters, record: MachineRecord | None) -> None:
    with contextlib.suppress(ParameterError):  # An arm without margins needs the same kernels.
        gains_with_margins(control_settings(in_force, record), arm, record, 0.0)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
