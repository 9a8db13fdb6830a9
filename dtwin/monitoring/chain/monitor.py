"""The monitor of any serial arm while it works: learns it, tells the first fault, and begins anew when that is known.

Whoever acknowledges a finding says that the arm as it is now is normal, and the monitor learns it again. A push that
is over changes nothing about the arm: it is told, and the monitor goes on.
"""

from __future__ import annotations

from typing import Final

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict, UnitState
from dtwin.errors import ParameterError
from dtwin.monitoring.chain.finding import CAUSES, ChainFinding, hidden_in_words
from dtwin.monitoring.chain.learning import Learning
from dtwin.monitoring.chain.sequential import HEALTHY, FirstFault
from dtwin.signals import Event, EventKind

TOOL: Final = "tool"
"""Unit of a finding that is of no joint."""
SHOWN: Final = 5.0
"""Time for which a push is shown, s."""


class ArmMonitor:
    """A monitor.

    Args:
        arm: the arm as its data sheet says.
        healthy: time in which it is learned, s; longer where its motion does not suffice (`Learning`).
        known: who knows the arm already; learned from its motion if None.

    Attributes:
        time: time of the last sample, s.
        events: everything that was noticed, in order.
        history: every finding that was settled, in order.
        missed: samples that did not arrive.
    """

    def __init__(self, arm: Arm, healthy: float = HEALTHY, known: FirstFault | None = None) -> None:
        self._arm = arm
        self._healthy = healthy
        self._adjustment: Adjustment | None = None
        self._learning = Learning(arm, healthy)
        self._watch = known
        self._suspected = self._confirmed = False
        self.time = 0.0
        self.events: list[Event] = []
        self.history: list[ChainFinding] = []
        self.missed = 0

    @property
    def units(self) -> tuple[str, ...]:
        """The units of a verdict: a joint each, and the tool."""
        return (*(f"joint {k + 1}" for k in range(len(self._arm))), TOOL)

    @property
    def finding(self) -> ChainFinding | None:
        """What is wrong now."""
        return None if self._watch is None else self._watch.finding

    @property
    def healthy(self) -> float:
        """Length of the stretch in which the arm was learned from its motion, or is now, s."""
        return self._learning.until

    @property
    def learned(self) -> bool:
        """Whether the healthy arm is known."""
        return self._watch is not None

    def follow(self, t: Array, q: Array, target: Array, effort: Array, acting: Array | None = None) -> None:
        """Takes further samples, a period of the arm apart: see `FirstFault.follow`."""
        if not len(t):
            return
        if self._watch is None:
            self._learn(t, q, target, effort, acting)
        else:
            self._watch.follow(t, q, target, effort, acting)
        self.time = float(t[-1])
        if self._watch is not None:
            self._tell(self._watch)

    def miss(self, samples: int) -> None:
        """Samples did not arrive, and the next ones do not follow the last ones."""
        self.missed += samples
        (self._watch or self._learning).forget()

    def adjust(self, adjustment: Adjustment) -> None:
        """Goes on with the arm as the blocks count on it now; what was found is answered by that."""
        found = self.finding
        if found is not None:
            self._note(EventKind.RECOVERED, f"{found.text(self._arm)}: the blocks count on it")
        self._adjustment = adjustment
        if self._watch is None:
            self._learning = Learning(self._arm, self._healthy, adjustment)
        else:
            self._watch.resume(adjustment)
        self._suspected = self._confirmed = False

    def acknowledge(self, parameter: str = "") -> None:
        """Takes the arm as it is now for normal, and learns it.

        Raises:
            ParameterError: there is no such finding.
        """
        found = self.finding
        if parameter and (found is None or parameter != found.cause):
            names = "none" if found is None else found.cause
            raise ParameterError(f"no finding {parameter!r}: expected {names}")
        if found is not None:
            self._note(EventKind.ACKNOWLEDGED, f"{found.text(self._arm)}; the arm is learned anew")
            self._anew()

    def verdict(self) -> MonitoringVerdict:
        """What the monitor thinks of the arm now."""
        units = dict.fromkeys(self.units, MonitoredUnit("nominal"))
        if self._watch is None:
            end = (self._learning.begin or 0.0) + self._learning.until
            why = self._learning.words()
            text = f"the arm is learned from its motion until {end:.0f} s" + (f", as {why}" if why else "")
            units = dict.fromkeys(self.units, MonitoredUnit("not commissioned", text=text[:1000]))
        findings: tuple[MonitoredUnit, ...] = ()
        if self._watch is not None and (found := self._watch.finding) is not None:
            told = self._unit(found, self._watch.settled)
            findings = (told,)
            units[TOOL if found.joint is None else f"joint {found.joint}"] = told
        known = {} if self._watch is None else self._watch.hidden()
        hidden = tuple(hidden_in_words(self._arm, *each)[:1000] for each in known.items())
        return MonitoringVerdict(self.time, units, (), hidden, self.missed, 0, findings)

    def _unit(self, found: ChainFinding, settled: bool) -> MonitoredUnit:
        state: UnitState = "failed" if settled else "may be degrading"
        return MonitoredUnit(
            state,
            CAUSES[found.kind],
            found.cause,
            -found.size if found.kind == "K" else found.size,
            0.0,
            found.confidence,
            found.time,
            found.time,
            settled,
            found.text(self._arm)[:1000],
            found.others,
        )

    def _learn(self, t: Array, q: Array, target: Array, effort: Array, acting: Array | None) -> None:
        """Notes when the arm is known, and every stretch that did not suffice."""
        short = self._learning.doubt
        self._learning.follow(t, q, target, effort, acting)
        self._watch = self._learning.watch
        if self._learning.doubt is not short:
            self._note(EventKind.MISFIT, f"{self._learning.words()}; it is learned for longer")
        if self._watch is not None:
            self._note(EventKind.FITS, "the healthy arm is known from its motion")

    def _tell(self, watch: FirstFault) -> None:
        """Notes what is new of the finding, and goes on after a push."""
        found = watch.finding
        if found is None:
            if self._suspected:
                self._suspected = False
                self._note(EventKind.DISMISSED, "a suspicion was not confirmed")
            return
        if not self._suspected:
            self._suspected = True
            self._note(EventKind.SUSPECTED, found.text(self._arm))
        if watch.settled and not self._confirmed:
            self._confirmed = True
            self.history.append(found)
            self._note(EventKind.FAILED, found.text(self._arm))
        if found.kind == "push" and self._confirmed and self.time > found.time + SHOWN:
            self._note(EventKind.RECOVERED, f"{found.text(self._arm)}: it is over")
            watch.resume()
            self._suspected = self._confirmed = False

    def _anew(self) -> None:
        self._watch = None
        self._learning = Learning(self._arm, self._healthy, self._adjustment)
        self._suspected = self._confirmed = False

    def _note(self, kind: EventKind, text: str) -> None:
        self.events.append(Event(self.time, kind, text[:1000]))
