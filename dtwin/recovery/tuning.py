"""Settings under which an arm that has changed tracks as well as the healthy one did, from the least change on.

The search asks what to expect of settings, whether the simulation service answers or the twin in this process.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

from dtwin.bus.twin_messages import PredictedMotion
from dtwin.parameters import ArmParameters, Gains, JointVector
from dtwin.recovery.strength import Strength

SLOWER: Final = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0)
"""Factors on the target time that are tried, in this order."""
STIFFER: Final = (1.0, 1.15, 1.3, 1.5)
"""Factors on Kp and Ki that are tried for each; beyond the last, encoder noise gets the better of the gain."""
BOUND: Final = 1.2
"""Greatest distance from the path of an arm that works, relative to that of the healthy arm."""
WORSE: Final = 3.0
"""The same for an arm that the voltage limit does not hold back: gains with margins hold it less exactly, and no
weakness is behind that."""
FLOOR: Final = 1e-3
"""rad, distance from the path that encoders with noise leave whatever the settings are"""
ENOUGH: Final = 1.05
"""Distance from the path, relative to that of the healthy arm or of the best settings, that needs no other ones."""
SATURATED: Final = 0.02
"""Share of the samples of a motion at the voltage limit from which on stiffer gains are of no use."""

Expect = Callable[[Gains, float], Sequence[PredictedMotion]]
"""What to expect of the cell's motions with gains and a target time (s): always the same motions in one order."""
Ability = Literal["as before", "slower", "without a box", "not at all"]
"""How an arm can work: at its target time, at a longer one, at any but only without a box, or not within bounds."""


class Tuned(NamedTuple):
    """What a search has found.

    Attributes:
        gains: gains of the control law.
        target_time: duration of a motion, s.
        ratio: distance of the worst motion from its path, relative to that of the healthy arm.
        ability: how the arm can work with them.
    """

    gains: Gains
    target_time: float
    ratio: float
    ability: Ability

    @property
    def expected(self) -> str:
        """How well the arm is expected to keep to its paths, in words."""
        return f"at most {100 * self.ratio:.0f} % of the healthy arm's distance from the path expected"

    @property
    def works(self) -> bool:
        """Whether the arm can work with its boxes."""
        return self.ability in ("as before", "slower")


class _Tried(NamedTuple):
    gains: Gains
    target_time: float
    loaded: float
    empty: float
    saturated: float

    @property
    def worst(self) -> float:
        return max(self.loaded, self.empty)

    @property
    def works(self) -> bool:
        return self.worst <= (WORSE if self.saturated <= SATURATED else BOUND)


def search(
    arm: ArmParameters,
    heaviest: float,
    strength: Strength,
    expect: Expect,
    gains: Gains,
    target_time: float,
    reference: Sequence[PredictedMotion],
    stiffer: Sequence[float] = STIFFER,
) -> Tuned:
    """The first settings that are no worse than the healthy arm in any motion, from the least change on.

    Where there are none, the first within BOUND are taken, or else the first that are nearly as good as the best with
    which the arm works; an arm that works with none is judged by its empty motions. Nothing is searched for an arm
    that cannot hold its heaviest box at some place.

    Args:
        arm: arm as it is known.
        heaviest: mass of its heaviest box, kg.
        strength: what holding the healthy arm takes.
        expect: tells what to expect of settings.
        gains: gains in force.
        target_time: target time in force, s.
        reference: what the healthy arm's motions are expected to be with the settings in force.
        stiffer: factors on Kp and Ki that are tried.
    """
    if strength.beyond(arm, heaviest):
        able: Ability = "not at all" if strength.beyond(arm, 0.0) else "without a box"
        return Tuned(gains, target_time, math.inf, able)
    found: list[_Tried] = []
    for slower in SLOWER:
        for factor in stiffer:
            tried_gains = stiffened(gains, factor)
            expected = expect(tried_gains, slower * target_time)
            saturated = max(motion.saturated for motion in expected)
            found.append(_Tried(tried_gains, slower * target_time, *_ratios(expected, reference), saturated))
            if found[-1].worst <= ENOUGH:
                return _tuned(found[-1], target_time)
            if saturated > SATURATED:
                break
    working = [tried for tried in found if tried.works] or found
    least = min(tried.worst for tried in working)
    best = next(tried for tried in working if tried.worst <= (BOUND if least <= BOUND else ENOUGH * least))
    return _tuned(best, target_time, min(tried.empty for tried in found))


def worst_ratio(expected: Sequence[PredictedMotion], reference: Sequence[PredictedMotion]) -> float:
    """Distance from the path of the worst motion, relative to that of the healthy arm."""
    return max(_ratios(expected, reference))


def _tuned(tried: _Tried, target_time: float, empty: float = 1.0) -> Tuned:
    ability: Ability
    if tried.works:
        ability = "slower" if tried.target_time > target_time else "as before"
    else:
        ability = "without a box" if empty <= BOUND else "not at all"
    return Tuned(tried.gains, tried.target_time, tried.worst, ability)


def _ratios(expected: Sequence[PredictedMotion], reference: Sequence[PredictedMotion]) -> tuple[float, float]:
    """Distance from the path of the worst motion with a box, and of the worst without, relative to the reference."""
    worst = {True: 0.0, False: 0.0}
    for motion, healthy in zip(expected, reference, strict=True):
        worst[motion.carries] = max(worst[motion.carries], _seen(motion.rms) / _seen(healthy.rms))
    return worst[True], worst[False]


def stiffened(gains: Gains, factor: float) -> Gains:
    """Gains with Kp and Ki times a factor."""
    return replace(gains, kp=times(factor, gains.kp), ki=times(factor, gains.ki))


def times(factor: float, gains: JointVector) -> JointVector:
    """The gains of all joints times a factor."""
    return tuple(factor * gain for gain in gains)


def _seen(rms: JointVector) -> float:
    """Distance from the path with noise (rad) for one that is expected without."""
    return math.hypot(*rms, FLOOR)
