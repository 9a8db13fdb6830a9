"""Readings that were left out as spikes, and are evidence after all once the next ones confirm them."""

from __future__ import annotations

import numpy as np

from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.sensing.readings import Readings
from dtwin.monitoring.signatures import SignatureBank
from dtwin.monitoring.tracking.moments import Moments


class Recall:
    """Remembers at which sample readings were left out."""

    def __init__(self) -> None:
        self._sample = -1

    def update(
        self,
        sample: int,
        readings: Readings,
        estimator: Estimator,
        bank: SignatureBank,
        moments: Moments,
    ) -> None:
        """Takes in what was judged of a sample before it corrects the estimate.

        Args:
            sample: its number.
            readings: its readings, judged.
            estimator: the estimate, with the innovations of the sample before.
            bank: receives the evidence.
            moments: the samples before; the last one counts what was left out of it if that is confirmed.
        """
        if moments and self._sample == sample - 1 and readings.confirmed.any():
            (moment,) = moments.last(1)
            used, likelihood = moment.used.copy(), moment.likelihood
            for joint in np.flatnonzero(readings.confirmed & ~used).tolist():
                used[joint] = True
                likelihood += estimator.weigh(joint)
                bank.recall(estimator, joint, sample - 2)
            # What doubt about the motion does not explain counts, as that doubt is in how far off the reading was.
            moments.replace_last(moment._replace(used=used, likelihood=likelihood, counts=True))
        self._sample = sample if readings.left_out.any() else -1
