"""Finds the ripple of motors in what a fit leaves: its periods first, where a search by slopes has many valleys."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from dtwin.identification.data import Array, Experiment
from dtwin.identification.estimation.problem import Prior
from dtwin.identification.machine.fit import MachineFit, fit_machine
from dtwin.identification.machine.left import NOTICEABLE, Remainder
from dtwin.identification.machine.sheet import RIPPLE_PERIODS
from dtwin.twin.machine import MACHINE_NAMES

_APART: Final = 2.0
"""rad: phase between neighbouring periods that are tried over the whole way of a joint; half of it off, the ripple is
half a radian out of phase at the ends."""
_JOINTS: Final = (1, 2, 3)


def fit_with_ripple(
    segments: Sequence[Experiment],
    free: Sequence[str],
    fixed: Array,
    priors: Mapping[str, Prior],
    progress: Callable[[str], None] = lambda text: None,
) -> MachineFit:
    """Fits a machine, with the ripple of those motors of which it explains a noticeable share of what is left.

    A motor at a time, the one that shows most first, because its ripple hides that of the others. Arguments and
    errors are those of `fit_machine`; the priors of the ripple are among them.
    """
    found = fit_machine(segments, free, fixed, priors, progress)
    rippling: list[int] = []
    while len(rippling) < len(_JOINTS):
        best = _strongest(found, [joint for joint in _JOINTS if joint not in rippling], priors)
        if best.share < NOTICEABLE:
            break
        progress(f"ripple of motor {best.joint}, {best.periods:g} a turn, explains {best.share:.0%} of what is left")
        rippling.append(best.joint)
        names = [name for joint in rippling for name in _of(joint)]
        start = dict(zip(_of(best.joint), (best.sin, best.cos, best.periods), strict=True))
        found = fit_machine(segments, (*free, *names), found.vector, priors, progress, found, start)
    return found


class _Ripple(NamedTuple):
    """The share of what is left that the ripple of a joint explains, with its torques, N m, and periods a turn."""

    share: float
    joint: int
    periods: float
    sin: float
    cos: float


def _of(joint: int) -> tuple[str, str, str]:
    return f"ripple_sin{joint}", f"ripple_cos{joint}", f"ripple_periods{joint}"


def _strongest(fit: MachineFit, joints: Sequence[int], priors: Mapping[str, Prior]) -> _Ripple:
    remainder, found = Remainder(fit), []
    least, most = RIPPLE_PERIODS
    for joint in joints:
        turned = max(float(np.ptp(np.concatenate([e.measured[:, joint - 1] for e in fit.problem.segments]))), 1.0)
        for periods in np.arange(least, most, _APART / turned).tolist():
            vector = fit.vector.copy()
            vector[MACHINE_NAMES.index(f"ripple_periods{joint}")] = periods
            units = {name: priors[name].deviation for name in _of(joint)[:2]}
            columns = remainder.columns(units, vector)
            share, factors = remainder.explained(columns)
            sin, cos = (factors * list(units.values())).tolist()
            found.append(_Ripple(share, joint, periods, sin, cos))
    return max(found)
