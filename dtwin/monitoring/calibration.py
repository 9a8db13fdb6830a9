"""What the model does not explain of a healthy arm, learned from a log of its work.

The torques that last are found as the EM algorithm finds them (Shumway and Stoffer, J. Time Series Analysis 3, 1982),
with the filter's estimates in place of the smoother's: the estimator follows the log with some standard deviation of
these torques, and what it estimates them to be, and how surely, gives the next one.

How long they last, how much gears move a link without torque, how far they swing, and how much of the dry friction
is in doubt near standstill, is chosen by what the monitor is for. The readings would be most likely under what fits
most of them, but the threshold depends on the rare ones. So the choice is that under which a sudden change of a
tenth of a plausible size most probably passes, within two seconds, the threshold that the healthy arm asks for, and
what names it.

What jaws push with as they close, and what the weight of a box does while it comes and goes, is first taken to be all
that a box weighs on the outstretched arm. It is as much less as leaves the readings of those moments no farther off,
in their standard deviations, than all others.

The statistic of the signature bank is then observed over the whole log. How often a healthy arm passes which value,
and how fast that gets rarer, tells from where on it is an alarm: peaks over a threshold with exponential excesses
(Davison and Smith, J. Royal Statistical Society B 52, 1990).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, gammaincinv

from dtwin.errors import ParameterError
from dtwin.identification.machine.record import LEARNED, Healthy, Learned, MachineRecord, Passed
from dtwin.monitoring.diagnosis import DECIDED
from dtwin.monitoring.estimation.belief import Array, Belief, Tail, Unmodelled, commissioned
from dtwin.monitoring.estimation.estimator import HANDLING, TOUCHING, Estimator
from dtwin.monitoring.estimation.following import misfit_after
from dtwin.monitoring.estimation.kernels import swung
from dtwin.monitoring.estimation.layout import ARM_NAMES, INDEX, MOVING, TORQUE
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.kinds import BIAS, JUMPS, plausible_sizes
from dtwin.monitoring.learning.wandering import wandered
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream
from dtwin.monitoring.sensing.commands import closes
from dtwin.monitoring.settings import MonitorSettings
from dtwin.monitoring.signatures import limits
from dtwin.monitoring.tracking.samples import Tape
from dtwin.parameters import GRAVITY, PERIOD, ArmParameters, JointVector, joint_vector

Flags = NDArray[np.bool_]

SHARES: Final = (1.0, 0.6, 0.4, 0.25)
"""Shares of the root mean square of the torques that last. A few large torques are most of it."""
MEMORIES: Final = (0.1, 0.3, 1.0)
"""Times that the torques may last, s."""
COMPLIANCES: Final = (0.0, 0.5, 1.0, 2.0)
"""How much more than on average gears may swing after a jump of the torque."""
DISPLACEMENTS: Final = (0.0, 2e-4, 5e-4, 1e-3)
"""Angles by which gears may move a link in a sample, rad, standard deviations."""
STICKING: Final = (1.0, 0.5, 0.25)
"""Shares of the dry friction that may be in doubt near standstill."""
PUSHES: Final = (0.5, 0.2, 0.1, 0.05)
"""Shares of the torque of a box on the outstretched arm that may be all that acts while jaws close, or open."""
FEWEST: Final = 5
"""Boxes that tell so."""
FIRST: Final = 6000
"""Samples that the torques are learned from."""
TRIED: Final = 12000
"""Samples by which these choices are judged."""
LEAST: Final = 30.0
"""Shortest log, s."""
_FIRST: Final = 0.01
_ROUNDS: Final = 4
_AGAIN: Final = ("slow", "compliance")
"""What depends most on the rest, and is chosen again."""
_TINY: Final = 1e-300
_CLIP: Final = 4.0
"""Standard deviations beyond which a reading counts less: spikes."""
_SETTLED: Final = 100
"""Samples after a start that tell nothing."""
SETTLING: Final = 1000
"""Samples after a start in which the statistic tells what is learned of the arm."""
_BLOCK: Final = round(1.0 / PERIOD)
"""Samples of which the largest statistic is one observation: a second."""
_BIASES: Final = ("bias1", "bias2", "bias3")
_PEAKS: Final = 0.9
"""Share of these observations that are no peaks."""
_DOUBT: Final = 0.05
"""Chance that larger excesses on average would have come out as small as those that were seen."""
_SMALL: Final = 0.1
"""Share of a plausible change that shall show."""
_NAMED: Final = math.log(DECIDED / (1.0 - DECIDED))
"""Log odds of a cause against another with which it is named."""
_CONFIRMED: Final = np.array([not fault.startswith(BIAS) for fault in JUMPS])
"""The faults that take more than one sample to name."""
_SOON: Final = 2.0
"""s, time in which a change shall show."""
_FITS: Final = 1.5
"""Misfit up to which a cause explains any arm's motion, see `misfit_after`; 1 is that of a true model."""
_SPARE: Final = 1.5
"""How much farther than the healthy arm does a cause may go, that arm being watched for some minutes only."""
_EVERY: Final = 20
"""Number of samples of which one tells how well a change shows."""


def calibrated(belief: Belief, seen: Stream, progress: Callable[[str], None] = lambda text: None) -> Belief:
    """What there is to believe of an arm after its work was watched.

    Beside what the model does not explain and how far the monitor's statistic goes while the arm is healthy these are
    the parameters and offsets that the monitor came to, so that it need not learn them again at every start.

    Args:
        belief: what is known of the arm.
        seen: what sensors and commands said of the healthy arm at work.
        progress: is told in words how far it is.

    Raises:
        ParameterError: the log is too short, or has too many gaps.
    """
    if len(seen) * PERIOD < LEAST:
        raise ParameterError(f"the log has {len(seen) * PERIOD:g} s: expected at least {LEAST:g} s of healthy work")
    error = _chosen(belief, seen.part(0, TRIED), progress)
    progress("watches the arm to learn it")
    belief = replace(belief, error=error)
    learned = _after(replace(belief, rates=wandered(belief, seen)), seen)
    learned = replace(learned, error=_pushed(learned, seen))
    error = learned.error
    progress(
        f"up to {1e3 * error.pushing:.0f} mN m while jaws close, {1e3 * error.grip:.0f} mN m as a box comes or goes"
    )
    progress("watches the arm as it has learned it")
    found = _watched(learned, seen)
    return replace(learned, tails=_tails(found.statistics), misfit=max(_FITS, _SPARE * found.misfit))


def watched(
    record: MachineRecord, seen: Stream, progress: Callable[[str], None] = lambda text: None
) -> MachineRecord:
    """A record with what the arm does at work that its numbers do not explain; arguments as for `calibrated`."""
    belief = calibrated(commissioned(msgspec.structs.replace(record, healthy=None)), seen, progress)
    values = {name: belief.arm.get(name) for name in ARM_NAMES} | dict(zip(_BIASES, belief.offset, strict=True))
    spread = dict(zip(ARM_NAMES, np.sqrt(belief.covariance.diagonal()).tolist(), strict=True))
    spread |= dict(zip(_BIASES, belief.offset_deviation, strict=True))
    error = belief.error
    healthy = Healthy(
        slow=error.slow,
        memory=error.memory,
        grip=error.grip,
        displacement=error.displacement,
        compliance=error.compliance,
        stick=error.stick,
        tails={fault: Passed(tail.level, tail.rate, tail.excess) for fault, tail in belief.tails.items()},
        misfit=belief.misfit,
        learned={name: Learned(values[name], spread[name]) for name in LEARNED},
        duration=round(len(seen) * PERIOD, 2),
        closing=error.closing,
        rates=dict(belief.rates),
    )
    return msgspec.structs.replace(record, healthy=healthy)


class _Choice(NamedTuple):
    """How probably a small sudden change shows in time, and is named, if the model lacks this."""

    chance: float
    error: Unmodelled


class _Watched(NamedTuple):
    """What a monitor made of a healthy arm.

    Attributes:
        statistics: (N, 18), its statistic of each of JUMPS at every sample.
        misfit: its largest misfit.
        information: (M, 18), what some of the samples tell of each fault, see `SignatureBank.information`.
    """

    statistics: Array
    misfit: float
    information: Array


def _chosen(belief: Belief, seen: Stream, progress: Callable[[str], None]) -> Unmodelled:
    """What the model lacks: one after the other, each the best with the others as they are."""
    first = (_FIRST, _FIRST, _FIRST)
    error = replace(belief.error, slow=first, memory=MEMORIES[0], grip=_grip(belief.arm))
    for _ in range(_ROUNDS):
        lacking = _pass(replace(belief, error=error), seen)
        error = replace(error, slow=lacking.slow)
    choices: dict[str, Sequence[float | JointVector]] = {
        "slow": [joint_vector(share * np.array(lacking.slow)) for share in SHARES],
        "compliance": [joint_vector(more * np.array(lacking.compliance)) for more in COMPLIANCES],
        "displacement": DISPLACEMENTS,
        "stick": STICKING,
        "memory": MEMORIES,
    }
    best = _tried(belief, seen, error, progress)
    for name in (*choices, *_AGAIN):
        now = getattr(best.error, name)
        others: list[dict[str, Any]] = [{name: value} for value in choices[name] if value != now]
        tried = [_tried(belief, seen, replace(best.error, **other), progress) for other in others]
        best = max([best, *tried], key=lambda each: each.chance)
    return best.error


def _tried(belief: Belief, seen: Stream, error: Unmodelled, progress: Callable[[str], None]) -> _Choice:
    """One choice."""
    found = _watched(replace(belief, error=error), seen)
    decides = limits(MonitorSettings(), replace(belief, error=error, tails=_tails(found.statistics)))
    alarm = decides.alarm + decides.allowance
    alarm[_CONFIRMED] = np.maximum(alarm[_CONFIRMED], 2.0 * _NAMED * decides.temper)
    sizes = plausible_sizes(belief.arm)
    small = _SMALL * np.array([sizes[fault] for fault in JUMPS])
    known = np.maximum(small**2 * found.information, _TINY)
    chance = float(np.mean(erfc(np.sqrt(0.5 * alarm / known))))
    progress(
        f"{1e3 * max(error.slow):.0f} mN m that last {error.memory:g} s, {1e3 * error.displacement:g} mrad of play,"
        f" {compliances(error.compliance)} mrad/(N m), {error.stick:.0%} of dry friction in doubt: alarms from"
        f" {alarm.min():.0f} to {alarm.max():.0f} on, {chance:.0%} of small changes show in {_SOON:g} s"
    )
    return _Choice(chance, error)


def compliances(values: JointVector) -> str:
    """Compliances (rad/(N m)) for people, in mrad/(N m)."""
    return ", ".join(f"{1e3 * value:.2g}" for value in values)


def _grip(arm: ArmParameters) -> float:
    """Torque of a box on the outstretched arm, N m: while it comes and goes, nobody knows how much of it acts."""
    return Tuning().box_mass * GRAVITY * sum(arm.get(f"l{joint}") for joint in (1, 2, 3))


def _pushed(belief: Belief, seen: Stream) -> Unmodelled:
    """What the model lacks, with the torques while jaws close, and while a box comes and goes, as they were seen."""
    error, most, changes = belief.error, belief.error.grip, np.flatnonzero(np.diff(seen.gripped))
    if len(changes) // 2 < FEWEST:
        return error
    # A command acts from its row to the next; an estimate takes a change for HANDLING samples from there.
    closing = np.concatenate(([False], closes(seen.volts, seen.gripped)[:-1]))
    handling = _after_each(changes, len(seen), 1, HANDLING + 3)
    touching = _after_each(changes, len(seen), HANDLING + 3, TOUCHING) & ~(closing | handling)
    others = ~(closing | handling | touching)
    left: dict[str, tuple[Flags, ...]] = {"closing": (closing,), "grip": (handling, touching)}
    for share in PUSHES:
        off = _off(replace(belief, error=replace(error, closing=share * most, grip=share * most)), seen)
        for name, parts in list(left.items()):
            near = all(_as_near(off[rows], off[others]) for rows in parts)
            if not (near and _as_calm(off[parts[0]], off[others])):
                del left[name]
        seen_to_push: dict[str, Any] = dict.fromkeys(left, share * most)
        error = replace(error, **seen_to_push)
        if not left:
            break
    return error


def _after_each(rows: NDArray[np.int64], count: int, start: int, stop: int) -> Flags:
    """The rows from `start` to `stop` - 1 after each of some, (count,)."""
    found = np.zeros(count, dtype=bool)
    for row in rows.tolist():
        found[row + start : row + stop] = True
    return found


def _off(belief: Belief, seen: Stream) -> Array:
    """By how many standard deviations every reading is off, (N, 3); not a number where it tells nothing."""
    monitor, tape, done = _calm(belief), Tape.of(len(seen)), 0
    while done < len(seen):
        done += seen.follow(monitor, done, len(seen), tape)
    off = np.where(tape.used, tape.innovation / np.sqrt(tape.variance), np.nan)
    off[:SETTLING] = np.nan
    return off


def _as_calm(some: Array, others: Array) -> bool:
    """Whether the mean square of some readings is no more than that of others, of every joint."""
    with np.errstate(invalid="ignore"):
        squares = [np.nansum(each**2, axis=0) / np.isfinite(each).sum(axis=0) for each in (some, others)]
    return bool((squares[0] <= squares[1]).all())


def _as_near(some: Array, others: Array) -> bool:
    """Whether some readings are no farther off than others at most."""
    return float(np.nanmax(np.abs(some), initial=0.0)) <= float(np.nanmax(np.abs(others), initial=0.0))


class _Lacking(NamedTuple):
    """Root mean squares of the torques that last, (3,), N m, and the angles by which the gears swing on average after
    jumps of the torque, (3,), rad/(N m)."""

    slow: JointVector
    compliance: JointVector


def _pass(belief: Belief, seen: Stream) -> _Lacking:
    """What a part of the log tells.

    The squares of the innovations grow with those of the swing that the voltages would make of a compliance of one:
    the slope of that line, by least squares, is the square of the compliance.
    """
    estimator = Estimator(replace(belief, clip=(_CLIP, _CLIP, _CLIP)), Tuning())
    squares, counted, followed = np.zeros(3), 0, -1
    K, swing, pairs = np.array([belief.arm.get(f"K{joint}") for joint in (1, 2, 3)]), np.zeros(3), []
    finite = np.isfinite(seen.measured.sum(axis=1) + seen.volts.sum(axis=1))
    for row in range(min(FIRST, len(seen))):
        if row == 0 or seen.sample[row] != seen.sample[row - 1] + 1 or not finite[row - 1 : row + 1].all():
            followed = -1
        if followed < 0 and finite[row]:
            estimator.initialise(seen.measured[row], bool(seen.gripped[row]))
            followed, swing = 0, np.zeros(3)
        elif followed >= 0:
            volts, gripped = seen.volts[row - 1], bool(seen.gripped[row - 1])
            doubt = belief.error.pushing if closes(volts, gripped) else 0.0
            estimator.predict(volts[:3], gripped, doubt)
            estimator.correct(seen.measured[row], np.ones(3, dtype=bool))
            followed += 1
            if followed > 1:
                swing = swung(swing, K * (volts[:3] - seen.volts[row - 2, :3]))
            if followed >= _SETTLED:
                squares += estimator.x[TORQUE:MOVING] ** 2 + estimator.P.diagonal()[TORQUE:MOVING]
                counted += 1
                pairs.append((swing, estimator.innovation**2))
    if not counted:
        raise ParameterError(f"the log has gaps all the time: expected {_SETTLED * PERIOD:g} s without one")
    swings, errors = np.array(pairs).transpose(1, 0, 2)
    swings -= swings.mean(axis=0)
    slope = np.sum(swings * errors, axis=0) / np.maximum(np.sum(swings**2, axis=0), _TINY)
    return _Lacking(joint_vector(np.sqrt(squares / counted)), joint_vector(np.sqrt(np.maximum(slope, 0.0))))


def _after(belief: Belief, seen: Stream) -> Belief:
    """What is believed of an arm after its log, each number by itself."""
    monitor = _calm(belief)
    seen.feed(monitor, 0, len(seen))
    estimator = monitor.estimator
    names = [name for name in LEARNED if name in ARM_NAMES]
    variances = [estimator.deviation(name) ** 2 if name in names else 0.0 for name in ARM_NAMES]
    bias1, bias2, bias3 = (float(estimator.x[INDEX[name]]) for name in _BIASES)
    spread1, spread2, spread3 = (estimator.deviation(name) for name in _BIASES)
    return replace(
        belief,
        arm=belief.arm.with_values({name: max(float(estimator.x[INDEX[name]]), 0.0) for name in names}),
        covariance=np.diag(variances),
        offset=(bias1, bias2, bias3),
        offset_deviation=(spread1, spread2, spread3),
    )


def _watched(belief: Belief, seen: Stream) -> _Watched:
    """What a monitor makes of a healthy arm."""
    monitor, tape, misfit, information = _calm(belief), Tape.of(len(seen)), np.ones(len(seen)), []
    now, done = 1.0, 0
    while done < len(seen):
        done += seen.follow(monitor, done, min(-(-done // _EVERY) * _EVERY + 1, len(seen)), tape)
        if (done - 1) % _EVERY == 0:
            information.append(monitor.information(_SOON))
    for row in range(len(seen)):
        misfit[row] = now = misfit_after(now, tape.score[row], tape.information[row], tape.used[row])
    return _Watched(tape.statistics[SETTLING:], float(misfit[SETTLING:].max()), np.array(information))


def _calm(belief: Belief) -> Monitor:
    """A monitor that takes the arm to be healthy whatever it does."""
    monitor = Monitor(belief)
    monitor.threshold = math.inf
    return monitor


def _tails(statistics: Array) -> dict[str, Tail]:
    """The tail of the statistic of each fault, of a column a fault."""
    return {fault: tail_of(statistics[:, column]) for column, fault in enumerate(JUMPS)}


def tail_of(statistic: Array) -> Tail:
    """How far a statistic goes while the arm is healthy; of a value at every sample, (N,), at least 10 s of them.

    The excess is the upper confidence limit of the mean of exponential excesses.
    """
    highest = statistic[: len(statistic) // _BLOCK * _BLOCK].reshape(-1, _BLOCK).max(axis=1)
    level = float(np.quantile(highest, _PEAKS))
    above = highest > level
    if not above.any():
        return Tail(level)
    count = int(above.sum())
    # The mean of so few excesses may be too small by chance, and an extrapolation over hours would multiply that.
    most = count / float(gammaincinv(count, _DOUBT))
    rate = count / len(highest) * 3600.0 / (_BLOCK * PERIOD)
    return Tail(level, rate, most * float(np.mean(highest[above] - level)))
