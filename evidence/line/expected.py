"""Boxes an hour that the twins of a line expect of it, from what they know of its arms, and from now on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from dtwin.line.line import Assignment, Line
from dtwin.line.situation import Situation
from dtwin.line.station import WorkTimes
from dtwin.line.twins.forward import Change, Forward
from dtwin.line.twins.overall import predicted

SPREAD: Final = (0.99, 1.0, 1.01)
"""Factors on the work times of simulations whose mean is what is predicted."""


@dataclass(frozen=True, slots=True)
class Known:
    """What twins knew of a line at a time.

    Attributes:
        situation: what it was; None where nobody can tell.
        times: how long its arms take.
        stopped: names of the stations whose arms stood.
    """

    situation: Situation | None
    times: Mapping[str, WorkTimes]
    stopped: tuple[str, ...]


def expected(line: Line, known: Known, assignment: Assignment, horizon: float) -> float:
    """Boxes an hour that twins predict of an assignment: the mean of simulations with slightly other work times.

    The boxes of a full line fall into step with vehicles that charge, and out of it, for a hundredth of a second of
    work; one simulation alone tells one of these ways, and arms are not that exact.
    """
    rates, forward = [], Forward(line)
    for factor in SPREAD:
        spread = {name: scaled_times(each, factor) for name, each in known.times.items()}
        left = known.situation and forward.left(known.situation, Change(assignment, spread, known.stopped), horizon)
        times = [time for time, _ in left or ()]
        if len(times) > 1:
            rates.append(3600.0 * (len(times) - 1) / (times[-1] - times[0]))
        else:
            rates.append(predicted(line, spread, assignment, horizon))
    return sum(rates) / len(rates)


def scaled_times(times: WorkTimes, factor: float) -> WorkTimes:
    """Work times that all are so many times as long."""
    carry, back = ({place: factor * time for place, time in part.items()} for part in (times.carry, times.back))
    classes = {each: factor * time for each, time in times.classes.items()}
    return WorkTimes(factor * times.grip, carry, back, classes)
