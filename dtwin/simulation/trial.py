"""The trial after an upload, in which the arm has to track its path as well as the twin predicted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

from dtwin.parameters import PERIOD

Values = tuple[float, ...]
"""A number for each joint."""
TrialState = Literal["running", "passed", "failed"]

SAME_ANGLE: Final = 1e-12
"""Largest difference of two readings of one angle, rad: a FORTE writes 15 digits of it."""
INTERIM: Final = 3.0
"""Factor of the bounds until the first motion that starts when the integrals fit the new settings.

The twin predicts whole motions of such an arm.
"""


@dataclass(frozen=True, slots=True)
class TrialRules:
    """When tracking counts as worse than predicted.

    The bound of a joint's distance from the path is factor times the predicted distance plus the allowance.

    Attributes:
        duration: least duration of the trial, s; it also lasts until a whole motion has been judged, and until the
            distance counts again after late commands.
        longest: duration after which the trial ends in any case, s.
        factor: factor of the predicted distance from the path.
        allowance: distance added for noise and for what the twin does not know, rad.
        samples: number of consecutive samples beyond the bound that make a failure, since one may be an outlier.
        settling: time in which the integrals may still fit the old settings, s: three times Kp / Ki of usual gains.
        grace: time in which a distance from before the upload, or from late commands, may fall below the bound, s.
        calm: number of consecutive samples within the bounds that show that it has.
        late: number of consecutive samples with a late command after which the distance says nothing of the settings.
        measured_start: whether paths start at the measured angles, which tells their first samples from all others;
            otherwise a path begins where it leaves a place at which it has stood.
    """

    duration: float = 10.0
    longest: float = 60.0
    factor: float = 1.5
    allowance: float = 0.01
    samples: int = 5
    settling: float = 1.0
    grace: float = 5.0
    calm: int = 50
    late: int = 3
    measured_start: bool = True


class Trial:
    """A trial, which judges every sample.

    Args:
        rules: rules of the trial.
        predicted: largest distance of each joint from its path that the twin predicted, rad.

    Attributes:
        began: plant time of the first sample, s, with which the trial begins, also where its command was late;
            infinite before.
        measured: largest distance of each joint that counted so far, rad.
        bounds: bounds of the distance of each joint from the next motion on, rad.
        offender: joint, from 1, that failed, or 0 for none; a trial that fails without one could not judge the arm.
        judged_motion: whether a motion that began with the new settings, and with integrals that fit them, has ended.
    """

    def __init__(self, rules: TrialRules, predicted: Values) -> None:
        self.began = math.inf
        self.predicted = predicted
        self.measured: Values = (0.0,) * len(predicted)
        self.offender = 0
        self.bounds = tuple(rules.factor * distance + rules.allowance for distance in predicted)
        self._rules = rules
        self.judged_motion = False
        self._path: Values | None = None
        self._stood = False
        self._moved = False
        self._counts = False
        self._disturbed = False
        self._since = math.inf
        self._late_at = -math.inf
        self._seen = self._calm = self._beyond = self._late = 0

    def observe(self, time: float, path: Values, measured: Values) -> TrialState:
        """Judges a sample.

        Args:
            time: plant time, s.
            path: desired angles of the path, rad.
            measured: measured angles, rad.
        """
        self.began, self._since = min(self.began, time), min(self._since, time)
        away = tuple(abs(wanted - found) for wanted, found in zip(path, measured, strict=True))
        begins = max(away) <= SAME_ANGLE if self._rules.measured_start else self._stood and path != self._path
        self._moved = self._moved or (begins and time >= self.began + self._rules.settling - PERIOD / 2)
        self._stood = path == self._path
        self.judged_motion = self.judged_motion or (self._moved and self._stood)
        self._path = path
        limit = 1.0 if self._moved else INTERIM
        over = [distance / bound for distance, bound in zip(away, self.bounds, strict=True)]
        inside = max(over) <= limit
        self._seen += 1
        self._calm = self._calm + 1 if inside else 0
        was_good = self._calm == self._seen or self._counts
        self._disturbed = self._disturbed and not self._settled(time)
        self._counts = not self._disturbed and (was_good or begins or self._settled(time))
        if self._counts:
            self.measured = tuple(map(max, self.measured, away))
            self._beyond = 0 if inside else self._beyond + 1
            if self._beyond >= self._rules.samples:
                self.offender = over.index(max(over)) + 1
                return "failed"
        rules = self._rules
        enough = rules.duration if self.judged_motion and not self._disturbed else rules.longest
        if time < self.began + enough:
            return "running"
        return "failed" if self._disturbed else "passed"

    def miss(self, time: float) -> None:
        """Takes note that the command which answers the sample of a plant time (s) came late or never.

        After several in a row the distance is that of another voltage. It counts again when it has been within the
        bounds for a while, or was given the time for that.
        """
        self.began = min(self.began, time)
        self._late = self._late + 1 if time < self._late_at + 1.5 * PERIOD else 1
        self._late_at = time
        if self._late >= self._rules.late:
            self._disturbed, self._counts, self._moved, self._since = True, False, False, time
            self._calm = self._beyond = 0

    def is_over(self, time: float) -> bool:
        """Whether it has lasted as long as it may at a plant time (s) with commands that come late."""
        return self._disturbed and time >= self.began + self._rules.longest

    def ends(self) -> str:
        """When it ends at the earliest, in words."""
        least = f"{self.began + self._rules.duration:.2f} s and " if self.began < math.inf else ""
        return f"{least}the end of a motion"

    def anew(self) -> Trial:
        """The same trial from its beginning on."""
        return Trial(self._rules, self.predicted)

    def why(self) -> str:
        """Why it failed."""
        if not self.offender:
            return f"commands came late: the arm could not be judged within {self._rules.longest:g} s"
        away, bound = self.measured[self.offender - 1], self.bounds[self.offender - 1]
        return f"joint {self.offender} is {away:.3g} rad from its path, expected at most {bound:.3g}"

    def _settled(self, time: float) -> bool:
        return self._calm >= self._rules.calm or time >= self._since + self._rules.grace
