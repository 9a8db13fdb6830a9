"""Settings of the controller for an arm that was identified: gains, model and compensation, with their margins.

The model is that of the record. The controller knows no rotors, so their inertia counts as that of the links, which
is exact for joint 1 and near for the others. What the data do not tell is not compensated: the integrals hold it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from dtwin.campaign.spread import Progress
from dtwin.controller.motion import MotionController
from dtwin.controller.proposed import LeastMargins, ProposedSettings
from dtwin.controller.settings import COMPENSATION_RANGES, MOST_REPEATS, Compensation, ControlSettings, usual_gains
from dtwin.identification.machine.record import EncoderCheck, MachineRecord
from dtwin.parameters import PERIOD, ArmParameters, JointVector, Law
from dtwin.simulation.checks import Checker
from dtwin.simulation.margins.demands import MARGINS, Case, cases
from dtwin.simulation.margins.design import NOISE, Candidate, best_of, design
from dtwin.simulation.margins.poses import Pose, places, poses
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.effects import Effects

_IMPOSSIBLE: Final = 1e-12
"""Probability of what does not happen: once in 300 years of readings."""
_MOST_HELD: Final = 0.3
"""Torque up to which friction and a dead zone hold a joint of an arm that is not known, N m: that of the blocks."""
_COARSEST: Final = math.tau / 2**10
"""Resolution of the encoders of such an arm, rad: two steps pull as much as the blocks allow for, 7 rad/s^2."""
_UNMODELLED: Final = 0.15
"""Share of such an arm's torque that may pull besides."""
_MOST_GAIN: Final = 60.0
"""Gain margin, dB, above which none is told."""


def propose(record: MachineRecord, progress: Progress, task: Task = DEFAULT_TASK) -> ProposedSettings:
    """Designs settings for an identified arm.

    Args:
        record: record of the arm.
        progress: is told how many gains of how many have been judged.
        task: task of its cell, at whose places the margins must be kept.
    """
    at = places(task)
    controller = MotionController()
    late = lateness(record)

    def judged(settings: ControlSettings, at: Sequence[Pose]) -> list[Case]:
        return [case for each in late for case in cases(controller, settings, record.arm, at, each, record.effects)]

    settings = ControlSettings(law="cascade", model=controllable(record), compensation=compensation(record))
    best = chosen(design(controller, settings, record.arm, progress, late, record.effects, task))
    settings = replace(settings, gains=best.gains)
    dead = replace(settings, compensation=replace(settings.compensation, dead_zone=dead_zone(record)))
    if not any(MARGINS.shortfall(case.margins) for case in judged(dead, at)):
        settings = dead
    near, everywhere = judged(settings, at), judged(settings, poses(task=task))
    return ProposedSettings(
        settings,
        late,
        _least(near),
        _least(everywhere),
        best.noise * max(encoder.noise for encoder in record.sensors.encoders),
        _refusal(record, near),
        _remarks(best, everywhere),
    )


def tolerated(record: MachineRecord, law: Law, checker: Checker) -> float:
    """The share of the demanded margins that uploads to an arm have to keep, which the checker asks for from now on.

    It is less than one only if the record says that no settings have the demanded margins; then what the usual gains
    of a law have is demanded, whatever is in force.
    """
    if record.settings is None or not record.settings.refused:
        return 1.0
    usual = ControlSettings(law=law, gains=usual_gains(law), model=controllable(record))
    return checker.tolerate(usual, record.arm)


def chosen(candidates: Sequence[Candidate]) -> Candidate:
    """The candidate to take: among those with every reserve the one with the largest integral gain.

    Where none has it, the one is taken that lacks least, so that it can be told what is missing.
    """
    good = [each for each in candidates if each.good]
    return best_of(good) if good else max(candidates, key=lambda each: each.worst)


def lateness(record: MachineRecord) -> tuple[float, float]:
    """Least and greatest time after which the arm may obey a command, ticks.

    A lag delays by its time constant at most. Both are within one standard deviation of what was identified.
    """
    delay = record.numbers["delay"]
    lag = max(record.effects.lag)
    least = max(delay.value - delay.deviation, 0.0) + min(record.effects.lag)
    return least / PERIOD, (delay.value + delay.deviation + lag) / PERIOD


def controllable(record: MachineRecord) -> ArmParameters:
    """The arm as the controller should believe it to be: rotors are parts of links, and friction is what is told."""
    friction = {f"mu{joint}": 0.0 for joint in (1, 2, 3) if not record.numbers[f"mu{joint}"].told}
    return with_rotors(record.arm, record.effects).with_values(friction)


def with_rotors(arm: ArmParameters, effects: Effects) -> ArmParameters:
    """An arm whose rotors are parts of its links."""
    inertia = (own + rotor for own, rotor in zip(arm.inertia, effects.rotor_inertia, strict=True))
    return replace(arm, inertia=tuple(inertia))


def compensation(record: MachineRecord) -> Compensation:
    """What the controller should take into account of drives and encoders."""
    delay = record.numbers["delay"]
    known = tuple(map(pull, held(record), (encoder.step for encoder in record.sensors.encoders)))
    usual = Compensation(repeats=tuple(map(repeats, record.sensors.encoders)), pull=known)
    if not delay.told:
        return usual
    low, high, _ = COMPENSATION_RANGES["delay"]
    return replace(usual, delay=min(max(delay.value + sum(record.effects.lag) / 3.0, low), high))


def repeats(encoder: EncoderCheck) -> int:
    """Repetitions of a reading that the noise of an encoder makes impossible; 0 where it repeats for long at rest.

    A joint at rest repeats a code the most often in the middle of it, with the probability p that Gaussian noise
    stays within half a step, so that n times in a row have the probability p^n. Noise with a memory repeats more
    often, which the log has shown.
    """
    if encoder.step is None or encoder.rest is None or encoder.repeats is None:
        return 0
    variance = min(encoder.rest, encoder.noise) ** 2 - encoder.step**2 / 12.0
    if variance <= 0.0:
        return 0
    within = math.erf(encoder.step / math.sqrt(8.0 * variance))
    count = (
        max(math.ceil(math.log(_IMPOSSIBLE) / math.log(within)), 2 * encoder.repeats) if within < 1.0 else math.inf
    )
    return int(count) if count <= MOST_REPEATS else 0


def held(record: MachineRecord) -> JointVector:
    """The torque up to which friction and the dead zone of its drive may hold each joint, N m.

    It is what was identified and two standard deviations.
    """

    def most(name: str) -> float:
        number = record.numbers[name]
        return max(number.value + 2.0 * number.deviation, 0.0)

    return tuple(
        most(f"mu{joint}") + most(f"stiction{joint}") + record.numbers[f"K{joint}"].value * most(f"dead_zone{joint}")
        for joint in (1, 2, 3)
    )


def pull(held: float, step: float | None) -> float:
    """What leaves the readings of a joint as they are, as a share of the torque of drives and encoders that nobody
    knows; see `Compensation`.

    An integral pulls until friction and dead zone give way, from one way to the other, and the error of a step of the
    encoder pulls besides. The larger of the two counts, as a share of what the blocks count with, and what no model
    has.

    Args:
        held: torque up to which a joint may be held, N m.
        step: resolution of its encoder, rad; None if the readings have no steps.
    """
    return min(_UNMODELLED + max(2.0 * held / _MOST_HELD, (step or 0.0) / _COARSEST), 1.0)


def dead_zone(record: MachineRecord) -> float:
    """The voltage that every drive loses for sure, V; 0 unless the data tell it of all three.

    A controller that compensated more than a drive loses would chatter, so it is the least of the three less a
    standard deviation.
    """
    numbers = [record.numbers[f"dead_zone{joint}"] for joint in (1, 2, 3)]
    if not all(number.told for number in numbers):
        return 0.0
    low, high, _ = COMPENSATION_RANGES["dead_zone"]
    return min(max(min(number.value - number.deviation for number in numbers), low), high)


def _least(found: Sequence[Case]) -> LeastMargins:
    every = [case.margins for case in found]
    return LeastMargins(
        disk=min(m.disk for m in every),
        gain=min(_MOST_GAIN, *(m.gain for m in every)),
        phase=min(min(m.phase) for m in every),
        delay=min(m.delay for m in every),
        torque=min(m.torque for m in every),
    )


def _refusal(record: MachineRecord, found: Sequence[Case]) -> str:
    """Why settings with these margins at the places must not be used, "" for no reason."""
    if record.grade == "unusable":
        return "the model of the arm does not predict its motion"
    broken = [(short.share, f"{case}: {short.text}") for case in found if (short := MARGINS.shortfall(case.margins))]
    return min(broken)[1] if broken else ""


def _remarks(best: Candidate, found: Sequence[Case]) -> list[str]:
    said = []
    if best.worst < 1.0:
        said.append(f"no gains have the reserve of the design; these have {best.worst:.0%} of it")
    if best.noise > NOISE:
        said.append(f"{best.noise:.0f} V for a rad of encoder noise, at most {NOISE:g} V were asked for")
    if short := sum(MARGINS.shortfall(case.margins) is not None for case in found):
        said.append(f"{short} of {len(found)} cases of the workspace have less than what is demanded at the places")
    return said
