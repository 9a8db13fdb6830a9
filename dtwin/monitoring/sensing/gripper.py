"""Whether the jaw goes where its motor drives it, by the gripper's own encoder.

The jaw is one hinge between two stops, decoupled from the arm: J w' = K u - D w. Within twice the time that the data
sheet's motor would take, it has to go half of its way. A jaw that closes may meet a box, so only the first half of
the way to the stop counts. Where it has been it must not leave while it is driven there. A jaw that was
never seen to go where it is driven has no encoder, and is not judged.

A jaw that is driven against a box stands still. When it does not any more, the box has moved between the pads, or the
motor does not hold it: the box pushes the jaw open either way, and only then the motor closes it or does not.
"""

from __future__ import annotations

import copy
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import PERIOD, GripperParameters
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]

_LEAST_WAY: Final = 0.05
"""Way that is too short to judge a motor by, rad."""
_BACK: Final = 0.05
"""How far a jaw may come back from where it has been driven, rad."""
_SLOWER: Final = 2.0
"""How much slower than the data sheet's a motor may be."""
_STANDS: Final = 0.005
"""How far readings of a jaw that stands differ, rad: three steps of an encoder of 12 bits."""
_STOOD: Final = 30
"""Number of samples after which a jaw counts as standing."""
_MOVING: Final = 2
"""Number of samples for which readings of a jaw that moves do not differ by more than those of one that stands."""
_TELLS: Final = 60
"""samples after which a jaw that was pushed open and has come neither farther nor back is no failure"""
_UNSEEN: Final = 10
"""samples that may be missing in a row before nobody knows whether the jaw was driven elsewhere in between"""
_DRIVEN: Final = 0.5
"""Share of the voltage of the gripper from which on it counts as driven."""


class GripperWatch:
    """Follows one gripper.

    Args:
        gripper: the gripper as it was designed.

    Attributes:
        fails: whether the jaw does not do what it is driven to, as far as it has been driven.
        since: number of the sample at which that began.
        stirred: number of the sample at which what last stood between the pads began to move; -1 before any.
    """

    def __init__(self, gripper: GripperParameters | None = None) -> None:
        self._gripper = gripper or GripperParameters()
        self._direction, self._judged, self._moves = 0, True, False
        self._start, self._from, self._farthest, self._way, self._late = 0, 0.0, 0.0, 0.0, 0
        self._place, self._reached, self._held, self._last = 0.0, 0, 0.0, 0
        self.fails, self.since, self.stirred = False, 0, -1

    def update(self, sample: int, angle: float, volts: float) -> bool:
        """Takes in a sample and the command that answered it; returns whether `fails` has changed.

        Args:
            sample: its number.
            angle: reading of the gripper's encoder, rad; one that is no number says nothing.
            volts: voltage of the gripper, V.
        """
        if not (math.isfinite(angle) and math.isfinite(volts)):
            return False
        unseen = not 0 < sample - self._last <= _UNSEEN + 1
        failed, direction, self._last = self.fails, self._driven(volts), sample
        if direction != self._direction or unseen:
            self._start_move(sample, angle, direction)
        if not direction:
            return False
        moved, goes = direction * (angle - self._from), direction * (angle - self._place) > 0.0
        if abs(angle - self._place) > _STANDS:
            stood = self._judged and self._moves and sample >= self._reached + _STOOD
            if direction < 0 and stood and self.stirred < self._start:
                self.stirred, self._held = sample, self._place
            self._place, self._reached = angle, sample
        self._farthest = max(self._farthest, moved) if goes else self._farthest
        if not self._judged and (moved >= 0.5 * self._way or sample >= self._late):
            self._judged, self._moves = True, self._moves or moved >= 0.5 * self._way
            self.fails = self._moves and moved < 0.5 * self._way
            self.since = self._start if self.fails and not failed else self.since
        elif self._moves and moved < self._farthest - _BACK and not failed:
            self.fails, self.since = True, sample
        return self.fails != failed

    @property
    def undecided(self) -> bool:
        """Whether the jaw has let what it held push it open and not yet shown whether it closes all the same."""
        pushed = self._direction < 0 and self._start <= self.stirred and self._place > self._held
        return pushed and not self.fails and self._last < self.stirred + _TELLS

    def calm(self, sample: NDArray[np.int64], angle: Array, volts: Array) -> int:
        """The number of samples, from the first one on, that change nothing of `fails`.

        Args:
            sample, angle, volts: (N,), as for `update`.
        """
        if self._goes_on(angle, volts) >= 0.0:
            return len(sample)
        ahead = copy.copy(self)
        rows = zip(sample.tolist(), angle.tolist(), volts.tolist(), strict=True)
        return next((row for row, each in enumerate(rows) if ahead.update(*each)), len(sample))

    def pass_over(self, sample: NDArray[np.int64], angle: Array, volts: Array) -> None:
        """Takes in samples that change nothing of `fails`; (N,), as for `update`."""
        farthest = self._goes_on(angle, volts)
        if farthest >= 0.0:
            self._farthest, self._last = farthest, int(sample[-1])
            return
        for each in zip(sample.tolist(), angle.tolist(), volts.tolist(), strict=True):
            self.update(*each)

    def _goes_on(self, angle: Array, volts: Array) -> float:
        """How far the jaw has gone after samples that tell nothing new, below 0 if they do; see `_farthest`."""
        if not self._judged:
            return -1.0
        least, direction = _DRIVEN * self._gripper.volts, self._direction
        how = (direction, self._from, self._farthest, self._place, least)
        return float(_farthest(*how, angle.copy(), volts.copy()))

    def _start_move(self, sample: int, angle: float, direction: int) -> None:
        """The drive changes with a sample.

        A jaw that moves the other way has to be braked first, which takes no farther and no longer than it has gone.
        """
        gripper = self._gripper
        middle = 0.5 * (gripper.closed + gripper.opened)
        moves = self._direction * (angle - self._place) > 0.0 and sample <= self._reached + _MOVING
        turns = moves and direction == -self._direction
        braking, coasts = (sample - self._start, self._farthest) if turns else (0, 0.0)
        begin = angle - direction * coasts
        way = gripper.opened - begin if direction > 0 else begin - middle
        self._direction, self._start, self._from, self._farthest, self._way = direction, sample, begin, 0.0, way
        self._place, self._reached, self.stirred = angle, sample, min(self.stirred, sample - 1)
        self._judged = not direction or way < _LEAST_WAY
        time = 0.0 if self._judged else self._time_for(0.5 * way)
        self._late = sample + braking + math.ceil(_SLOWER * time / PERIOD)

    def _driven(self, volts: float) -> int:
        """1 while the gripper is opened, -1 while it is closed, 0 while neither."""
        least = _DRIVEN * self._gripper.volts
        return (volts >= least) - (volts <= -least)

    def _time_for(self, way: float) -> float:
        """The time that the data sheet's motor takes for a way (rad) from rest, s.

        Damping takes some percent of so short a way, far less than the doubt about the motor.
        """
        gripper = self._gripper
        return math.sqrt(2.0 * way * gripper.inertia / (gripper.voltage_constant * gripper.volts))


@kernel
def _farthest(
    direction: int, start: float, farthest: float, place: float, least: float, angle: Array, volts: Array
) -> float:
    """How far a jaw has gone at most after samples that tell of the same drive and of a jaw that stays in its place.

    It is below 0 if they do not.

    Args:
        direction: 1 while the gripper is opened, -1 while it is closed, 0 while neither.
        start: angle at which the drive began, rad.
        farthest: how far the jaw has gone so far, rad.
        place: angle at which it stands, rad.
        least: voltage from which on the gripper counts as driven, V.
        angle, volts: (N,), as for `GripperWatch.update`.
    """
    most = farthest
    for k in range(len(angle)):
        driven = 1 if volts[k] >= least else -1 if volts[k] <= -least else 0
        # What is no number compares with nothing.
        if driven != direction or not abs(angle[k] - place) <= _STANDS or not abs(volts[k]) < np.inf:
            return -1.0
        most = max(most, direction * (angle[k] - start))
    for k in range(len(angle)):
        if direction * (angle[k] - start) < most - _BACK:
            return -1.0
    return most
