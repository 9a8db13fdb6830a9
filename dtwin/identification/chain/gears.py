"""What a gear yields and its play, from encoders on both of its sides.

The side of the motor is ahead of the joint by

    q_m - q = o + tau / k + (b / 2) s(tau) + d q' + h s(q'),    s(x) = tanh(x / x0)

with the torque tau that the gear carries, as the identified arm has it. The compliance 1/k is that of a spring in the
gear (Spong 1987), the play b the way between the flanks of its teeth, on which the sign of the torque decides. d is
what one encoder reads later than the other, and h the part by which friction behind the gear winds it up. They are
estimated together, as each would else pass for another, and their intervals count residuals by their correlation in
time. Where there is no encoder at the motor, the command takes its place: then servo and gear are told together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import ndtri

from dtwin.arm.chain import Array
from dtwin.identification.chain.design import Rigid, Smooth, low_passed, rigid_of
from dtwin.identification.chain.identify import Identification, Sample
from dtwin.identification.chain.intervals import convolved, correlation_of
from dtwin.identification.chain.result import NINETY_FIVE, Number, moved, unclear

_FLANKS: Final = (0.02, 0.1)
"""Parts of the usual torque over which the teeth change their flank; what the second would change counts as doubt."""
_TURNS: Final = 0.05
"""Part of the usual speed over which friction turns over."""
_SIDES: Final = 0.05
"""Least share of the time that the torque lies on each flank where play is told."""
_LONGEST: Final = 3.0
"""Longest correlation in time that is looked at, s."""


@dataclass(frozen=True, slots=True)
class Gear:
    """What is told of one gear.

    Attributes:
        joint: name of its joint.
        compliance: what it yields, rad/(N m), or m/N of a joint that slides.
        play: way between the flanks, rad or m.
        sides: whether the torque lay on both flanks for long enough; else nothing tells its play.
    """

    joint: str
    compliance: Number
    play: Number
    sides: bool


@dataclass(frozen=True, slots=True)
class Gears:
    """What is told of all gears.

    Attributes:
        each: gear by gear; without those of joints that stood or whose torque nothing explains, and none where the
            logs have nothing that tells them.
        measured: whether the motors' side was measured; else it was commanded, and servos count with their gears.
    """

    each: tuple[Gear, ...]
    measured: bool


def gears(found: Identification, samples: Sequence[Sample]) -> Gears:
    """What the logs tell of the gears.

    Args:
        found: the identified arm.
        samples: the logs that it was identified from.
    """
    measured = any(sample.measurement.motor is not None for sample in samples)
    parts = [part for sample in samples for part in _parts(found, sample, measured)]
    if not parts:
        return Gears((), measured)
    known = [joint for joint in range(len(found.arm)) if moved(found, joint) and not unclear(found, joint)]
    # Of many numbers some are beyond their own intervals by chance: what is told holds for all of them (Bonferroni).
    sure = float(ndtri(1.0 - 0.025 / max(1, 2 * len(known)))) / NINETY_FIVE
    return Gears(tuple(_gear(found, parts, joint, sure) for joint in known), measured)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """One stretch: what the motor's side is ahead, the torque, the velocity, (N, n) each, as they are."""

    ahead: Array
    torque: Array
    speed: Array
    kept: np.ndarray
    dt: float
    step: float  # from one of the rows that are kept to the next, s


def _parts(found: Identification, sample: Sample, measured: bool) -> list[_Part]:
    filtering, scales = found.design.filtering, found.design.scales
    parts = []
    for stretch in sample.stretches(filtering):
        other = stretch.motor if measured else stretch.command
        if other is not None:
            rigid = rigid_of(found.arm, stretch, scales, filtering)
            parts.append(_part(stretch, other, rigid.full @ found.carried(sample.load), rigid))
    return [part for part in parts if len(part.kept)]


def _part(stretch: Smooth, other: Array, torque: Array, rigid: Rigid) -> _Part:
    return _Part(other - stretch.q, torque, stretch.v, rigid.kept, stretch.dt, stretch.dt * rigid.every)


def _gear(found: Identification, parts: Sequence[_Part], joint: int, sure: float) -> Gear:
    """A gear, of which is told what is more than `sure` times the half width of its interval."""
    name, scale = found.arm.joints[joint].name, found.design.scales[joint]
    every = np.concatenate([part.torque[part.kept, joint] for part in parts])
    usual = max(float(np.sqrt(np.mean(every**2))), 1e-9)
    cutoff = found.design.filtering.cutoff
    (solution, deviation), (other, _) = (
        _fitted(*_equations(parts, joint, flank * usual, _TURNS * scale.speed, cutoff), parts[0].step)
        for flank in _FLANKS
    )
    half = NINETY_FIVE * np.hypot(deviation, 0.5 * (other - solution))
    flank = _FLANKS[-1] * usual
    sides = min(float(np.mean(every > flank)), float(np.mean(every < -flank))) > _SIDES
    compliance, yields = float(solution[1]), float(half[1])
    play, wide = 2.0 * float(solution[2]), 2.0 * float(half[2])
    return Gear(
        name,
        Number(f"{name} compliance", compliance, yields, compliance > sure * yields),
        Number(f"{name} play", play, wide, sides and play > sure * wide),
        sides,
    )


def _equations(
    parts: Sequence[_Part], joint: int, flank: float, turns: float, cutoff: float
) -> tuple[list[Array], list[Array]]:
    """Columns of the unknowns, and what the motor is ahead, stretch by stretch."""
    matrices, aheads = [], []
    for part in parts:
        torque, speed = part.torque[:, joint], part.speed[:, joint]
        columns = [np.ones_like(torque), torque, np.tanh(torque / flank), speed, np.tanh(speed / turns)]
        matrices.append(low_passed(np.stack(columns, axis=1), part.dt, cutoff)[part.kept])
        aheads.append(low_passed(part.ahead[:, joint], part.dt, cutoff)[part.kept])
    return matrices, aheads


def _fitted(matrices: Sequence[Array], aheads: Sequence[Array], step: float) -> tuple[Array, Array]:
    """Least squares and the standard deviations of what it finds, by residuals that are correlated in time."""
    matrix, ahead = np.concatenate(matrices), np.concatenate(aheads)
    scale = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-300
    inverse = np.linalg.pinv((matrix / scale).T @ (matrix / scale), rcond=1e-10, hermitian=True)
    solution = inverse @ (matrix / scale).T @ ahead
    left = [mine - (part / scale) @ solution for part, mine in zip(matrices, aheads, strict=True)]
    correlation = correlation_of(left, max(1, round(_LONGEST / step)))
    meat = sum((part / scale).T @ convolved(correlation, part / scale) for part in matrices)
    deviation: Array = np.sqrt(np.maximum(np.diag(inverse @ meat @ inverse), 0.0)) / scale
    return solution / scale, deviation


def said_of(told: Gears) -> list[str]:
    """Sentences about what is told of the gears and what is not, and why."""
    if not told.each:
        why = (
            "no joint that moves by a torque that is known" if told.measured else "no encoder at the motors ([motor])"
        )
        return [f"what gears yield and their play: not told, as the logs have {why}"]
    whose = "gear" if told.measured else "servo and gear together, as what joints are off their commands"
    rows = [row for gear in told.each for row in (gear.compliance, gear.play)]
    sure = [f"{row.name} {row.value:.2e} +- {row.half:.1e}" for row in rows if row.told]
    found = []
    if sure:
        found.append(f"{whose}, rad/(N m) and rad, of joints that slide m/N and m: {', '.join(sure)}")
    one = [gear.play.name for gear in told.each if not gear.sides]
    small = [
        f"{row.name} (below {max(row.value, 0.0) + row.half:.1e})"
        for row in rows
        if not row.told and row.name not in one
    ]
    if one:
        found.append(f"{whose}, not told, as the torque hardly changes its side: {', '.join(one)}")
    if small:
        found.append(f"{whose}, not told apart from nothing: {', '.join(small)}")
    return found
