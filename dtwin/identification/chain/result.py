"""What was found of an arm, as rows for people and as a file: TOML with intervals."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.arm.chain import INERTIAL, Array
from dtwin.files import replacing
from dtwin.identification.chain.friction import sliding
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.record import record_of

NINETY_FIVE: Final = 1.96
"""Half width of a 95 % interval in standard deviations."""
_TOLD: Final = 0.5
"""Part of the prior's deviation that is left where the data tell a number."""
_GUESSED: Final = 0.5
"""Part of a variance from which on the interval is what was guessed of bodies, and no motion tells the number."""
_SLID: Final = 1.0
"""Time for which a joint has to slide in a direction so that its friction there is told, s."""
_SO_FAST: Final = 0.5
"""Part of a speed from which on a joint slides as fast as that."""
_NARROW: Final = 0.05
"""Standard deviation of a position in parts of the joint's range, a whole turn at most, below which motion has shown
but a part of it: designed poses have four times that."""
_UNEXPLAINED: Final = 0.7
"""Part of the effort from which on what is left unexplained of held-out motion says that the model tells nothing."""


@dataclass(frozen=True, slots=True)
class Number:
    """One number that was estimated.

    Attributes:
        name: its name, such as shoulder viscous.
        value: estimate, SI units.
        half: half width of its 95 % interval.
        told: whether the data tell it; else it is what was known before.
    """

    name: str
    value: float
    half: float
    told: bool


def slid(found: Identification, joint: int, speed: float) -> float:
    """How long a joint slid in the direction of a speed and about as fast, s; 0 where it read an encoder's steps."""
    place = found.design.names[joint].index("viscous")
    if found.design.still[joint]:
        return 0.0
    least, sign = _SO_FAST * abs(speed), np.sign(speed)
    return sum(
        float(rows.dt * np.count_nonzero(sign * rows.terms[joint][:, place] > least)) for rows in found.design.rows
    )


def moved(found: Identification, joint: int) -> bool:
    """Whether a joint slid for long enough, in any direction, to tell anything of it alone."""
    usual = found.design.scales[joint].speed
    return max(slid(found, joint, sign * 0.1 * usual) for sign in (1.0, -1.0)) >= _SLID


def narrow(found: Identification, joint: int) -> bool:
    """Whether a joint has kept to a part of its range, so that its motion beyond that is not identified."""
    sheet = found.arm.joints[joint]
    reach = min(sheet.upper - sheet.lower, 2.0 * np.pi if sheet.turns else np.inf)
    return bool(np.isfinite(reach) and found.design.scales[joint].travel < _NARROW * reach)


def numbers(found: Identification) -> Iterator[Number]:
    """All numbers: gains, friction joint by joint, then bodies, then loads.

    Friction is told as its sum, sliding steadily at the joint's usual speed and at a tenth of it in both directions:
    its terms are alike, and apart they say little. It counts as told only where the joint slid so for a second, and
    where its interval is narrower than the joint's usual effort.
    """
    layout, prior = found.moments.layout, found.prior
    for joint, deviation in enumerate(found.gain_deviations().tolist()):
        before = prior.gain_deviation[joint]
        if before:
            value = float(found.found.gain[joint])
            told = bool(deviation < _TOLD * before)
            yield Number(f"{found.arm.joints[joint].name} gain", value, NINETY_FIVE * value * deviation, told)
    for joint in range(len(found.arm)):
        yield from _friction(found, joint)
    for link, body in enumerate(found.arm.links):
        for k, name in enumerate(INERTIAL):
            yield _single(found, f"{body.name} {name}", 10 * link + k)
    for load in layout.loads:
        mass, deviation = found.load(load)
        yield Number(f"load {load} m", mass, NINETY_FIVE * deviation, True)


def _friction(found: Identification, joint: int) -> Iterator[Number]:
    name, names, scale = found.arm.joints[joint].name, found.design.names[joint], found.design.scales[joint]
    place = found.moments.layout.friction(joint)
    used = found.found.used[place]
    largest = float(np.sqrt(np.mean(np.concatenate([rows.effort[:, joint] for rows in found.design.rows]) ** 2)))
    largest *= float(found.found.gain[joint])
    rests = not moved(found, joint) or narrow(found, joint)
    for speed in (0.1 * scale.speed, -0.1 * scale.speed, scale.speed, -scale.speed):
        one = _sum(found, f"{name} friction at {speed:+.3g}", place, sliding(names, scale, speed) * used)
        seen = not rests and slid(found, joint, speed) >= _SLID
        yield replace(one, told=one.told and one.half < largest and seen)
    by_load = np.array([term.startswith("load") for term in names]) * used
    if by_load.any():
        one = _sum(found, f"{name} friction by load", place, by_load.astype(float))
        yield replace(one, told=one.told and not rests)
    if used[names.index("rotor")]:
        one = _single(found, f"{name} rotor", place.start + names.index("rotor"))
        yield replace(one, told=one.told and not rests)


def doubts(found: Identification) -> list[str]:
    """Sentences about what the numbers do not bear: joints that stood, or kept to a part of their ranges, and efforts
    that nothing explains."""
    said = []
    stood = [joint.name for k, joint in enumerate(found.arm.joints) if not moved(found, k)]
    if stood:
        said.append(f"hardly moved, so that nothing is told of their friction, rotors and gears: {', '.join(stood)}")
    part = [joint.name for k, joint in enumerate(found.arm.joints) if moved(found, k) and narrow(found, k)]
    if part:
        said.append(f"kept to a small part of their ranges: motion beyond it is not identified: {', '.join(part)}")
    dark = [joint.name for k, joint in enumerate(found.arm.joints) if moved(found, k) and unclear(found, k)]
    if dark:
        said.append(f"more than {_UNEXPLAINED:.0%} of the effort is not explained by anything: {', '.join(dark)}")
    return said


def unclear(found: Identification, joint: int, most: float = _UNEXPLAINED) -> bool:
    """Whether more than a part of a joint's effort is left unexplained on motion that was held out."""
    errors = found.held_out.get(found.groups)
    return errors is not None and float(errors[joint]) > most


def _sum(found: Identification, name: str, place: slice, weights: Array) -> Number:
    every = np.zeros(found.moments.layout.size)
    every[place] = weights
    value, deviation = found.combined(every)
    before = np.where(weights != 0.0, found.alone.prior.deviation[place], 0.0)
    left = found.by_data(every)
    told = left < _TOLD * float(np.linalg.norm(weights * before)) and found.guess(every) < _GUESSED
    return Number(name, value, NINETY_FIVE * deviation, bool(told))


def _single(found: Identification, name: str, position: int) -> Number:
    return _sum(found, name, slice(position, position + 1), np.ones(1))


def as_object(found: Identification) -> dict[str, Any]:
    """All that was found, as values for JSON and TOML."""
    rows = list(numbers(found))
    held_out = found.held_out.get(found.groups)
    return {
        "arm": found.arm.name,
        "sources": sorted({rows.source for rows in found.design.rows}),
        "friction": ["basic", *found.groups],
        "held_out": {} if held_out is None else dict(zip(_names(found), held_out.tolist(), strict=True)),
        "numbers": {row.name: {"value": float(row.value), "half": float(row.half), "told": row.told} for row in rows},
        "doubts": doubts(found),
        "not_told": [row.name for row in rows if not row.told],
    }


def _names(found: Identification) -> list[str]:
    return [joint.name for joint in found.arm.joints]


def write_toml(found: Identification, path: Path) -> None:
    """Writes all that was found.

    Raises:
        RecordingError: the path cannot be written.
    """
    content = as_object(found)
    lines = [f"{name} = {_text(content[name])}" for name in ("arm", "sources", "friction", "not_told")]
    lines += ["", "# error on motion that was not fitted, in parts of the effort", "[held_out]"]
    lines += [f"{_text(name)} = {value:.6g}" for name, value in content["held_out"].items()]
    lines += ["", "# value, half width of the 95 % interval, whether the data tell it; SI units", "[numbers]"]
    for name, number in content["numbers"].items():
        told = "true" if number["told"] else "false"
        lines.append(f"{_text(name)} = {{ value = {number['value']!r}, half = {number['half']!r}, told = {told} }}")
    lines += ["", "# the whole model, which dtwin monitor --commissioned reads", "[model]"]
    for name, value in msgspec.to_builtins(record_of(found)).items():
        lines.append(f"{name} = {_inline(value)}")
    with replacing(path, ".toml") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _text(value: str | list[str]) -> str:
    """As TOML, whose basic strings and arrays of them are those of JSON."""
    return msgspec.json.encode(value).decode()


def _inline(value: object) -> str:
    """A value as TOML on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_text(name)} = {_inline(entry)}" for name, entry in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return _text(value) if isinstance(value, str) else repr(value)
