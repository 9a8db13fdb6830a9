"""What speaks for a candidate beyond what the model of the healthy arm lacks anyway."""

from __future__ import annotations

from collections.abc import Mapping

from dtwin.monitoring.candidate import AT_ONCE, Candidate
from dtwin.monitoring.hypotheses import TORQUES
from dtwin.monitoring.kinds import FaultId


class Charges:
    """What candidates have to be more likely by, because what the model lacks was seen to look like their causes.

    Args:
        charges: that of each of JUMPS, 0 where there is none.
    """

    def __init__(self, charges: Mapping[str, float]) -> None:
        self._charges = charges
        self._of: dict[tuple[FaultId, ...], float] = {}

    def of(self, candidate: Candidate) -> float:
        """That of a candidate; an unknown torque may be all of what the model lacks."""
        faults = candidate.faults
        if faults not in self._of:
            states = (state for fault in faults for state in fault.states or map(fault.named, TORQUES))
            self._of[faults] = max(self._charges.get(state, 0.0) for state in states)
        return self._of[faults]

    def evidence(self, candidate: Candidate) -> float:
        """What speaks for a candidate; what an encoder jumps by shows in one sample, and no model lacks that."""
        return candidate.gain - max(self.of(candidate) - at_once(candidate), 0.0)


def at_once(candidate: Candidate) -> float:
    """What one sample tells of an encoder's jump, of which no other sample is a repetition."""
    return candidate.peak if candidate.fault.kind in AT_ONCE else 0.0
