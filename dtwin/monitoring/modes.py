"""The modes of the monitor, each with just the state that it needs, and the record that tells when it is lost.

    settling     the motion is not known well, or a diagnosis has just ended: nothing is suspected
    watching     the evidence of a sudden change is compared with the threshold
    diagnosing   a sudden change is being isolated
    lost         the arm moves like none that is known; sudden changes lead back to the last arm that was
    unfit        the model has never explained how this arm moves: nothing that it shows is called a fault

Settling leads to the mode that it came from, watching to diagnosing or unfit, diagnosing to settling, and lost and
unfit to settling or watching.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ParameterError, choices
from dtwin.monitoring.diagnosis import LEAST, Diagnosis
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM, W
from dtwin.monitoring.kinds import JUMPS, UNKNOWN, FaultId, parse_fault_id
from dtwin.monitoring.sensing.stopped import repeating, stands_still
from dtwin.monitoring.signatures import Limits, SignatureBank
from dtwin.monitoring.tracking.tracking import Tracking
from dtwin.monitoring.verdict import OWN as OWN
from dtwin.monitoring.verdict import Finding

LOST: Final = 5
"""diagnoses within LOST_WITHIN that show that none of them was right"""
STARTING: Final = 10
"""samples after a start that are no evidence: the speeds are not known"""
PROVEN: Final = 400
"""samples of motion that a model has to explain before what it does not explain is a fault of the arm"""
_RETURNED: Final = 1500
"""samples of motion after which a model that did not fit does, and an arm is understood of which something was
unknown or was taken away"""
_LASTING: Final = ("torque", "loss", "hold", "stop")
"""hypotheses of what no parameter makes good: the arm moves otherwise each time that it shows"""
_FAST: Final = 0.1
"""rad/s"""
HELPS: Final = "identify the arm with `dtwin commission LOG --out RECORD`, and watch it with `--commissioned RECORD`"
"""What to do about a model that does not fit, in words."""
_OFF: Final = 4.5
"""standard deviations: a joint that was farther off is named"""
LOST_WITHIN: Final = 600
"""samples"""
_MATTERS: Final = 3
"""diagnoses of different matters within _MATTERS_WITHIN that show that none of them was right"""
_MATTERS_WITHIN: Final = 2000
"""samples"""
_DRIVE: Final = ("K", "D", "mu", "friction")
"""kinds of changes of a joint's drive: one that lasts is told once, not again and again as another one"""
_DRIVE_WITHIN: Final = 3000
"""samples"""


@dataclass(frozen=True, slots=True)
class Watching:
    """Waits for evidence of a sudden change."""


@dataclass(frozen=True, slots=True)
class Lost:
    """Waits until the arm as believed explains the motion again; `sound` is the last estimator that did."""

    sound: Estimator


@dataclass(frozen=True, slots=True)
class Unfit:
    """Waits until the model explains the motion after all; `explained` counts the samples of motion that it has."""

    explained: int = 0

    @property
    def over(self) -> bool:
        """Whether the model fits after all."""
        return self.explained >= _RETURNED

    def after(self, estimator: Estimator) -> Unfit:
        """The mode after another sample that the model has explained."""
        return Unfit(self.explained + _moves(estimator))


@dataclass(frozen=True, slots=True)
class Settling:
    """Waits until the estimate has settled.

    Attributes:
        left: samples until then.
        known: the value of `left` from which on the speeds are known, so that samples are evidence.
        begun: whether the motion is estimated anew, so that a fault may have come meanwhile and evidence is gathered.
        then: the mode that follows.
    """

    left: int
    known: int
    begun: bool
    then: Watching | Lost | Unfit


@dataclass(frozen=True, slots=True)
class Diagnosing:
    """Isolates a sudden change.

    Attributes:
        diagnosis: the candidates.
        pending: the finding so far, None until it is certain that something failed.
        known: name of the finding that an operator has taken to be known, "" for whatever it will come to; None if
            nobody has.
    """

    diagnosis: Diagnosis
    pending: Finding | None = None
    known: str | None = None

    @property
    def news(self) -> Finding | None:
        """The finding so far unless it is known."""
        return self.pending if self.known is None else None

    def acknowledged(self, parameter: str) -> Diagnosing:
        """The mode after an operator has taken a finding to be known, "" for any."""
        told = self.news is not None and parameter in ("", self.news.parameter)
        return replace(self, known=parameter) if told else self

    def known_of(self, settled: Iterable[Finding]) -> list[str]:
        """The names of those of the findings that it has come to that are known already."""
        return [found.parameter for found in settled if self.known in ("", found.parameter)]


Mode = Settling | Watching | Diagnosing | Lost | Unfit


def suspected(mode: Mode, bank: SignatureBank, warning: float) -> FaultId | None:
    """What may be wrong: what is isolated, or what the evidence speaks for most, if that is beyond a warning."""
    if isinstance(mode, Diagnosing):
        return mode.diagnosis.best()[0].fault if mode.known is None else None
    possible = isinstance(mode, Watching | Lost) and bank.worst() >= warning
    return bank.suspicions()[0].fault if possible else None


def diagnosing(
    least: float,
    stopped: Sequence[int],
    track: Tracking,
    sizes: dict[str, float],
    by: Limits,
    misfit: float,
    locked: bool,
) -> Diagnosing:
    """The mode in which a diagnosis begins with the last sample.

    Args:
        least: statistic of what is suspected at least; of a joint that stands still only what its motion has told
            before is a cause beside those of standing still.
        stopped: joints (1 to 3) that stand still, or their encoders do.
        track: the samples.
        sizes, misfit, locked: see `Diagnosis`.
        by: what decides.
    """
    where = track.readings, track.sample, track.bank
    still, resting = (stands_still(joints, *where) for joints in (stopped, repeating(track.readings)))
    seen = (track.bank.suspicions(least), track.moments, track.sample, sizes, locked, still, resting)
    return Diagnosing(Diagnosis(*seen, temper=by.temper, misfit=misfit, charges=by.charges))


def overtaken(mode: Diagnosing, track: Tracking, threshold: float) -> bool:
    """Whether something has come after the alarm of a diagnosis that nothing had come of yet: none of its candidates
    has that onset, so that it would be given another name or be dismissed.

    Args:
        mode: the diagnosis.
        track: the samples, of which the bank has taken in those since the alarm as well.
        threshold: value of a statistic from which on a change is diagnosed.
    """
    diagnosis, bank = mode.diagnosis, track.bank
    if diagnosis.certain or track.sample <= diagnosis.alarm + LEAST or not bank.exceeds(threshold):
        return False
    return bank.suspicions()[0].onset.sample > diagnosis.alarm


def statistic(mode: Mode, bank: SignatureBank, threshold: float) -> float:
    """The strongest evidence of a sudden change, 2 log likelihood ratio beyond what is allowed for; the threshold
    while one is diagnosed, 0 while the estimate settles."""
    if isinstance(mode, Diagnosing):
        return threshold
    return 0.0 if isinstance(mode, Settling) else bank.worst()


def statistics(mode: Mode, bank: SignatureBank) -> NDArray[np.float64]:
    """The strongest evidence of a sudden change of each of JUMPS, (18,), 2 log likelihood ratio; 0 while one is
    diagnosed, and while the estimate settles."""
    return np.zeros(len(JUMPS)) if isinstance(mode, Diagnosing | Settling) else bank.statistics().max(axis=0)


def acknowledged(mode: Mode, known: Mapping[str, None], parameter: str) -> Mode:
    """The mode after an operator has taken what is known by name, or is diagnosed, to be as it is; "" for all of it.

    Raises:
        ParameterError: nothing of that name is wrong.
    """
    pending = mode.news if isinstance(mode, Diagnosing) else None
    names = list(known if pending is None else {**known, pending.parameter: None})
    if parameter and parameter not in names:
        there = f"expected {choices(names)}" if names else "there is nothing to acknowledge"
        raise ParameterError(f"no finding {parameter!r}: {there}")
    return mode.acknowledged(parameter) if isinstance(mode, Diagnosing) else mode


def settling(mode: Mode, left: int, begun: bool) -> Settling:
    """Settles for some samples; who was lost is lost after that. The last arguments are as in `Settling`."""
    then = mode.then if isinstance(mode, Settling) else mode
    return Settling(left, left - STARTING, begun, Watching() if isinstance(then, Diagnosing) else then)


class Turn(NamedTuple):
    """A diagnosis that was settled, and what was believed before.

    Attributes:
        sample: number of the sample at which it was settled.
        detected: plant time at which the change had been noticed, s.
        estimator: the arm as believed before the change.
        findings: the findings by parameter that stood before.
        faults: what it came to, nothing for what is over.
    """

    sample: int
    detected: float
    estimator: Estimator
    findings: dict[str, Finding]
    faults: tuple[FaultId, ...]


class Turns:
    """The last diagnoses that were settled.

    What is found before the arm, as it is believed since the first of them, has explained its motion for a while may
    be a consequence of that one: the arm has hit something, is held where it shall not be, or is not yet understood.
    That takes longer where the first one is unknown, and shows again, or takes a motor, a joint or an encoder away.
    """

    def __init__(self) -> None:
        self._turns: deque[Turn] = deque(maxlen=LOST)
        self._first, self._lasting = "", False
        self._told: list[FaultId] = []
        self._explained, self._earned = 0, 1.0
        self._doubted: dict[str, float] = {}

    @property
    def understood(self) -> bool:
        """Whether the arm has explained its motion since."""
        return not self._first

    def moved(self, mode: Watching | Lost, estimator: Estimator, current: dict[str, Finding]) -> None:
        """Takes in a sample that nothing is suspected from; while the monitor is lost none explains anything.

        What might have been a consequence, and is among the current findings, by parameter, once the arm as believed
        with it has explained its motion, is none.
        """
        if self._first and isinstance(mode, Watching):
            self._explained += _moves(estimator)
            if self._explained >= (_RETURNED if self._lasting else PROVEN):
                self._first, self._told, self._lasting = "", [], False
                for name, sure in self._doubted.items():
                    if name in current:
                        current[name] = msgspec.structs.replace(current[name], confidence=sure, follows="")
                self._doubted = {}

    def judged(self, found: Finding, faults: Sequence[FaultId]) -> Finding:
        """What a diagnosis has come to, no surer than what may be a consequence can be.

        Args:
            found: its finding.
            faults: all that it has come to; what tells of the first matter again, or of what that was said to be
                instead, is no consequence of it.
        """
        again = all(any(fault.same_matter(told) for told in self._told) for fault in (found.fault, *faults))
        if again or not self._first:
            return found
        self._earned = found.confidence
        return msgspec.structs.replace(found, confidence=min(found.confidence, OWN), follows=self._first)

    def tell(self, settled: Sequence[Finding]) -> None:
        """Takes in the findings that a diagnosis has come to."""
        first = self._first
        for found in settled:
            self._doubted.pop(found.parameter, None)
            if found.follows == first != "":
                self._doubted[found.parameter] = self._earned
            self._first = self._first or found.parameter
            self._lasting = self._lasting or found.fault.about.hypothesis in _LASTING
            # What an unknown cause may be instead has not explained the motion.
            instead = () if found.fault.kind == UNKNOWN else found.others
            self._told += [] if found.follows else [found.fault, *map(parse_fault_id, instead)]
            self._explained = 0

    def enter(self, turn: Turn) -> None:
        """Notes a diagnosis."""
        self._turns.append(turn)

    def astray(self, sample: int) -> Turn | None:
        """The first of the diagnoses up to a sample that none can have been right, which are forgotten then; None if
        they do not show that: so many in a short time, or in a longer one so many of different matters, or so many of
        the drive of one joint."""
        turns = list(self._turns)
        if len(turns) < LOST or turns[0].sample <= sample - LOST_WITHIN:
            lately = [turn for turn in turns if turn.sample > sample - _MATTERS_WITHIN]
            longer = [turn for turn in turns if turn.sample > sample - _DRIVE_WITHIN]
            turns = lately if _different(lately) >= _MATTERS else _of_one_drive(longer)
        if len(turns) < _MATTERS:
            return None
        self._turns.clear()
        return turns[0]


def _different(turns: Iterable[Turn]) -> int:
    """The number of diagnoses that tell of nothing that one before them has told of."""
    told: list[FaultId] = []
    count = 0
    for turn in turns:
        count += bool(turn.faults) and not any(fault.same_matter(other) for fault in turn.faults for other in told)
        told += turn.faults
    return count


def _of_one_drive(turns: Sequence[Turn]) -> list[Turn]:
    """The diagnoses that tell of the drive of that joint of which most do."""
    joints = [{fault.joint for fault in turn.faults if fault.kind in _DRIVE} for turn in turns]
    most = max((1, 2, 3), key=lambda joint: sum(joint in each for each in joints))
    return [turn for turn, each in zip(turns, joints, strict=True) if most in each]


class Probation:
    """The first motion of a watch: whether the model fits this arm at all.

    An arm that is not the model's shows it as soon as it moves, and looks like one with a fault that has always been
    there. Only an arm whose motion the model has explained for a while can be said to have changed.

    Attributes:
        moved: samples of motion so far.
    """

    def __init__(self) -> None:
        self.moved = 0
        self._furthest = np.zeros(3)

    @property
    def passed(self) -> bool:
        """Whether the model has explained enough motion."""
        return self.moved >= PROVEN

    def update(self, estimator: Estimator, used: NDArray[np.bool_], counts: bool) -> None:
        """Takes in what the estimator made of a sample: which readings were used, (3,), and whether they count."""
        if self.passed:
            return
        self.moved += _moves(estimator)
        if counts:
            off = np.abs(estimator.innovation) / np.sqrt(estimator.variance)
            self._furthest = np.where(used, np.maximum(self._furthest, off), self._furthest)

    def misfit(self) -> dict[int, str]:
        """What to say of a model that does not fit, by the joints (1 to 3) at which it shows."""
        joints = [i for i in range(3) if self._furthest[i] > _OFF] or [int(self._furthest.argmax())]
        return {
            i + 1: f"the model does not fit this arm: joint {i + 1} is up to {self._furthest[i]:.1f} standard"
            f" deviations from where it predicts it; {HELPS}"
            for i in joints
        }


def _moves(estimator: Estimator) -> bool:
    """Whether any joint moves, as it is estimated."""
    return bool(np.abs(estimator.x[W:ARM]).max() > _FAST)
