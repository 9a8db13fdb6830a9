"""A data sheet's model on trial: whether what is suspected of an arm that nobody has commissioned is a fault of it.

An arm that differs from its data sheet by more than noise and less than a fault - readings that come at uneven times,
a supply that ripples, cogs, an encoder's table - passes the first motion of a watch, and is suspected again and again
later on, of one cause and of another. A fault lasts, and one cause explains the motion since. So the evidence of a
sudden change counts for as much less as that of a model which lacks something; against the causes stands an arm that
nothing has befallen and on which small torques act; and what nothing confirms speaks against the model.
"""

from __future__ import annotations

import math
from typing import Final

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.diagnosis import SURE, Diagnosis
from dtwin.monitoring.dismissals import Dismissals
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.findings import Findings
from dtwin.monitoring.kinds import UNKNOWN
from dtwin.monitoring.modes import HELPS
from dtwin.monitoring.signatures import ALIKE
from dtwin.monitoring.verdict import Finding
from dtwin.signals import EventKind

ROUGH: Final = (0.03, 0.1)
"""Standard deviations of the torques that a model may lack which is only roughly that of an arm, N m."""
GRAVE: Final = 2000.0
"""Log-likelihood from which on something has befallen the arm, whatever its model lacks; chosen on effects of other
sizes than those of `tests/outside/table.py`."""
_ODD: Final = 2
"""Suspicions that nothing confirms that show that the model is not that of the arm: chance gives one in a month."""
LOUD: Final = 200.0
"""Value of a statistic from which on an arm whose model does not fit is diagnosed: grave faults pass it at once."""
WORDS: Final = f"the data sheet's model does not fit this arm: no fault explains what it does; {HELPS}"
"""What to say of every joint of an arm that is not that of its data sheet."""


class SheetTrial:
    """Whether a data sheet's model explains the arm that is watched.

    Args:
        belief: what is known of the arm; one that does not come from a data sheet alone is not on trial.

    Attributes:
        failed: whether the model has turned out not to fit: from then on only what is grave is a fault of the arm.
    """

    def __init__(self, belief: Belief) -> None:
        self._on, self._odd, self._dismissals = belief.sheet, 0, Dismissals()
        self._boxes_differ = False  # Once one has shown it, each of the others need not show it as clearly.
        self.failed = False

    def confirms(self, diagnosis: Diagnosis, top: Candidate, sample: int, pending: Finding | None) -> bool:
        """Whether a diagnosis that has ended with a sample speaks for a fault; if not it speaks against a data sheet.

        Args:
            diagnosis: the diagnosis.
            top: what it has come to.
            sample: number of the sample.
            pending: its finding, None if it was never certain that something failed.
        """
        confirmed = pending is not None and self._dismissals.confirmed(diagnosis, sample)
        if not self._on or diagnosis.certain or (confirmed and top.gain >= GRAVE):
            return confirmed
        sure = confirmed and top.gain > ALIKE * math.log(SURE / (1.0 - SURE))
        rough = sure and max(diagnosis.roughly(top, torque) for torque in ROUGH) >= top.gain
        if sure and not self.failed and not rough and top.fault.kind != UNKNOWN:
            self._boxes_differ |= top.fault.about.on_box
            return True
        if top.fault.about.on_box and self._boxes_differ:
            return confirmed
        self._odd += _ODD if sure else 1
        return False

    def doubt(self, odd: bool) -> None:
        """Takes in whether nothing has come of a suspicion, though it was confirmed."""
        self._odd += self._on and odd

    def note(self, findings: Findings, time: float, kind: str, text: str) -> None:
        """Notes what is suspected at a plant time (s), which is no news once the model is known not to fit."""
        if not self.failed:
            findings.note(time, kind, text)

    def stays(self) -> bool:
        """Whether a model that did not fit the first motion does not fit though it explains what came later: a data
        sheet's is known not to be this arm's then, and only what is grave is a fault from now on."""
        self.failed = self._on
        return self.failed

    @property
    def fails(self) -> bool:
        """Whether so many have just become too many."""
        return self._odd >= _ODD and not self.failed

    def fail(self, findings: Findings, time: float) -> dict[int, str]:
        """Says once, at a plant time (s), that the model does not fit, and strikes out what rests on it.

        Returns:
            what to say of each joint, 1 to 3.
        """
        findings.note(time, EventKind.MISFIT, WORDS)
        findings.dismiss(time)
        self.failed = True
        return dict.fromkeys((1, 2, 3), WORDS)
