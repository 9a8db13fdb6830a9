"""The operator who puts a running cell right again, with nothing but what its services say and offer on the bus.

Monitoring notices and names what is wrong; the table of answers says what is to be done about it; identification and
simulation do it. Every change is on trial, and taken back when it is worse. What the table knows no help for, and
what leaves the arm too weak for its boxes, stops the arm, and a person is told what to do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict
from dtwin.errors import CommunicationError, ParameterError
from dtwin.monitoring.kinds import PUSH, SLIP, arm_state, parse_fault_id
from dtwin.recovery.answers import MEASURES, Answer, Measure, answer_to, order
from dtwin.recovery.causes import StopCause
from dtwin.recovery.desk import (
    CriticalFinding,
    DeadlinePassed,
    Desk,
    DoubtfulFinding,
    FindingWithdrawn,
    RolledBack,
    StoppedByController,
)
from dtwin.recovery.explanation import Outlook, TooWeak
from dtwin.recovery.measures import Measures, Taken
from dtwin.signals import MONITOR, Event

SETTLING: Final = 1.0
"""s in which a second finding may follow the first, so that both are answered together"""
FIND_OUT: Final = "find out what is wrong, then `dtwin release`"
"""What a person has to do about an arm of which nobody knows what it has"""
LOST: Final = 0.5
"""Share of the weight of a box that is gone at least when it was lost"""
SURELY: Final = 5.0
"""Standard deviations by which that is told"""
_LASTING: Final[tuple[Measure, ...]] = ("go on", "payload")
"""Measures that are taken though what they answer is over"""
_NOTHING: Final = Taken(None, {})

Propose = Callable[[Measure, Sequence[MonitoredUnit], str], None]
"""Has a person decide about a measure against findings, who is told what the arm can do then, if that has changed."""


class Step(NamedTuple):
    """A measure that the operator has taken.

    Attributes:
        time: plant time at which it was begun, s.
        parameters: what the findings name.
        measure: what was done.
        taken: what came of it; nothing if it was not completed.
    """

    time: float
    parameters: tuple[str, ...]
    measure: Measure
    taken: Taken


class Operator:
    """Answers what the monitor finds.

    Args:
        desk: place at the bus of the cell.
        measures: measures at that cell, which have begun.
        propose: has a person decide about a measure against findings; the operator takes it itself if None. What is
            approved comes by `carry_out`. A stop waits for nobody.
        look: called after every verdict.

    Attributes:
        steps: what has been begun, in order.
        findings: findings as they were when they were answered, in order.
        trouble: why not all was done, "" if it was.
        cause: which push explains a stop by the blocks.
    """

    def __init__(
        self,
        desk: Desk,
        measures: Measures,
        propose: Propose | None = None,
        look: Callable[[], None] = lambda: None,
    ) -> None:
        self.steps: list[Step] = []
        self.findings: list[MonitoredUnit] = []
        self.trouble = ""
        self.cause = StopCause()
        self._desk = desk
        self._measures = measures
        self._dealt: dict[str, float] = {}
        self._again: dict[str, float] = {}
        self._waiting: dict[str, MonitoredUnit] = {}
        self._propose = propose
        self._look = look

    def watch(self) -> None:
        """Answers all that is found, until the arm is stopped or the time of the desk is over."""
        self._desk.on_event = self._on_event
        while not self._desk.stopped:
            try:
                self._listen()
            except DeadlinePassed as late:
                if self._new():
                    self.trouble = str(late)
                return
            except CriticalFinding as critical:
                self._halt(critical.finding)
            except StoppedByController as tripped:
                self._explain(str(tripped))
            except (CommunicationError, ParameterError) as error:
                self._complain(error)

    def _listen(self) -> None:
        for message in self._desk.messages():
            if self._desk.stopped:
                return
            if isinstance(message, MonitoringVerdict):
                self._deal()
                self._measures.follow_boxes()
                self._look()

    def _on_event(self, event: Event) -> None:
        """Tells of a push, which is over by then, also while something else is being answered; and what explains a
        stop by the blocks when that is found later."""
        self.cause.note(event)
        if self._desk.stopped and (text := self.cause.amend(event)):
            self._desk.say(text)
        if event.kind == MONITOR + PUSH and not self._desk.stopped:
            self._say_why(PUSH, answer_to(parse_fault_id(PUSH)))
            self._add_step("go on", (PUSH,))

    def _new(self) -> dict[str, MonitoredUnit]:
        """Findings that nobody has dealt with, by what they name; one that was noticed at another time is another."""
        found = self._desk.findings
        return {name: unit for name, unit in found.items() if self._dealt.get(name) != unit.detected}

    def _answerable(self) -> dict[str, MonitoredUnit]:
        """Those that ask for no stop, which is asked for by itself, and are no consequences of others as far as is
        known; what changes no model need not wait for that."""
        new = {name: unit for name, unit in self._new().items() if _measure(unit) != "stop"}
        return {name: unit for name, unit in new.items() if _measure(unit) in _LASTING or self._desk.lasts(name)}

    def _deal(self) -> None:
        """Answers new findings, first all that ask for the measure that comes first."""
        desk = self._desk
        first = {**self._waiting, **self._answerable()}
        if not first:
            return
        desk.pass_time(SETTLING)
        # A slip is over once the gripper has opened, and a box that has been put down tells of the next ones, however
        # long something else is answered first.
        over = {name: unit for name, unit in first.items() if _measure(unit) in _LASTING}
        found_now = {**over, **self._answerable()}
        kept = [unit for unit in found_now.values() if _kept(unit, self._measures.boxes[0])]
        new = [unit for unit in found_now.values() if unit not in kept]
        for unit in kept:
            self._dealt[unit.parameter] = unit.detected
            desk.say(f"slip is none: the box has lost {1e3 * _most_lost(unit):.0f} g at most")
        self._waiting = {unit.parameter: unit for unit in new if _measure(unit) == "payload"}
        # What changes nothing is said at once: it may be over before anything else has been answered.
        self._answer("go on", new)
        others = {measure for unit in new if (measure := _measure(unit)) != "go on"}
        if others:
            self._answer(min(others, key=MEASURES.index), new)

    def _answer(self, measure: Measure, new: Sequence[MonitoredUnit]) -> None:
        """Answers those of new findings that ask for a measure."""
        found = [unit for unit in new if _measure(unit) == measure]
        if not found:
            return
        names = tuple(unit.parameter for unit in found)
        self._dealt |= {unit.parameter: unit.detected for unit in found}
        self._waiting = {name: unit for name, unit in self._waiting.items() if name not in names}
        self.findings += found
        self._say_why(" and ".join(names), answer_to(parse_fault_id(names[0])))
        if measure == "go on":
            self._add_step(measure, names)
        elif self._propose is not None:
            self._offer(self._propose, measure, found)
        else:
            self._carry_out(measure, found)

    def _offer(self, propose: Propose, measure: Measure, found: Sequence[MonitoredUnit]) -> None:
        """Proposes a measure to a person; an arm that cannot be held is stopped at once, which waits for nobody."""
        outlook = self._asked(self._measures.foresee, found)
        if outlook is None or not outlook.weak:
            propose(measure, found, outlook.text if outlook else "")
            return
        fault = parse_fault_id(found[0].parameter)
        self._stop(found, f"{fault.where}: {outlook.text}", order(fault))

    def carry_out(self, names: Sequence[str], who: str, reason: str) -> str:
        """Answers findings as a person has approved, and tells what came of it.

        Args:
            names: what the findings name, which ask for one measure.
            who: name of the person.
            reason: what was approved.

        Raises:
            ParameterError: one of them stands no more, or they ask for different measures.
            DeadlinePassed, CriticalFinding, StoppedByController, CommunicationError: as the measures do.
        """
        standing = self._desk.findings
        if missing := [name for name in names if name not in standing]:
            raise ParameterError(f"nothing settled is found of {' and '.join(missing)} any more")
        found = [standing[name] for name in names]
        asked = {_measure(unit) for unit in found}
        if len(asked) != 1:
            raise ParameterError(f"expected findings that ask for one measure, got {' and '.join(sorted(asked))}")
        measure = asked.pop()
        if measure == "go on":
            return answer_to(parse_fault_id(names[0])).why
        self._dealt |= {unit.parameter: unit.detected for unit in found}
        with self._desk.on_behalf(who, reason):
            return self._carry_out(measure, found)

    def forget(self, names: Sequence[str]) -> None:
        """Lets findings that stand be answered once more."""
        for name in names:
            self._dealt.pop(name, None)

    def pass_over(self) -> list[str]:
        """Leaves the findings that stand now to others; what they name."""
        self._dealt |= {name: unit.detected for name, unit in self._desk.findings.items()}
        return list(self._desk.findings)

    def _carry_out(self, measure: Measure, found: Sequence[MonitoredUnit]) -> str:
        """Takes a measure against findings, and tells what came of it."""
        fault = parse_fault_id(found[0].parameter)
        step = self._add_step(measure, tuple(unit.parameter for unit in found))
        try:
            taken = self._measures.carry_out(measure, found)
        except TooWeak as weak:
            return self._stop(found, f"{fault.where}: {weak}", order(fault))
        except DoubtfulFinding as doubt:
            return self._stop(found, f"{doubt}: too doubtful to change the model", FIND_OUT)
        except RolledBack as error:
            self._try_again(found, error)
            return str(error)
        except FindingWithdrawn as over:
            self._desk.say(f"goes on: {over}")
            self._drop(step)
            return str(over)
        self.steps[step] = self.steps[step]._replace(taken=taken)
        return "uploaded, and its trial passed" if taken.uploaded is not None else "the settings in force can stay"

    def _drop(self, step: int) -> None:
        """Ends a step without a change; what the monitor has found of the joint instead is answered by itself."""
        joints = {parse_fault_id(name).joint for name in self.steps[step].parameters}
        if joints & (self._desk.examined | {parse_fault_id(name).joint for name in self._new()}):
            del self.steps[step]
        else:
            self.steps[step] = self.steps[step]._replace(measure="go on")

    def _try_again(self, found: Sequence[MonitoredUnit], error: RolledBack) -> None:
        """Has findings answered once more, since a trial may fail for what the arm was doing when it began."""
        again = {unit.parameter: unit.detected for unit in found}
        if again.items() <= self._again.items():
            raise error
        self._again |= again
        for name in again:
            del self._dealt[name]
        self._desk.say(f"{error}; tries once more")

    def _stop(self, found: Sequence[MonitoredUnit], why: str, todo: str) -> str:
        """Stops the arm for findings, and tells why; what nobody stops it for is answered again."""
        names = tuple(unit.parameter for unit in found)
        for name in names:
            self._dealt.pop(name, None)
        self._desk.stop(arm_state(parse_fault_id(names[0])), f"{why}: {todo}")
        self._dealt |= {unit.parameter: unit.detected for unit in found}
        self._add_step("stop", names)
        return f"the arm is stopped: {why}: {todo}"

    def _halt(self, found: MonitoredUnit) -> None:
        """Stops the arm; if nobody does it, the next verdict asks again."""
        fault = parse_fault_id(found.parameter)
        try:
            self._stop([found], f"{fault.where}, {answer_to(fault).why}", order(fault))
        except CommunicationError as error:
            self._complain(error)
        else:
            self.findings.append(found)

    def _explain(self, why: str) -> None:
        """Leaves an arm that the blocks have stopped to a person; if nobody answers, the next verdict asks again."""
        names = tuple(self._desk.findings)
        try:
            self._desk.stop("failed", f"{why}; {self._explanation()}")
        except CommunicationError as error:
            self._complain(error)
        else:
            self._add_step("stop", names)

    def _explanation(self) -> str:
        """What explains that the blocks have stopped the arm, one finding if it suffices, and what a person does."""
        found = list(self._desk.findings.values())
        together = [found] if len(found) > 1 else []
        for causes in [*([unit] for unit in found), *together]:
            names = " and ".join(unit.parameter for unit in causes)
            if outlook := self._asked(self._measures.explain, causes):
                return f"{names} explains it, {outlook.text}: {order(parse_fault_id(causes[0].parameter))}"
        tripped = self._desk.tripped
        push = self.cause.explain(tripped, found) if tripped is not None else ""
        if self.cause.name:
            return push
        none = f"{names} does not explain it" if found else "nothing explains it"
        return f"{push or none}: {FIND_OUT}"

    def _asked(
        self, ask: Callable[[Sequence[MonitoredUnit]], Outlook | None], found: Sequence[MonitoredUnit]
    ) -> Outlook | None:
        """What simulation answers about findings, None if it does not."""
        try:
            return ask(found)
        except CommunicationError as error:
            self._complain(error)
            return None

    def _complain(self, error: Exception) -> None:
        self.trouble = str(error)
        self._desk.say(f"cannot go on: {error}")

    def _say_why(self, what: str, answer: Answer) -> None:
        todo = f"; for a person: {answer.order}" if answer.measure == "go on" and answer.order else ""
        self._desk.say(f"{what} asks for {answer.measure}: {answer.why}{todo}")

    def _add_step(self, measure: Measure, names: tuple[str, ...]) -> int:
        """Writes a step down; its index."""
        self.steps.append(Step(self._desk.time, names, measure, _NOTHING))
        return len(self.steps) - 1


def _measure(unit: MonitoredUnit) -> Measure:
    return answer_to(parse_fault_id(unit.parameter)).measure


def _kept(unit: MonitoredUnit, usual: float) -> bool:
    """Whether a box (kg) that is said to have slipped weighs nearly what it did: then there is nothing to pick up."""
    return unit.parameter == SLIP and _most_lost(unit) < LOST * usual


def _most_lost(unit: MonitoredUnit) -> float:
    """What a box has lost at most, kg."""
    return abs(unit.size) + SURELY * unit.deviation
