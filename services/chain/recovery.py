"""Answers what the monitor of an arm of n joints has found: by what its blocks shall count on, or by a stop.

dtwin/recovery/chain/answers.py says what follows from what. A finding that could not be answered, because nobody
listens at the moment, is answered with one of the next verdicts.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from dtwin.arm.adjustment import Adjustment
from dtwin.bus.chain.messages import JointAdjustment
from dtwin.bus.messages import ADJUSTMENT, EVENTS, MONITORING, STOP, StopRequest, StopState
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict
from dtwin.errors import CommunicationError
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.recovery.chain.answers import Answer, answer_to
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.service import Link, Service, main
from dtwin.signals import ArmState, Event, EventKind

log = logging.getLogger(__name__)

NAME: Final = "recovery"
WAIT: Final = 0.2
"""Longest wait for a verdict before the status is looked after, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Answer the findings of the monitor of an arm."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            ArmRecovery(service, settings).run()
        return 0


class ArmRecovery:
    """Recovery at a cell, one answer after another.

    Args:
        service: frame of the service.
        settings: run of the arm.
    """

    def __init__(self, service: Service, settings: ChainSettings) -> None:
        self._service = service
        self._arm = settings.arm
        self._answered: set[tuple[str, float]] = set()
        self._time = 0.0
        self._tell: Callable[[Event], None] = service.bus.publisher(EVENTS)
        service.bus.subscribe(MONITORING, MonitoringVerdict, service.inbox.put)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        while not service.stopping:
            verdict = service.next(WAIT)
            if verdict is not None:
                self._hear(verdict)
            if service.report_due():
                service.report("running", len(self._answered), time=self._time)

    def _hear(self, verdict: MonitoringVerdict) -> None:
        if verdict.time < self._time:  # another run's findings have the times of this one
            self._answered.clear()
        self._time = verdict.time
        for unit in verdict.findings:
            key = unit.parameter, unit.detected
            if not unit.settled or key in self._answered:
                continue
            try:
                self._answer(unit)
            except CommunicationError as error:
                log.warning("%s: %s", unit.text, error)
                return
            self._answered.add(key)

    def _answer(self, unit: MonitoredUnit) -> None:
        """Gives the answer to a finding.

        Raises:
            CommunicationError: the bridge does not answer, or refuses.
        """
        bus = self._service.bus
        size = -unit.size if unit.parameter.startswith("K") else unit.size
        found = ChainFinding(unit.detected, unit.parameter, size, (), unit.confidence)
        now = bus.ask(ADJUSTMENT, None, JointAdjustment)
        answer = answer_to(found, self._arm, Adjustment(now.offset, now.strength, now.friction, now.load))
        if answer.measure == "stop":
            state: ArmState = "angles unknown" if found.angles_unknown else "failed"
            stop = bus.ask(STOP, StopRequest(NAME, answer.text[:1000], state, 1.0), StopState)
            self._say(EventKind.HELP, f"{answer.text}; the blocks answer {stop.stop}")
        else:
            if answer.adjustment is not None:
                self._adjust(answer, answer.adjustment)
            self._say(EventKind.RECOVERY, answer.text)

    def _adjust(self, answer: Answer, wished: Adjustment) -> None:
        message = JointAdjustment(
            NAME, answer.text[:1000], wished.offset, wished.strength, wished.friction, wished.load
        )
        self._service.bus.ask(ADJUSTMENT, message, JointAdjustment)

    def _say(self, kind: EventKind, text: str) -> None:
        log.warning("%s", text)
        self._tell(Event(self._time, kind, text[:1000]))


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
