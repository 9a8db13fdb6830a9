"""Findings answered as recovery answers them, while somebody else decides which and when."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoredUnit
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.parameters import ArmParameters
from dtwin.recovery.answers import Measure, answer_to, order
from dtwin.recovery.desk import (
    CriticalFinding,
    DeadlinePassed,
    Desk,
    DoubtfulFinding,
    FindingWithdrawn,
    RolledBack,
    StoppedByController,
)
from dtwin.recovery.explanation import TooWeak
from dtwin.recovery.measures import Measures, Taken

Outcome = Literal["done", "nothing to do", "taken back", "too weak", "too doubtful", "interrupted", "failed"]
_BROKEN_OFF: Final = (CommunicationError, ParameterError, DeadlinePassed, CriticalFinding, StoppedByController)
"""What keeps an answer from beginning."""
IDLE: Final = "no answer is under way"
STOP: Final = "stop"
PASSES: Final = "go on"
STANDING: Final[tuple[Outcome, ...]] = ("too weak", "too doubtful", "interrupted")
"""Outcomes after which the arm has to be stopped, as recovery does."""


@dataclass(frozen=True)
class Answered:
    """What came of an answer.

    Attributes:
        parameters: what the findings name.
        measure: what was done.
        outcome: how it ended; too weak, too doubtful and interrupted ask for a stop.
        text: the same in words.
        time: plant time at which it was begun, s.
        findings: the findings as they were then.
        taken: what was measured and uploaded.
    """

    parameters: tuple[str, ...]
    measure: Measure
    outcome: Outcome
    text: str
    time: float
    findings: tuple[MonitoredUnit, ...] = ()
    taken: Taken = field(default_factory=lambda: Taken(None, {}))


class Answering:
    """Answers findings one after another at a desk of its own, in a thread of its own.

    Args:
        bus: session with the rights of an operator's recovery.
        healthy: the healthy arm; the model in force when None.
        who: name in the history of what is uploaded.

    Attributes:
        desk: the desk, which hears all the time.
        measures: the measures, once the first answer was begun.
        answers: what has been answered, in order.
    """

    def __init__(self, bus: Bus, healthy: ArmParameters | None, who: str) -> None:
        self._over = threading.Event()
        self.desk = Desk(bus, self._over.is_set, lambda time: None, who=who)
        self.measures: Measures | None = None
        self.answers: list[Answered] = []
        self._healthy = healthy
        self._asked: list[MonitoredUnit] = []
        self._wake = threading.Event()
        self._busy = self._preparing = False
        self._ready = threading.Event()
        self._since: float | Exception = 0.0
        self._thread = threading.Thread(target=self._work, name="answer", daemon=True)

    def start(self) -> None:
        """Begins to hear."""
        self._thread.start()

    def close(self) -> None:
        """Ends; an answer that is under way is ended at its next step."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    @property
    def busy(self) -> bool:
        """Whether an answer is under way."""
        return self._busy

    def put_into_force(self) -> None:
        """Puts the model of the healthy arm into force before anything has happened. Blocks; before `start` alone.

        Raises:
            CommunicationError: it is refused or taken back.
        """
        self._measures().put_into_force()

    def prepared(self) -> float:
        """Puts the model of the healthy arm into force in this object's thread, and waits; since when it is, s.

        Raises:
            CommunicationError: it is refused or taken back.
        """
        self._ready.clear()
        self._preparing = True
        self._wake.set()
        self._ready.wait()
        if isinstance(self._since, Exception):
            raise CommunicationError(f"cannot begin: {self._since}")
        return self._since

    def ask(self, parameters: Sequence[str]) -> Measure:
        """Has findings answered together, which takes a while; `answers` tells what came of it.

        Returns:
            the measure that is taken.

        Raises:
            ParameterError: an answer is under way, nothing is found under a name, or they ask for different measures.
        """
        if self._busy:
            raise ParameterError("an answer is under way: expected one at a time")
        standing = self.desk.findings
        missing = [name for name in parameters if name not in standing]
        if missing:
            raise ParameterError(f"parameters: expected settled findings, nothing settled is found of {missing[0]}")
        found = [standing[name] for name in parameters]
        measures = {answer_to(parse_fault_id(unit.parameter)).measure for unit in found}
        if len(measures) != 1:
            raise ParameterError(f"parameters: expected findings that ask for one measure, got {sorted(measures)}")
        self._busy, self._asked = True, found
        self._wake.set()
        return measures.pop()

    def now(self, found: Sequence[MonitoredUnit]) -> Answered:
        """Answers findings and waits for the end."""
        names = tuple(unit.parameter for unit in found)
        answer = answer_to(parse_fault_id(names[0]))
        began = self.desk.time

        def ended(outcome: Outcome, text: str, taken: Taken | None = None) -> Answered:
            return Answered(names, answer.measure, outcome, text, began, tuple(found), taken or Taken(None, {}))

        self.desk.say(f"{' and '.join(names)} asks for {answer.measure}: {answer.why}")
        try:
            if answer.measure == PASSES:
                return ended("nothing to do", answer.why)
            if answer.measure == STOP:
                return ended("interrupted", f"stop the arm: {order(parse_fault_id(names[0]))}")
            return ended("done", "uploaded, and its trial passed", self._measures().carry_out(answer.measure, found))
        except FindingWithdrawn as over:
            return ended("nothing to do", str(over))
        except RolledBack as error:
            return ended("taken back", str(error))
        except TooWeak as weak:
            return ended("too weak", f"stop the arm: {weak}")
        except DoubtfulFinding as doubt:
            return ended("too doubtful", f"stop the arm: {doubt}")
        except (CriticalFinding, StoppedByController) as critical:
            return ended("interrupted", f"stop the arm: {critical}")
        except (DeadlinePassed, DtwinError) as error:
            return ended("failed", str(error))

    def _measures(self) -> Measures:
        """The measures, made with the model in force where no other arm is known."""
        if self.measures is None:
            arm = self._healthy or self.desk.settings().model
            self.measures = Measures(self.desk, arm)
        return self.measures

    def _work(self) -> None:
        while not self._over.is_set():
            self._read_messages(self._wake.is_set)
            if not self._wake.is_set():
                continue
            self._wake.clear()
            if self._preparing:
                self._preparing = False
                try:
                    self._since = self._measures().put_into_force()
                except _BROKEN_OFF as error:
                    self._since = error
                self._ready.set()
                continue
            try:
                if self.measures is None:
                    self._measures().put_into_force()
                self.answers.append(self.now(self._asked))
            except _BROKEN_OFF as error:
                names = tuple(unit.parameter for unit in self._asked)
                measure = answer_to(parse_fault_id(names[0])).measure
                text = f"cannot begin: {error}"
                self.answers.append(Answered(names, measure, "failed", text, self.desk.time, tuple(self._asked)))
            self._busy = False

    def _read_messages(self, enough: Callable[[], bool]) -> None:
        """Hears what is said until there is something to do; what would interrupt an answer interrupts nothing."""
        try:
            for _ in self.desk.messages():
                if enough():
                    return
        except (CriticalFinding, StoppedByController):
            return
        except DeadlinePassed:
            self._over.set()
