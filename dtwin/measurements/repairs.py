"""What is wrong with single columns: missing values, turns, spikes, standstill, limits, wrong velocities."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm
from dtwin.measurements.measurement import Array
from dtwin.measurements.rows import Rows

GAP: Final = 5.0
"""Steps without a row after which a new stretch begins."""
_BRIDGED: Final = 3
"""Missing values in a row that are drawn through."""
_EVEN: Final = 0.95
"""Share of even steps between values from which on a column has a rate of its own."""
_SLOWEST: Final = 0.1
"""Longest time between the values of such a column that are drawn through, s."""
_SPIKE: Final = 30.0
"""Distance of a single value from its neighbours, in usual steps, that no arm makes."""
_FROZEN: Final = 0.3
"""Time for which a moving joint may read the same, s."""
_MISSED: Final = 0.05
"""Part of a joint's travel that it may miss so."""
_LEAST_MISSED: Final = 0.02
"""What a joint must have missed at least, rad or m: less is the noise of a velocity at rest."""
_HELD: Final = 0.5
"""Share of a moving joint's rows that repeat the row before, from which on its values come more seldom than rows."""
_LEAST_STEP: Final = 1e-3
"""Travel within which two steps of an encoder are no motion, rad or m."""
_CLIPPED: Final = 5
"""Times as long at the same largest effort as a value usually lasts, from which on it was cut off."""
_LEVELS: Final = 50
"""Different values up to which an effort that stays the same is a coarse sensor at rest, not one at its limit."""
_PILED: Final = 3.0
"""Times as many rows at the largest effort as near it, from which on it was cut off."""
FEW: Final = 0.02
"""Share of rows beyond the joint's limits, or where stamps begin again, that is not a wrong unit or order."""
_STILL: Final = 0.02
"""Usual speed below which velocities are not held against positions, rad/s or m/s."""
_SLOPE: Final = 0.15
"""Relative difference of logged velocities from those of the positions that is no error of units."""
_SAME: Final = 0.98
"""Likeness from which on a velocity is that of a position."""
_LAG: Final = 0.05
"""Shift between both that no filter of a drive makes, s."""
_LONGEST_LAG: Final = 0.5
"""Longest shift that is looked for, s."""
_MISTAKES: Final = {
    "one of them has the other sign": -1.0,
    "velocities are in degrees": np.pi / 180.0,
    "positions are in degrees": 180.0 / np.pi,
    "velocities are in turns": 2.0 * np.pi,
    "positions are in turns": 0.5 / np.pi,
    "velocities are in revolutions a minute": np.pi / 30.0,
    "one is a thousand times the other": 1e3,
    "one is a thousandth of the other": 1e-3,
}
"""Ratios of slope to velocity that say what is wrong."""
_GEARED: Final = 0.05
"""Part by which a motor may seem to turn further than its joint by what its gear yields."""
_LIMIT: Final = 0.2
"""What a position may lie beyond its limit, rad or m."""
_TURN: Final = 2.0 * np.pi


def missing(rows: Rows) -> None:
    """Missing values: a few in a row are drawn through, more are a gap."""
    gone = np.zeros(len(rows.row), dtype=bool)
    for name in rows.map.roles():
        for joint, values in enumerate(rows.arrays[name].T):
            bad = ~np.isfinite(values)
            if not bad.any():
                continue
            if bad.all():
                raise rows.refuse(name, joint, 0, "expected numbers, got none in any row")
            known = np.flatnonzero(~bad)
            every = _recurring(known, rows.arrays["t"])
            long = _runs(bad, max(_BRIDGED + 1, every))
            gone |= long
            gone[: known[0]] = gone[known[-1] + 1 :] = True  # nothing is known beyond the first and the last value
            values[bad] = np.interp(np.flatnonzero(bad), known, values[known])
            text = "missing values are drawn through" if not long.any() else "missing values are left out as a gap"
            if every > 1:
                text = f"values come every {every} rows and are drawn through"
            rows.note(text, True, bad, rows.name(name, joint))
    if gone.any():
        rows.keep(~gone)


def _recurring(known: NDArray[np.intp], t: Array) -> int:
    """Rows from one value to the next of a column of another rate than the rows'; 1 where there is no such rate."""
    steps = np.diff(known)
    every = int(np.median(steps)) if len(steps) else 1
    even = float(np.mean(np.abs(steps - every) <= 1)) > _EVEN if len(steps) else False
    return every if every > 1 and even and every * float(np.median(np.diff(t))) <= _SLOWEST else 1


def _runs(flags: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """Where at least so many flags stand in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    found = np.zeros_like(flags)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        found[start:stop] = stop - start >= least
    return found


def turns(rows: Rows, arm: Arm | None) -> None:
    """Positions that jump by a whole turn."""
    for name in ("position", "command", "motor"):
        if name not in rows.arrays or rows.map.roles()[name].unit in ("percent", "m", "mm"):
            continue
        for joint, values in enumerate(rows.arrays[name].T):
            if arm is not None and joint < len(arm) and arm.joints[joint].kind == "prismatic":
                continue
            gear = abs(rows.map.roles()[name].gear[joint]) if rows.map.roles()[name].gear else 1.0
            turn = _TURN / gear
            jumps = np.abs(np.abs(np.diff(values, prepend=values[:1])) - turn) < 0.2 * turn
            jumps &= np.diff(rows.arrays["episode"], prepend=rows.arrays["episode"][0]) == 0.0
            if jumps.any():
                rows.note("jumps by a turn are taken out", True, jumps, rows.name(name, joint))
                steps = np.where(jumps, -np.sign(np.diff(values, prepend=values[:1])) * turn, 0.0)
                rows.arrays[name][:, joint] = values + np.cumsum(steps)


def spikes(rows: Rows) -> None:
    """Single values far from both neighbours."""
    bad = np.zeros(len(rows.row), dtype=bool)
    for name in ("position", "effort"):
        if name not in rows.arrays:
            continue
        for joint, values in enumerate(rows.arrays[name].T):
            middle = 0.5 * (np.roll(values, 1) + np.roll(values, -1))
            away = np.abs(values - middle)
            spread = np.abs(np.roll(values, 1) - np.roll(values, -1))
            usual = np.percentile(away, 99.0) + 1e-9
            spike = (away > _SPIKE * usual) & (away > 3.0 * spread)
            spike[[0, -1]] = False
            if spike.any():
                rows.note("single values far from their neighbours are left out", True, spike, rows.name(name, joint))
                bad |= spike
    if bad.any():
        rows.keep(~bad)


def frozen(rows: Rows) -> None:
    """Joints that read the same for long while their command, velocity or usual motion says that they move."""
    t = rows.arrays["t"]
    bad = np.zeros(len(t), dtype=bool)
    for joint, values in enumerate(rows.arrays["position"].T):
        same = np.diff(values, prepend=np.nan) == 0.0
        if _stands(values):
            rows.note("the joint never moves: nothing can be said of it", False, None, rows.name("position", joint))
            continue
        least = max(5, int(_FROZEN / max(float(np.median(np.diff(t))), 1e-6)))
        long = _runs(same, least)
        for start, stop in _spans(long):
            bad[start:stop] |= _travelled(rows, joint, start, stop) > max(_MISSED * np.ptp(values), _LEAST_MISSED)
    if bad.any():
        rows.note("a position stands still while the joint moves: the rows are left out as a gap", True, bad)
        rows.keep(~bad)


def _stands(values: Array) -> bool:
    """Whether a joint never moved but for a step of its encoder to and fro."""
    return bool(np.ptp(values) < _LEAST_STEP) and len(np.unique(values)) <= 3


def _travelled(rows: Rows, joint: int, start: int, stop: int) -> float:
    """How far a joint must have come while its position read the same, by its velocity or by the jump after it."""
    values, t = rows.arrays["position"][:, joint], rows.arrays["t"]
    if "velocity" in rows.arrays:
        speed = rows.arrays["velocity"][start:stop, joint]
        moves = abs(float(speed.mean())) > _STILL  # a sensor may read a little at rest
        return float(abs(np.trapezoid(speed, t[start:stop]))) if moves else 0.0
    usual = float(np.percentile(np.abs(np.diff(values)), 99.0))
    after = min(stop, len(values) - 1)
    if rows.arrays["episode"][after] != rows.arrays["episode"][stop - 1]:
        return 0.0
    jump = float(abs(values[after] - values[stop - 1]))
    return jump if jump > 3.0 * usual else 0.0


def _spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def clipped(rows: Rows) -> None:
    """Efforts that were cut off: their rows say nothing."""
    if "effort" not in rows.arrays:
        return
    bad = np.zeros(len(rows.row), dtype=bool)
    for joint, values in enumerate(rows.arrays["effort"].T):
        least = _CLIPPED * _lasting(values)
        for limit in (values.max(), values.min()):
            at = values == limit
            near = np.abs(values - limit) < max(0.02 * np.ptp(values), 1.5 * _quantum(values))
            cut = _runs(at, least)
            if cut.any() and len(np.unique(values)) > _LEVELS and at.sum() > _PILED * (near & ~at).sum():
                rows.note(
                    f"effort is cut off at {limit:.4g}: the rows are left out", True, cut, rows.name("effort", joint)
                )
                bad |= at
        if values.std() == 0.0:
            rows.note("the effort never changes: nothing can be said of it", False, None, rows.name("effort", joint))
    if bad.any():
        rows.keep(~bad)


def _lasting(values: Array) -> int:
    """Rows for which a value usually stays the same."""
    changes = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return max(1, round(float(np.median(np.diff(changes, append=len(values))))))


def _quantum(values: Array) -> float:
    """The usual step between neighbouring values that occur."""
    steps = np.diff(np.unique(values))
    return float(np.median(steps)) if len(steps) else 0.0


def velocities(rows: Rows) -> None:
    """Velocities that are not those of the positions: wrong units, signs, order or time."""
    if "velocity" not in rows.arrays:
        return
    t = rows.arrays["t"]
    steps = np.diff(t)
    usual = float(np.median(steps))
    inside = (steps < GAP * usual) & (np.diff(rows.arrays["episode"]) == 0.0)
    position, velocity = rows.arrays["position"], rows.arrays["velocity"]
    slopes = np.diff(position, axis=0)[inside] / steps[inside, None]
    speeds = 0.5 * (velocity[1:] + velocity[:-1])[inside]
    doubtful: list[str] = []
    late: list[str] = []
    for joint, (slope, speed) in enumerate(zip(slopes.T, speeds.T, strict=True)):
        power = float(speed @ speed)
        if max(power, float(slope @ slope)) < _STILL**2 * len(speed):
            continue
        ratio = float(slope @ speed) / (power + 1e-300)
        fits = _alike(slope, speed)
        wrong = next((name for name, factor in _MISTAKES.items() if abs(ratio / factor - 1.0) < _SLOPE), "")
        if abs(fits) > 0.8 and wrong:
            message = f"positions change {ratio:.3g} times as fast as the velocity says: {wrong}"
            raise rows.refuse("velocity", joint, _moves(velocity[:, joint]), message)
        lag = _lag(slope, speed, max(1, round(_LONGEST_LAG / usual)))
        if abs(lag) * usual >= _LAG:
            late.append(f"{rows.name('velocity', joint)} by {1e3 * lag * usual:.0f} ms")
        elif fits < 0.9 or abs(ratio - 1.0) > _SLOPE:
            other = next((k for k, found in enumerate(slopes.T) if k != joint and _alike(found, speed) > _SAME), None)
            if other is not None:
                whose = rows.name("position", other)
                message = f"expected the velocity of its joint, got that of {whose}: is the order of columns right?"
                raise rows.refuse("velocity", joint, _moves(velocity[:, joint]), message)
            doubtful.append(rows.name("velocity", joint))
    if late:
        names = ", ".join(late)
        rows.note(f"velocities are later than the positions ({names}): positions are differentiated instead", True)
    if doubtful:
        names = ", ".join(doubtful)
        rows.note(f"velocities do not follow the positions ({names}): positions are differentiated instead", True)
    if late or doubtful:
        del rows.arrays["velocity"]


def _moves(velocity: Array) -> int:
    """The first row in which a joint moves as it usually does."""
    return int(np.argmax(np.abs(velocity) >= np.sqrt(np.mean(velocity**2))))


def _alike(one: Array, other: Array) -> float:
    """The cosine of the angle between two columns."""
    return float(one @ other) / float(np.sqrt((one @ one) * (other @ other)) + 1e-300)


def _lag(slope: Array, speed: Array, longest: int) -> int:
    """Rows by which a velocity is later than the slope of its position; 0 where no shift makes them the same."""
    longest = min(longest, len(speed) // 4)
    shifts = range(-longest, longest + 1)
    fits = [_alike(slope[: len(slope) - k], speed[k:]) if k >= 0 else _alike(slope[-k:], speed[:k]) for k in shifts]
    best = int(np.argmax(fits))
    return shifts[best] if fits[best] > _SAME and 1.0 - fits[best] < 0.5 * (1.0 - fits[longest]) else 0


def motors(rows: Rows) -> None:
    """Encoders at the motors whose gear nobody told: each motor has to turn as far as its joint."""
    if "motor" not in rows.arrays:
        return
    pairs = zip(rows.arrays["position"].T, rows.arrays["motor"].T, strict=True)
    for joint, (position, motor) in enumerate(pairs):
        ratio = float(np.polyfit(position, motor, 1)[0]) if np.ptp(position) else 1.0
        if abs(ratio - 1.0) > _GEARED:
            said = f"it turns {ratio:.4g} times as far as the joint"
            raise rows.refuse("motor", joint, 0, f"{said}: expected its gear, with its sign, in a map of columns")


def held(rows: Rows) -> None:
    """Values that were logged again until new ones came: they are drawn through, joint by joint.

    A bus gives each joint's values in its own message, so that other joints may be new in the same row. Positions
    alone tell nothing: a coarse encoder repeats itself where the joint is slow.
    """
    if "effort" not in rows.arrays or len(rows.row) < 2:
        return
    steps = np.diff(rows.arrays["t"], prepend=rows.arrays["t"][0])
    usual = float(np.median(steps[1:]))
    breaks = (np.diff(rows.arrays["episode"], prepend=np.nan) != 0.0) | (steps > GAP * usual)
    when = np.cumsum(np.maximum(steps, 1e-9))
    names = [name for name in ("position", "velocity", "effort") if name in rows.arrays]
    told: dict[int, list[str]] = {}
    repeats = np.zeros(len(steps), dtype=bool)
    for joint in range(rows.arrays["position"].shape[1]):
        frames = np.stack([rows.arrays[name][:, joint] for name in names], axis=1)
        starts, every = _renewed(frames, breaks, usual)
        if every < 2:
            continue
        told.setdefault(every, []).append(rows.name("position", joint))
        repeats |= ~np.isin(np.arange(len(steps)), starts)
        knots = _knots(starts, breaks, every, usual)
        for name in names:
            column = rows.arrays[name][:, joint]
            rows.arrays[name][:, joint] = np.interp(when, when[knots], column[knots])
    for every, columns in told.items():
        what = f"values come every {every} rows, {1.0 / (every * usual):.3g} times a second, and repeat until then"
        rows.note(f"{what} ({', '.join(columns)}): they are drawn through", True, repeats)


def _renewed(frames: Array, breaks: NDArray[np.bool_], usual: float) -> tuple[NDArray[np.intp], int]:
    """First row of each new value of a joint, and rows from one to the next while it moves; 1 where all are new."""
    new = breaks | (np.diff(frames, axis=0, prepend=np.nan) != 0.0).any(axis=1)
    starts = np.flatnonzero(new)
    lengths = np.diff(np.append(starts, len(frames)))
    moves = np.diff(frames[starts, 0], append=np.nan) != 0.0
    moves &= lengths * usual < _FROZEN
    if not moves.any() or 1.0 - moves.sum() / lengths[moves].sum() < _HELD:
        return starts, 1
    return starts, max(2, round(float(np.median(lengths[moves]))))


def _knots(starts: NDArray[np.intp], breaks: NDArray[np.bool_], every: int, usual: float) -> NDArray[np.intp]:
    """Rows between which is drawn: new values, the end of rests, and the ends of stretches."""
    ends = np.append(starts[1:], len(breaks))
    rests = ends[(ends - starts) * usual >= _FROZEN] - every
    last = np.append(np.flatnonzero(breaks)[1:], len(breaks)) - 1
    found: NDArray[np.intp] = np.unique(np.concatenate([starts, rests, last]))
    return found


def limits(rows: Rows, arm: Arm | None) -> None:
    """Positions that the arm cannot have."""
    if arm is None or rows.map.position.unit == "percent":
        return
    bad = np.zeros(len(rows.row), dtype=bool)
    for joint, (limits, values) in enumerate(zip(arm.joints, rows.arrays["position"].T, strict=True)):
        beyond = np.maximum(values - limits.upper, limits.lower - values) > _LIMIT
        if beyond.mean() > FEW:
            row = int(np.argmax(beyond))
            expected = f"expected {limits.lower:.3g} to {limits.upper:.3g}, got {values[row]:.4g}"
            raise rows.refuse("position", joint, row, f"{expected}: is the unit right?")
        if beyond.any():
            name = rows.name("position", joint)
            rows.note("positions beyond the joint's limits: the rows are left out", True, beyond, name)
            bad |= beyond
    if bad.any():
        rows.keep(~bad)
