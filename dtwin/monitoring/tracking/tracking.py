"""The samples of one arm as they come: readings are judged, the estimate is carried on, and evidence gathers."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.diagnosis import EXTENDED
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM, W
from dtwin.monitoring.estimation.traces import LONGEST, STANDSTILL
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.signatures import SignatureBank
from dtwin.monitoring.tracking.moments import Moment, Moments
from dtwin.monitoring.tracking.quiet import LEAST_LIKELY, WINDOW, Batch, Stretch, follow, in_doubt, quiet_rows
from dtwin.monitoring.tracking.recall import Recall
from dtwin.monitoring.tracking.samples import Samples, Tape

Array = NDArray[np.float64]
SETTLING: Final = 50
"""samples after a start before anything is suspected"""
BRIDGED: Final = 10
"""samples that may be missing in a row, with the gripper unchanged, before the motion is estimated anew"""
_NONE: Final = np.zeros(3, dtype=bool)


class Tracking:
    """Follows the samples of an arm.

    Args:
        readings: judges what the encoders say.
        bank: gathers the evidence of sudden changes.

    Attributes:
        gripper: watches the gripper by its own encoder.
        moments: the last samples.
        sample: number of the last one, -1 before the first.
        command: (4,), command that answered it, V; that of the gripper last.
        gripped: whether that command holds a box.
        used: (3,), which of its readings were taken in.
        counts: whether it is evidence.
    """

    def __init__(self, readings: Readings, bank: SignatureBank) -> None:
        self.readings, self.bank, self.gripper, self._recall = readings, bank, GripperWatch(), Recall()
        self.moments = Moments(LONGEST + EXTENDED + 2)
        self.sample, self.command, self.gripped, self.used = -1, np.zeros(4), False, _NONE
        self._doubted = 0

    def step(
        self, estimator: Estimator, angles: Array, arrived: bool, command: Array, doubt: float, trusted: bool
    ) -> Moment:
        """Takes in the next sample.

        Args:
            estimator: the arm as believed, carried over the sample here and corrected by it.
            angles: (3,), angles that it measures, rad.
            arrived: whether it did arrive.
            command: (3,), command that led to it, V.
            doubt: standard deviation of the torques that the command leaves in doubt, N m.
            trusted: whether the prediction is believed more than a single reading.
        """
        estimator.predict(command, self.gripped, doubt)
        self.used = self.readings.judge(*estimator.expected(), trusted) if arrived else _NONE
        if arrived:
            self._recall.update(self.sample, self.readings, estimator, self.bank, self.moments)
        likelihood = estimator.correct(angles, self.used)
        return Moment(command, self.gripped, doubt, angles, self.used, self.readings.fresh, False, likelihood)

    def count(self, moment: Moment, estimator: Estimator) -> Moment:
        """Notes the last sample, which is no evidence for a while after a doubtful command.

        Args:
            moment: the sample.
            estimator: the arm as believed after it.
        """
        self._doubted = in_doubt(self._doubted, moment.doubt, estimator.arrays())
        likelihood = moment.likelihood if moment.likelihood > LEAST_LIKELY else LEAST_LIKELY
        counted = moment._replace(counts=not self._doubted, likelihood=likelihood)
        self.moments.append(counted)
        return counted

    def settled(self, estimator: Estimator) -> bool:
        """Whether the next samples can be taken in many at once."""
        return self.gripped == estimator.gripped and self.readings.settled and estimator.plain

    def repeating(self, estimator: Estimator) -> bool:
        """Whether an encoder repeats its reading that seldom does while it works."""
        return self.readings.repeating([abs(speed) > STANDSTILL for speed in estimator.x[W:ARM].tolist()])

    def follow(self, estimator: Estimator, threshold: float, seen: Samples, most: int, tape: Tape) -> Stretch:
        """Takes in as many of some samples as come in a row, up to the first at which there is more to do.

        The last one is noted only if it is concluded.

        Args:
            estimator: the arm as believed.
            threshold: value of the largest statistic above which there is more to do.
            seen: samples.
            most: number of them that are taken in at most.
            tape: receives what is made of them, but for the last one.
        """
        sample, measured, volts, gripped, jaw = seen.part(slice(min(WINDOW, most)))
        told = np.hstack((measured, volts))
        rows = quiet_rows(self.sample, self.gripped, sample.copy(), told, gripped.copy())
        rows = self.gripper.calm(sample[:rows], jaw[:rows], volts[:rows, 3]) if rows else 0
        if not rows:
            return Stretch(0, (), self._doubted, True)
        batch = Batch(self.sample + 1, told[:rows], self.command.copy(), self._doubted)
        stretch = follow(estimator, self.readings, self.bank, threshold, batch, tape)
        done = stretch.done
        self.gripper.pass_over(sample[:done], jaw[:done], volts[:done, 3])
        self.sample += done
        self.command, self.gripped, self.used = volts[done - 1], bool(gripped[done - 1]), stretch.last.used
        self._doubted = stretch.doubted
        self._recall.update(self.sample, self.readings, estimator, self.bank, self.moments)
        self.moments.extend(stretch.columns, done if stretch.concluded else done - 1)
        return stretch
