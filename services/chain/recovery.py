"""Answers what the monitor of an arm of n joints has found: by what its blocks shall count on, or by a stop.

dtwin/recovery/chain/answers.py says what follows from what. Measures are taken at once, or proposed to a person; a
stop waits for nobody. A finding that could not be answered, because nobody listens at the moment, is answered with
one of the next verdicts.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.arm.adjustment import Adjustment
from dtwin.bus.chain.messages import JointAdjustment
from dtwin.bus.messages import ADJUSTMENT, EVENTS, MONITORING, STOP, StopRequest, StopState
from dtwin.bus.proposals.messages import Proposal
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict
from dtwin.errors import DtwinError, ParameterError
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.recovery.chain.answers import Answer, answer_to
from dtwin.recovery.modes import RecoveryMode
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.chain.proposing import Proposing
from dtwin.services.service import Link, Service, main
from dtwin.signals import ArmState, Event, EventKind

log = logging.getLogger(__name__)

NAME: Final = "recovery"
WAIT: Final = 0.2
"""Longest wait for a verdict before the status is looked after, s."""
Key = tuple[str, float]
"""What a finding names, and when it was noticed, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Answer the findings of the monitor of an arm."""

    mode: RecoveryMode = "propose"
    """propose (a person approves) or act."""
    proposals: Path = Path("arm-proposals.jsonl")
    """File of the proposals."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            ArmRecovery(service, settings, None if self.mode == "act" else self.proposals).run()
        return 0


class ArmRecovery:
    """Recovery at a cell, one answer after another.

    Args:
        service: frame of the service.
        settings: run of the arm.
        proposals: file of what is proposed to people; None where measures are taken at once.
    """

    def __init__(self, service: Service, settings: ChainSettings, proposals: Path | None) -> None:
        self._service = service
        self._arm = settings.arm
        self._answered: set[Key] = set()
        self._open: dict[int, tuple[Proposal, MonitoredUnit]] = {}
        self._time = 0.0
        self._tell: Callable[[Event], None] = service.bus.publisher(EVENTS)
        put = service.inbox.put
        self._proposing = None if proposals is None else Proposing(service.bus, proposals, lambda: self._time, put)
        service.bus.subscribe(MONITORING, MonitoringVerdict, put)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        while not service.stopping:
            item = service.next(WAIT)
            try:
                if isinstance(item, MonitoringVerdict):
                    self._on_verdict(item)
                elif isinstance(item, Proposal):
                    self._carry_out(item)
            except DtwinError as error:
                log.warning("%s", error)
            if service.report_due():
                service.report("running", len(self._answered), time=self._time)

    def _on_verdict(self, verdict: MonitoringVerdict) -> None:
        if verdict.time < self._time:  # another run's findings have the times of this one
            self._answered.clear()
        self._time = verdict.time
        self._review({_key(unit) for unit in verdict.findings})
        for unit in verdict.findings:
            if unit.settled and _key(unit) not in self._answered:
                self._answer(unit)
                self._answered.add(_key(unit))

    def _answer(self, unit: MonitoredUnit) -> None:
        """Gives the answer to a finding, or proposes it.

        Raises:
            CommunicationError: the bridge does not answer, or refuses.
            DtwinError: it cannot be proposed now.
        """
        found, answer = self._found(unit)
        if answer.measure == "stop":
            state: ArmState = "angles unknown" if found.angles_unknown else "failed"
            stop = self._service.bus.ask(STOP, StopRequest(NAME, answer.text[:1000], state, 1.0), StopState)
            self._say(EventKind.HELP, f"{answer.text}; the blocks answer {stop.stop}")
        elif answer.adjustment is None:
            self._say(EventKind.RECOVERY, answer.text)
        elif self._proposing is None:
            self._adjust(answer, answer.adjustment)
            self._say(EventKind.RECOVERY, answer.text + self._stands())
        else:
            made = self._proposing.propose(f"{answer.measure}: {answer.text}", unit.parameter)
            self._open[made.number] = made, unit
            text = f"proposal {made.number}: {answer.measure} for {unit.parameter}; `dtwin mcp approve {made.number}`"
            self._say(EventKind.PROPOSAL, text)

    def _found(self, unit: MonitoredUnit) -> tuple[ChainFinding, Answer]:
        """A finding, and what follows from it with what the blocks count on now. Raises CommunicationError."""
        found = finding_of(unit)
        now = self._service.bus.ask(ADJUSTMENT, None, JointAdjustment)
        return found, answer_to(found, self._arm, now.adjustment)

    def _carry_out(self, proposal: Proposal) -> None:
        """Does what a person has approved, if that is still what is found."""
        assert self._proposing is not None
        _, unit = self._open.pop(proposal.number, (None, None))
        try:
            if unit is None:
                raise ParameterError("it is found no more")
            _, answer = self._found(unit)
            if answer.adjustment is None:
                raise ParameterError(f"it would be too much by now: {answer.text}")
            self._adjust(answer, answer.adjustment, proposal.by)
            outcome = answer.text + self._stands()
        except DtwinError as error:
            outcome = f"not done: {error}"
        self._say(EventKind.RECOVERY, f"proposal {proposal.number}, approved by {proposal.by}: {outcome}")
        self._proposing.report(proposal, outcome)

    def _stands(self) -> str:
        """What is left to do where the arm is stopped. Raises CommunicationError."""
        stop = self._service.bus.ask(STOP, None, StopState).stop
        return "" if stop == "none" else f"; the arm is stopped ({stop}): `dtwin release` lets it move again"

    def _review(self, standing: set[Key]) -> None:
        """Takes back what is found no more, and has what nobody decided about in time proposed again."""
        for number, (proposal, unit) in list(self._open.items()):
            assert self._proposing is not None
            if _key(unit) not in standing:
                del self._open[number]
                try:
                    self._proposing.decline(proposal, "it is found no more")
                except ParameterError as error:  # A person was quicker: what was approved comes as such.
                    log.info("%s", error)
                    self._open[number] = proposal, unit
            elif self._proposing.expired(number):
                del self._open[number]
                self._answered.discard(_key(unit))

    def _adjust(self, answer: Answer, wished: Adjustment, who: str = NAME) -> None:
        self._service.bus.ask(ADJUSTMENT, JointAdjustment.of(who, answer.text, wished), JointAdjustment)

    def _say(self, kind: EventKind, text: str) -> None:
        log.warning("%s", text)
        self._tell(Event(self._time, kind, text[:1000]))


def finding_of(unit: MonitoredUnit) -> ChainFinding:
    """The finding that a unit of a verdict tells of."""
    size = -unit.size if unit.parameter.startswith("K") else unit.size
    return ChainFinding(unit.detected, unit.parameter, size, unit.others, unit.confidence)


def _key(unit: MonitoredUnit) -> Key:
    return unit.parameter, unit.detected


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
