"""The first seconds of a watch: the noise of the encoders is judged while the arm stands still.

At rest an innovation is noise and what the estimate has taken up of it, however wrong the model of the motion is.
What is judged there holds in motion too, where an error of the model cannot be told from noise. An estimator that
takes lasting noise for motion hides a part of it, so the same samples are heard again with the noise as judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM, W
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.modes import STARTING
from dtwin.monitoring.sensing.noise import Noise, judge
from dtwin.monitoring.signatures import SignatureBank
from dtwin.monitoring.tracking.moments import Moment, Moments

Array = NDArray[np.float64]

HEARD: Final = 400
"""samples at rest from which the noise is judged"""
PATIENCE: Final = 1000
"""samples after which it is judged by what there was of rest"""
ROUNDS: Final = 3
"""times that the samples are heard"""
_STILL: Final = 0.05
"""rad/s"""
_CALMED: Final = 30
"""samples that a joint has to stand still before its readings count"""
_SEGMENT: Final = 50
"""samples at rest in a row that tell something"""
_FEWEST: Final = 200
"""samples at rest below which nothing is judged"""


class Listening:
    """Collects innovations at rest until the noise can be judged.

    Attributes:
        left: samples still to come at most.
    """

    def __init__(self) -> None:
        self._segments: list[list[Array]] = [[]]
        self._calm = self._heard = 0
        self.left = PATIENCE

    def update(self, estimator: Estimator, used: NDArray[np.bool_]) -> bool:
        """Takes in what an estimator made of a sample, with the readings used, (3,); whether it was the last one
        needed."""
        still = used.all() and np.abs(estimator.x[W:ARM]).max() < _STILL
        self._calm = self._calm + 1 if still else 0
        if self._calm > _CALMED:
            self._segments[-1].append(estimator.innovation.copy())
            self._heard += 1
        elif self._segments[-1]:
            self._segments.append([])
        self.left = max(self.left - 1, 0) if self._heard < HEARD else 0
        return not self.left

    def judge(self) -> tuple[Noise, ...]:
        """The noise of each encoder; nothing if the arm has not stood still for long enough."""
        told = [_level(np.array(segment)) for segment in self._segments if len(segment) >= _SEGMENT]
        if sum(map(len, told)) < _FEWEST:
            return ()
        return tuple(judge([segment[:, joint] for segment in told]) for joint in range(3))


def with_noise(belief: Belief, tuning: Tuning, moments: Moments, listening: Listening) -> Belief:
    """A belief with the noise that was heard.

    Args:
        belief: the belief that the samples were watched with.
        tuning: how the estimator is tuned.
        moments: the samples, in a row.
        listening: what was heard of them.

    Returns:
        the belief, the same object if the noise is as believed.
    """
    heard = _with(belief, listening.judge())
    for _ in range(ROUNDS - 1):
        if not any(noise > believed for noise, believed in zip(heard.noise, belief.noise, strict=True)):
            break
        again, estimator = Listening(), Estimator(heard, tuning)
        for moment, _ in _replayed(estimator, moments):
            again.update(estimator, moment.used)
        heard = _with(belief, again.judge())
    return heard


def replay(estimator: Estimator, moments: Moments, bank: SignatureBank, sample: int) -> list[Moment]:
    """Lets a new estimator and a signature bank follow samples again, of which the last has the given number.

    Returns:
        the samples with their likelihoods as they are now.
    """
    bank.clear()
    start, again = sample - len(moments) + 1, []
    for age, (moment, regripped) in enumerate(_replayed(estimator, moments)):
        again.append(moment)
        if regripped:
            bank.regrip()
        if age:
            bank.update(estimator, moment.used, moment.used, start + age, moment.counts and age > STARTING)
        else:
            bank.note(estimator, start)
    return again


def _replayed(estimator: Estimator, moments: Moments) -> Iterator[tuple[Moment, bool]]:
    """Lets a new estimator follow samples in a row: yields each with its likelihood, and whether the gripper has
    changed, when it has been taken in."""
    for number, moment in enumerate(moments.last(len(moments))):
        regripped = number > 0 and moment.gripped != estimator.gripped
        likelihood = moment.likelihood
        if number:
            estimator.predict(moment.volts, moment.gripped, moment.doubt)
            likelihood = estimator.correct(moment.measured, moment.used)
        else:
            estimator.initialise(moment.measured, moment.gripped)
        yield moment._replace(likelihood=likelihood), regripped


def _with(belief: Belief, heard: Sequence[Noise]) -> Belief:
    pairs = list(zip(heard, belief.noise, strict=True)) if heard else []
    if not any(noise.differs(believed) for noise, believed in pairs):
        return belief
    white = tuple(noise.white if noise.differs(believed) else believed for noise, believed in pairs)
    return replace(belief, noise=white, clip=tuple(noise.clip for noise in heard))


def _level(segment: Array) -> Array:
    """The rest of a straight line through each column, (n, 3)."""
    x = np.linspace(-1.0, 1.0, len(segment))
    centred: Array = segment - segment.mean(axis=0)
    rest: Array = centred - np.outer(x, x @ centred / (x @ x))
    return rest
