"""What if a running arm were controlled otherwise: its work on the chain twin, beside what was measured lately."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from dtwin.arm.model import ArmSettings
from dtwin.bus.chain.messages import JointOutcome, JointPredicted, JointQuestion, JointTicks
from dtwin.errors import CommunicationError, DivergenceError, ParameterError
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange

SPAN: Final = 8.0
"""Time that the twin works, and for which the arm is measured, s."""
PATIENCE: Final = 3.0
"""Longest wait for the first sample of a cell that has just begun, s."""
_KEPT: Final = 2
"""Settings of which the twin is kept: those in force, and those asked about last."""


class Predicting:
    """Answers what the twin expects.

    Args:
        settings: run of the arm.
    """

    def __init__(self, settings: ChainSettings) -> None:
        self._settings = settings
        self._errors: deque[tuple[float, ...]] = deque(maxlen=round(SPAN / settings.arm.period))
        self._where: tuple[float, ...] | None = None
        self._last = -1
        self._begun, self._known = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._simulator = lru_cache(_KEPT)(self._prepared)

    def receive(self, passed: JointTicks) -> None:
        """Takes ticks that have passed."""
        for tick in passed.ticks:
            sample, acted = tick.sensors, tick.acted
            if len(sample.theta) != len(self._settings.arm) or sample.sequence <= self._last:
                self._errors.clear()
            self._last, self._where = sample.sequence, sample.theta
            self._begun.set()
            if acted.sequence == sample.sequence and len(acted.target) == len(sample.theta):
                self._errors.append(tuple(a - b for a, b in zip(acted.target, sample.theta, strict=True)))
        if len(self._errors) == self._errors.maxlen:
            self._known.set()
        else:
            self._known.clear()

    def await_measured(self, longest: float) -> bool:
        """Waits until the arm was measured for `SPAN`, at most `longest` s; whether it was."""
        return self._known.wait(longest)

    @property
    def measured(self) -> tuple[float, ...] | None:
        """The largest distance of each joint from its path in the last `SPAN`, (n,), rad or m; None before that."""
        errors = np.array(self._errors)
        return tuple(map(float, np.abs(errors).max(axis=0))) if len(errors) == self._errors.maxlen else None

    def answer(self, question: JointQuestion, version: int, in_force: ArmSettings) -> JointPredicted:
        """What the twin expects of settings, beside those in force and what was measured; waits for a first sample.

        Args:
            question: the settings.
            version: of the settings in force.
            in_force: the settings in force.

        Raises:
            ParameterError: a value is out of range. CommunicationError: no sample comes.
        """
        self._begun.wait(PATIENCE)
        where = self._where
        if where is None:
            raise CommunicationError("no sample of the arm has come yet")
        change = ArmChange(question.pole, question.observer, question.speed, question.payload)
        with self._lock:
            # Both from one pose: how far an arm is off its path at first depends on where it begins.
            proposed = now = self._outcome(in_force, where, ArmChange())
            if change != ArmChange() or question.model is not None:
                wished = replace(in_force, model=question.model or in_force.model)
                proposed = self._outcome(wished, where, change)
        return JointPredicted(version, SPAN, now, proposed, self.measured)

    def _tuned(self, base: ArmSettings) -> ChainSettings:
        return replace(self._settings, control=self._settings.control.tuned(base.tuning))

    def _prepared(self, base: ArmSettings) -> ArmSimulator:
        return ArmSimulator(self._tuned(base), base.model)

    def _outcome(self, base: ArmSettings, where: tuple[float, ...], change: ArmChange) -> JointOutcome:
        simulator = self._simulator(base)
        loops = simulator.loops(change)
        try:
            found = simulator.run(np.array(where), change, SPAN)
        except DivergenceError as error:
            raise ParameterError(f"the twin does not do its work with these settings: {error}") from None

        def each(values: np.ndarray) -> tuple[float, ...]:
            return tuple(map(float, values))

        return JointOutcome(
            each(np.abs(found.error).max(axis=0)),
            each(np.sqrt(np.mean(found.error**2, axis=0))),
            each(np.abs(found.command).max(axis=0)),
            each(found.saturated),
            tuple(float(one.modulus) if np.isfinite(one.modulus) else 0.0 for one in loops),
            all(one.stable for one in loops),
            found.stop,
            found.reached,
        )
