"""Answers the findings of an arm's monitor while it works, whoever steps the arm and its blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.recovery.chain.answers import Answer, answer_to


class AdjustableBlocks(Protocol):
    """The blocks of an arm, as recovery uses them."""

    def adjust(self, found: Adjustment) -> None:
        """Lets the joints count on what was found of them."""

    def halt(self, angles_known: bool) -> None:
        """Stops the arm, braked along its path; without torque where its angles are not known."""


@dataclass(frozen=True, slots=True)
class Step:
    """An answer that was given, at a time of the plant, s."""

    time: float
    finding: ChainFinding
    answer: Answer


class ArmOperator:
    """An operator.

    Its monitor is that of a running cell. After a measure it goes on with what the blocks now count on, so that what
    is still wrong is found again.

    Args:
        arm: the arm as its data sheet says.
        blocks: its blocks.
        healthy: time in which it is learned, s.

    Attributes:
        monitor: looks for what is wrong.
        steps: what was done, in order.
        adjustment: what the blocks count on.
        stopped: whether the arm was stopped, after which nothing is answered any more.
    """

    def __init__(self, arm: Arm, blocks: AdjustableBlocks, healthy: float = HEALTHY) -> None:
        self._arm = arm
        self._blocks = blocks
        self.monitor = ArmMonitor(arm, healthy)
        self.steps: list[Step] = []
        self.adjustment = Adjustment.none(len(arm))
        self.stopped = False

    def follow(self, t: Array, q: Array, target: Array, effort: Array, acting: Array | None = None) -> None:
        """Takes samples, (N,) and (N, n) as `FirstFault.follow` does, and answers what is found in them."""
        if self.stopped:
            return
        known = len(self.monitor.history)
        self.monitor.follow(t, q, target, effort, acting)
        for found in self.monitor.history[known:]:
            if not self.stopped:
                self._answer(found)

    def _answer(self, found: ChainFinding) -> None:
        answer = answer_to(found, self._arm, self.adjustment)
        self.steps.append(Step(self.monitor.time, found, answer))
        if answer.measure == "stop":
            self.stopped = True
            self._blocks.halt(angles_known=not found.angles_unknown)
        elif answer.adjustment is not None:
            self.adjustment = answer.adjustment
            self._blocks.adjust(answer.adjustment)
            self.monitor.adjust(answer.adjustment)
