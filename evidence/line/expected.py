"""Boxes an hour that the twins of a line expect of it, from what they know of its arms, and from now on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dtwin.line.line import Assignment, Line
from dtwin.line.run import LineRun
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
        time: plant time, s.
        assignment: which station did what from then on.
        situation: what the line was; None where nobody can tell.
        times: how long its arms take.
        stopped: names of the stations whose arms stood.
    """

    time: float
    assignment: Assignment
    situation: Situation | None
    times: Mapping[str, WorkTimes]
    stopped: tuple[str, ...]

    @classmethod
    def of(cls, run: LineRun) -> Known:
        """What the twins of a line know now."""
        times = run.times()
        stopped = tuple(filter(run.is_stopped, times))
        return cls(run.time, dict(run.work.assignment), run.situation, times, stopped)

    def differs(self, run: LineRun) -> bool:
        """Whether others do the work by now, or other arms stand."""
        return self.assignment != run.work.assignment or self.stopped != tuple(filter(run.is_stopped, self.times))


def expected(line: Line, known: Sequence[Known], until: float) -> float:
    """Boxes an hour that twins predict: the mean of simulations with slightly other work times.

    The boxes of a full line fall into step with vehicles that charge, and out of it, for a hundredth of a second of
    work; one simulation alone tells one of these ways, and arms are not that exact.

    Args:
        line: the line.
        known: what they knew when the time began that counts, and whenever the work was shared out otherwise or other
            arms stood; at least one.
        until: plant time at which it ends, s.
    """
    rates, forward = [], Forward(line)
    for factor in SPREAD:
        left: list[float] = []
        for each, end in zip(known, [*(later.time for later in known[1:]), until], strict=True):
            spread = {name: scaled_times(times, factor) for name, times in each.times.items()}
            change = Change(each.assignment, spread, each.stopped)
            part = each.situation and forward.left(each.situation, change, end - each.time)
            left += [each.time + time for time, _ in part or ()]
        if len(left) > 1:
            rates.append(3600.0 * (len(left) - 1) / (left[-1] - left[0]))
        else:
            rates.append(predicted(line, spread, known[-1].assignment, until - known[0].time))
    return sum(rates) / len(rates)


def scaled_times(times: WorkTimes, factor: float) -> WorkTimes:
    """Work times that all are so many times as long."""
    carry, back = ({place: factor * time for place, time in part.items()} for part in (times.carry, times.back))
    classes = {each: factor * time for each, time in times.classes.items()}
    return WorkTimes(factor * times.grip, carry, back, classes)
