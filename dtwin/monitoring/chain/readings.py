"""What the readings of an arm's encoders say as they come: offsets that stay, and joints that stand or move unseen.

A jump is believed once it has stayed for STAYED and nothing else has come to explain it. Where a reading repeats
itself, the other joints tell whether its joint stands (`standing`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm
from dtwin.arm.samples import Samples
from dtwin.monitoring.chain.drives import SURE, Drives
from dtwin.monitoring.chain.encoders import GRIPPED, STILL, Encoders, Habits
from dtwin.monitoring.chain.expected import WINDOW
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.pressed import Pressed
from dtwin.monitoring.chain.standing import PAST, smoothed, standing

STAYED: Final = 0.5
"""Time after which a jump is an offset if no joint was found to stay meanwhile, s: what a joint that is locked or
hits something does to the others looks like a jump for some samples."""
_SAME_TIME: Final = 2
"""Samples by which first evidence of the drives may come before a jump that has caused it."""
_READ: Final = 2.5
"""Odds of the one of a stopped encoder and a locked joint that readings are likelier for."""
_NEEDED: Final = 6.0
"""Odds of the one that the other joints' commands are likelier for, where that is more than noise: it is named first.
Only as much as is evidence of any cause rules the other one out."""


class Readings:
    """Follows what encoders read.

    Args:
        arm: the arm as its data sheet says.
        drives: its drives, once they are known.
        habits: what its encoders showed while it was healthy.
    """

    def __init__(self, arm: Arm, drives: Drives, habits: Habits) -> None:
        self._arm = arm
        self._drives = drives
        self._encoders = Encoders(arm, habits)
        self._pressed = Pressed(drives.expected.dry, drives.expected.noise)
        self._jump: ChainFinding | None = None
        self.forget()

    def forget(self) -> None:
        """Begins a new stretch after samples that nobody knows; a jump that was seen may still be believed."""
        n = len(self._arm)
        self._past = Samples(np.zeros(0), *(np.zeros((0, n)) for _ in range(4)))
        self._pressed.forget()

    def resume(self) -> None:
        """Goes on with an arm whose last finding is answered or over."""
        self._jump = None
        self.forget()

    @property
    def jump(self) -> ChainFinding | None:
        """A jump that has not stayed for long enough to be believed."""
        return self._jump

    def follow(self, new: Samples, rests: bool) -> ChainFinding | None:
        """Takes further samples, which the drives have been judged by already; what is found in them.

        Args:
            new: the samples.
            rests: whether commands of an arm at rest are judged, too.
        """
        past = Samples(*(np.concatenate(pair) for pair in zip(self._past, new, strict=True)))
        self._past = past.rows(slice(-PAST, None))
        last = past.rows(slice(-(len(new.t) + STILL), None))
        stay = self._encoders.stay(last.t, last.q, last.target, len(new.t))
        if stay is not None and stay.kind == "lock" and not stay.others:
            presses = self._press(past)[-len(last.t) :]
            stay = self._encoders.stay(last.t, last.q, last.target, len(new.t), presses)
        if stay is None and rests:
            pressed = self._pressed.first(new.t, new.q, new.target, new.acting, np.isnan(new.effort[:, 0]))
            stay = None if pressed is None else self._encoders.repeats(*pressed)
        if stay is None:
            stay = self._encoders.repeated(past.t, past.q, len(new.t))
        jump = self._encoders.jump(last.t, last.q, last.target, len(new.t))
        if self._jump is None and jump is not None and not self._is_late(jump):
            self._jump = jump
        believed = None if self._jump is None else self._jump.time + STAYED
        if stay is not None and (believed is None or stay.time <= believed):
            self._jump = None
            return self._told_apart(stay, past)
        if believed is None or past.t[-1] < believed:
            return None
        found, self._jump = self._jump, None
        return found

    def _press(self, past: Samples) -> NDArray[np.bool_]:
        """Whether drives press on their joints by more than dry friction GRIPPED times as strong would hold, (N, n).

        So they may where nobody knows what they need, while something is held, or for how short a time.
        """
        expected, pressed = self._drives.expected, np.ones(past.q.shape, dtype=bool)
        for rows in np.ma.clump_unmasked(np.ma.masked_invalid(past.effort[:, 0])):
            known = past.rows(rows)
            if len(known.t) >= WINDOW:
                beyond = known.effort - expected.needed(smoothed(self._arm, known.q, known.effort))
                pressed[rows] = np.abs(beyond) > GRIPPED * expected.dry
        return pressed

    def _is_late(self, jump: ChainFinding) -> bool:
        """Whether there was evidence of something else before it."""
        alarm = self._drives.alarm
        return alarm is not None and alarm.time + _SAME_TIME * self._arm.period < jump.time

    def _told_apart(self, stay: ChainFinding, past: Samples) -> ChainFinding:
        """A stay, without what the commands of the other joints rule out of a stopped encoder and a locked joint."""
        if not stay.others or stay.joint is None:
            return stay
        joint = stay.joint - 1
        end = int(np.searchsorted(past.t, stay.time - 0.5 * self._arm.period)) + 1
        told = standing(
            self._arm, self._drives.expected, past.q[:end], past.effort[:end], joint, self._encoders.near(joint)
        )
        odds = np.log(_READ) if stay.kind == "lock" else -np.log(_READ)
        if told is not None:
            odds += np.clip(0.5 * told[0], -np.log(_NEEDED), np.log(_NEEDED))
            odds -= np.log(SURE) * told[0] / self._drives.sure(told[1])
        lock = float(1.0 / (1.0 + np.exp(-np.clip(odds, -50.0, 50.0))))
        first, second = (f"{kind}{stay.joint}" for kind in (("lock", "freeze") if lock > 0.5 else ("freeze", "lock")))
        share = max(lock, 1.0 - lock)
        return replace(stay, cause=first, others=(second,) if 1.0 - share > SURE else (), confidence=share)
