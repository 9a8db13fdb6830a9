"""Friction of one joint as a sum of terms, each linear in its coefficient.

    f(v) = f0 + fv v + fc sgn(v) + ...

Groups of terms, from what every joint has to what has to prove itself on motion that it was not fitted to:

    basic       offset, viscous friction, Coulomb friction (smoothed over a small speed)
    rotor       inertia of the rotor seen at the joint
    curve       Stribeck's fall at low speed and the bend at high speed: Coulomb terms of other speeds, friction
                that falls with speed, and a root
    soft        dry friction as a simulator's soft constraint has it: it turns over by v + a / b, not by v (MuJoCo
                documentation, "Computation", friction loss; b = 2 / (dmax timeconst)), over speeds that nobody
                knows, and grows with the torque that the gear carries
    presliding  Dahl's elements: friction that turns over with travel after a reversal, not at once (Dahl 1968;
                several lengths side by side: generalised Maxwell-slip model, Al-Bender, Lampaert and Swevers 2005)
    load        Coulomb friction that grows with the torque that the gear carries (Hamon, Gautier and Garrec 2010)
    asymmetric  friction of another size in the other direction
    temperature Coulomb and viscous friction that change with the drive's temperature, where it was logged

Speeds and lengths are told in parts of the joint's own usual speed and travel, so that they fit any joint.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from dtwin.arm.chain import Array

Group = Literal["basic", "rotor", "curve", "soft", "presliding", "load", "asymmetric", "temperature"]
CANDIDATES: Final[tuple[Group, ...]] = ("rotor", "curve", "soft", "presliding", "load", "asymmetric", "temperature")
"""Groups that have to prove themselves."""

_COULOMB: Final = 0.05
"""Part of the usual speed over which Coulomb friction turns over."""
_OTHER_SPEEDS: Final = (0.01, 0.2)
_FALLS: Final = (0.05, 0.15)
"""Parts of the usual speed over which Stribeck's further friction falls."""
_FALLING: Final = 0.015
"""Part of the usual travel over which it turns over."""
_FORGOTTEN: Final = 1e-15
"""Factor of a state of presliding from which on rounding forgets it."""
_SOFT_LEAD: Final = 0.95 * 0.02 / 2.0
"""1 / b for the usual reference of a constraint (solref 0.02 1, dmax 0.95), s."""
_SOFT_SPEEDS: Final = (0.00075, 0.0015, 0.003, 0.006, 0.012, 0.024)
"""Parts of the usual speed over which soft friction turns over; a factor of two apart."""
_LENGTHS: Final = (0.005, 0.015, 0.05, 0.15)
"""Parts of the usual travel over which an element of presliding turns over; a factor of three apart."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What is usual for a joint.

    Attributes:
        speed: root mean square of its velocity, rad/s or m/s.
        travel: standard deviation of its position, rad or m.
        temperature: mean temperature, degrees Celsius.
    """

    speed: float
    travel: float
    temperature: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """Terms of one joint.

    Attributes:
        names: name of each term.
        groups: group of each term.
        values: the terms, (N, terms): torque for a coefficient of 1.
    """

    names: tuple[str, ...]
    groups: tuple[Group, ...]
    values: Array


def friction_terms(
    scale: Scale, q: Array, v: Array, a: Array, load: Array | None, temperature: Array | None
) -> Terms:
    """All terms of one joint.

    Args:
        scale: what is usual for the joint.
        q: position, (N,).
        v: velocity, (N,).
        a: acceleration, (N,).
        load: size of the torque that the gear carries, (N,), N m; None leaves the group out.
        temperature: temperature of the drive, (N,); None leaves the group out.
    """
    turned = {part: dahl(q, part * scale.travel) for part in _LENGTHS}
    return _terms(scale, turned, v, a, load, temperature)


def _terms(
    scale: Scale, turned: Mapping[float, Array], v: Array, a: Array, load: Array | None, temperature: Array | None
) -> Terms:
    """All terms of one joint, whose elements of presliding have turned so far, each (N,)."""
    sign = np.tanh(v / (_COULOMB * scale.speed))
    found: list[tuple[str, Group, Array]] = [
        ("offset", "basic", np.ones_like(v)),
        ("viscous", "basic", v),
        ("coulomb", "basic", sign),
        ("rotor", "rotor", a),
        *((f"coulomb@{part:g}", "curve", np.tanh(v / (part * scale.speed))) for part in _OTHER_SPEEDS),
        ("root", "curve", np.sign(v) * np.sqrt(np.abs(v))),
    ]
    found += [(f"presliding@{part:g}", "presliding", element) for part, element in turned.items()]
    falls = [(part, turned[_FALLING] * np.exp(-((v / (part * scale.speed)) ** 2))) for part in _FALLS]
    found += [(f"fall@{part:g}", "curve", fall) for part, fall in falls]
    for part in _SOFT_SPEEDS:
        turn = np.tanh((v + _SOFT_LEAD * a) / (part * scale.speed))
        found.append((f"soft@{part:g}", "soft", turn))
        if load is not None:
            found.append((f"load soft@{part:g}", "soft", load * turn))
    if load is not None:
        found.append(("load", "load", load * sign))
        found += [(f"load@{part:g}", "load", load * element) for part, element in turned.items()]
    found += [("coulomb asymmetry", "asymmetric", np.abs(sign)), ("viscous asymmetry", "asymmetric", np.abs(v))]
    if temperature is not None:
        warm = temperature - scale.temperature
        found += [("warm coulomb", "temperature", warm * sign), ("warm viscous", "temperature", warm * v)]
    names, groups, values = zip(*found, strict=True)
    return Terms(names, groups, np.stack(values, axis=1))


def sliding(names: tuple[str, ...], scale: Scale, speed: float) -> Array:
    """The terms of a joint that slides steadily at a speed without load, (terms,): friction for coefficients of 1."""
    turned = dict.fromkeys(_LENGTHS, np.full(1, np.sign(speed)))
    steady = _terms(scale, turned, np.full(1, speed), np.zeros(1), np.zeros(1), None)
    values = dict(zip(steady.names, steady.values[0].tolist(), strict=True))
    return np.array([values.get(name, 0.0) for name in names])


def dahl(q: Array, length: float) -> Array:
    """State of Dahl's element, (N,), between -1 and 1: dz/dq = (sgn(q') - z) / length.

    It is exact for positions that run straight from sample to sample, and begins at 0.

    Args:
        q: position, (N,), rad or m.
        length: travel after which it has turned over to 63 %.
    """
    travelled = np.diff(q, prepend=q[:1])
    kept = np.exp(-np.abs(travelled) / length)
    found = (1.0 - kept) * np.sign(travelled)
    # What k steps do one after the other is again a factor and a summand: doubling k carries every start to the end
    # (Hillis and Steele 1986). What is left of a state 32 lengths back is less than rounding.
    reach = 1
    while reach < len(found) and kept.any():
        found[reach:] += kept[reach:] * found[:-reach]
        kept[reach:] = kept[reach:] * kept[:-reach]
        kept[:reach] = 0.0
        kept[kept < _FORGOTTEN] = 0.0
        reach *= 2
    return found
