"""From a table and a map to a measurement: units, then what is wrong with rows and columns.

What can be put right without a guess about the arm is put right and told: rows out of order, repeated stamps, single
missing values, turns. What cannot be is left out as a gap, or refused with column and row.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError
from dtwin.measurements.columns import ANGLES, EFFORTS, TIME, ColumnMap, Role
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Array, Effort, Measurement, Oddity

_GAP: Final = 5.0
"""Steps without a row after which a new stretch begins."""
_BRIDGED: Final = 3
"""Missing values in a row that are drawn through."""
_IMPOSSIBLE: Final = 1e4
"""No joint, speed or effort of a robot arm has such a number in SI units."""
_SPIKE: Final = 30.0
"""Distance of a single value from its neighbours, in usual steps, that no arm makes."""
_FROZEN: Final = 0.3
"""Time for which a moving joint may read the same, s."""
_MISSED: Final = 0.05
"""Part of a joint's travel that it may miss so."""
_CLIPPED: Final = 5
"""Rows in a row at the same largest effort from which on it was cut off."""
_PILED: Final = 3.0
"""Times as many rows at the largest effort as near it, from which on it was cut off."""
_NEIGHBOURS: Final = 21
"""Rows whose middle stamp a row is held against."""
_OUT_OF_PLACE: Final = 10.0
"""Distance from it, in steps of all neighbours, that no gap explains for a few rows alone."""
_FEW: Final = 0.02
"""Share of rows beyond the joint's limits, or where stamps begin again, that is not a wrong unit or order."""
_LOST: Final = 0.5
"""Share of rows that may be left out."""
_STILL: Final = 0.02
"""Usual speed below which velocities are not held against positions, rad/s or m/s."""
_SLOPE: Final = 0.15
"""Relative difference of logged velocities from those of the positions that is no error of units."""
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
_LIMIT: Final = 0.2
"""What a position may lie beyond its limit, rad or m."""
_TURN: Final = 2.0 * np.pi


class _Rows:
    """The arrays of a measurement on their way, with the rows that are still there."""

    def __init__(self, table: Table, columns: ColumnMap) -> None:
        self.source = table.source
        self.map = columns
        self.row = table.rows
        self.odd = list(table.oddities)
        self.arrays: dict[str, Array] = {}
        self.count = len(table.rows)

    def keep(self, kept: NDArray[np.bool_]) -> None:
        self.row = self.row[kept]
        self.arrays = {name: values[kept] for name, values in self.arrays.items()}

    def name(self, quantity: str, joint: int) -> str:
        return self.map.roles()[quantity].columns[joint]

    def told(self, what: str, repaired: bool, where: NDArray[np.bool_] | None = None, column: str = "") -> None:
        first, count = (-1, 0) if where is None else (int(self.row[np.argmax(where)]), int(where.sum()))
        self.odd.append(Oddity(what, repaired, column, first, count))

    def refuse(self, quantity: str, joint: int, row: int, message: str) -> RecordingError:
        return RecordingError(f"{self.source}: column {self.name(quantity, joint)}, row {self.row[row]}: {message}")


def measurement_of(table: Table, columns: ColumnMap, arm: Arm | None = None) -> Measurement:
    """Makes a measurement of a table.

    Args:
        table: columns of a file.
        columns: what they mean, checked against the table.
        arm: the arm, if it is known: its limits find wrong units.

    Raises:
        RecordingError: something is wrong that cannot be put right; the message names column and row.
    """
    rows = _Rows(table, columns)
    for name, role in columns.roles().items():
        rows.arrays[name] = _in_units(table, name, role)
    rows.arrays["t"] = _stamps(table, columns)
    rows.arrays["episode"] = table.columns[columns.episode] if columns.episode else np.zeros(rows.count)
    _impossible(rows)
    _misplaced(rows)
    _time(rows)
    _missing(rows)
    _spikes(rows)
    _turns(rows, arm)
    _limits(rows, arm)
    _frozen(rows)
    _clipped(rows)
    if len(rows.row) < max(20, (1.0 - _LOST) * rows.count):
        raise RecordingError(f"{table.source}: {rows.count - len(rows.row)} of {rows.count} rows cannot be used")
    _velocities(rows)
    return _finished(rows, arm)


def _in_units(table: Table, name: str, role: Role) -> Array:
    values = np.stack([table.columns[column] for column in role.columns], axis=1)
    if name == "effort":
        factor = EFFORTS[role.unit][0] if role.unit else 1.0
    elif role.unit == "tick":
        factor = _TURN / role.ticks
    elif role.unit == "turn":
        factor = _TURN
    else:
        factor = ANGLES.get(role.unit, 1.0)
    scaled = values * factor * np.array(role.sign or 1.0)
    gear = np.array(role.gear or 1.0)
    # A gear makes torque larger and angles smaller.
    found: Array = (scaled * gear if name == "effort" else scaled / gear) - np.array(role.offset or 0.0)
    return found


def _stamps(table: Table, columns: ColumnMap) -> Array:
    if columns.time:
        return table.columns[columns.time] * TIME[columns.time_unit]
    if not columns.rate > 0.0:
        raise RecordingError(
            f"{table.source}: no column of stamps: expected time, or rate (rows a second), in the map"
        )
    return table.rows / columns.rate


def _impossible(rows: _Rows) -> None:
    """Rows with numbers that damaged files have."""
    bad = ~np.isfinite(rows.arrays["t"])
    for values in rows.arrays.values():
        with np.errstate(invalid="ignore"):
            bad |= (np.abs(values) > 1e15).reshape(rows.count, -1).any(axis=1)
    for name in rows.map.roles():
        with np.errstate(invalid="ignore"):
            bad |= (np.abs(rows.arrays[name]) > _IMPOSSIBLE).any(axis=1)
    if bad.mean() > _LOST:
        name, joint, row = next(
            (n, int(j), int(r))
            for n in rows.map.roles()
            for r, j in np.argwhere(~(np.abs(rows.arrays[n]) < _IMPOSSIBLE))[:1]
        )
        raise rows.refuse(name, joint, row, f"expected numbers below {_IMPOSSIBLE:g} in SI units: is the unit right?")
    if bad.any():
        rows.told("rows with impossible numbers are left out", True, bad)
        rows.keep(~bad)


def _misplaced(rows: _Rows) -> None:
    """Rows whose stamps lie far from those of their neighbours, as fields that slipped make them."""
    t = rows.arrays["t"]
    if len(t) < 2 * _NEIGHBOURS:
        return
    usual = float(np.median(np.abs(np.diff(t))))
    away = np.abs(t - signal.medfilt(t, _NEIGHBOURS))
    away[: _NEIGHBOURS // 2] = np.abs(t - np.median(t[:_NEIGHBOURS]))[: _NEIGHBOURS // 2]
    away[-(_NEIGHBOURS // 2) :] = np.abs(t - np.median(t[-_NEIGHBOURS:]))[-(_NEIGHBOURS // 2) :]
    bad = away > _OUT_OF_PLACE * _NEIGHBOURS * usual
    if usual and bad.any():
        rows.told("rows with stamps out of place are left out", True, bad)
        rows.keep(~bad)


def _time(rows: _Rows) -> None:
    """Stamps that repeat, go back, restart, and their unit."""
    t, episode = rows.arrays["t"], rows.arrays["episode"]
    back = np.diff(t, prepend=t[:1]) < 0.0
    restart = back & (t < t[0] + 0.25 * (np.maximum.accumulate(t) - t[0]))
    if 0.0 < restart.mean() < _FEW and not rows.map.episode:
        rows.told("stamps begin again: taken as new episodes", True, restart)
        rows.arrays["episode"] = episode = np.cumsum(restart).astype(float)
    kept = np.ones(len(t), dtype=bool)
    for number in np.unique(episode):
        inside = np.flatnonzero(episode == number)
        latest = np.maximum.accumulate(t[inside])
        kept[inside] = np.concatenate([[True], t[inside][1:] > latest[:-1]])
    late = ~kept
    repeated = late & (np.diff(t, prepend=-np.inf) == 0.0)
    if repeated.any():
        rows.told("stamps repeat: the later rows are left out", True, repeated)
    if (late & ~repeated).any():
        rows.told("stamps go back: the rows are left out", True, late & ~repeated)
    if late.mean() > _LOST:
        raise RecordingError(
            f"{rows.source}: column {rows.map.time}, row {rows.row[np.argmax(late)]}: expected rising stamps, got "
            f"{late.sum()} that do not rise"
        )
    rows.keep(kept)
    steps = np.diff(rows.arrays["t"])
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if not 1e-5 <= usual <= 2.0:
        unit = "ms" if 2.0 < usual <= 2e3 else "us" if 2e3 < usual <= 2e6 else "ns" if usual > 2e6 else "s"
        raise RecordingError(
            f"{rows.source}: column {rows.map.time}: a row every {usual:g} s: is time_unit = {unit!r} meant?"
        )
    jitter = np.abs(steps / usual - 1.0) > 0.2
    if jitter.mean() > 0.05:
        rows.told(
            f"stamps jitter: {steps.min():.3g} to {np.percentile(steps, 99):.3g} s apart, brought to {usual:.3g} s",
            True,
        )


def _missing(rows: _Rows) -> None:
    """Missing values: a few in a row are drawn through, more are a gap."""
    gone = np.zeros(len(rows.row), dtype=bool)
    for name in rows.map.roles():
        for joint, values in enumerate(rows.arrays[name].T):
            bad = ~np.isfinite(values)
            if not bad.any():
                continue
            if bad.all():
                raise rows.refuse(name, joint, 0, "expected numbers, got none in any row")
            long = _runs(bad, _BRIDGED + 1)
            gone |= long
            known = np.flatnonzero(~bad)
            values[bad] = np.interp(np.flatnonzero(bad), known, values[known])
            text = "missing values are drawn through" if not long.any() else "missing values are left out as a gap"
            rows.told(text, True, bad, rows.name(name, joint))
    if gone.any():
        rows.keep(~gone)


def _runs(flags: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """Where at least so many flags stand in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    found = np.zeros_like(flags)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        found[start:stop] = stop - start >= least
    return found


def _turns(rows: _Rows, arm: Arm | None) -> None:
    """Positions that jump by a whole turn."""
    for name in ("position", "command"):
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
                rows.told("jumps by a turn are taken out", True, jumps, rows.name(name, joint))
                steps = np.where(jumps, -np.sign(np.diff(values, prepend=values[:1])) * turn, 0.0)
                rows.arrays[name][:, joint] = values + np.cumsum(steps)


def _spikes(rows: _Rows) -> None:
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
                rows.told("single values far from their neighbours are left out", True, spike, rows.name(name, joint))
                bad |= spike
    if bad.any():
        rows.keep(~bad)


def _frozen(rows: _Rows) -> None:
    """Joints that read the same for long while their command, velocity or usual motion says that they move."""
    t = rows.arrays["t"]
    bad = np.zeros(len(t), dtype=bool)
    for joint, values in enumerate(rows.arrays["position"].T):
        same = np.diff(values, prepend=np.nan) == 0.0
        if same.all():
            rows.told("the joint never moves: nothing can be said of it", False, None, rows.name("position", joint))
            continue
        least = max(5, int(_FROZEN / max(float(np.median(np.diff(t))), 1e-6)))
        long = _runs(same, least)
        for start, stop in _spans(long):
            bad[start:stop] |= _travelled(rows, joint, start, stop) > _MISSED * np.ptp(values)
    if bad.any():
        rows.told("a position stands still while the joint moves: the rows are left out as a gap", True, bad)
        rows.keep(~bad)


def _travelled(rows: _Rows, joint: int, start: int, stop: int) -> float:
    """How far a joint must have come while its position read the same, by its velocity or by the jump after it."""
    values, t = rows.arrays["position"][:, joint], rows.arrays["t"]
    if "velocity" in rows.arrays:
        return float(np.trapezoid(np.abs(rows.arrays["velocity"][start:stop, joint]), t[start:stop]))
    usual = float(np.percentile(np.abs(np.diff(values)), 99.0))
    jump = float(abs(values[min(stop, len(values) - 1)] - values[stop - 1]))
    return jump if jump > 3.0 * usual else 0.0


def _spans(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _clipped(rows: _Rows) -> None:
    """Efforts that were cut off: their rows say nothing."""
    if "effort" not in rows.arrays:
        return
    bad = np.zeros(len(rows.row), dtype=bool)
    for joint, values in enumerate(rows.arrays["effort"].T):
        for limit in (values.max(), values.min()):
            at = values == limit
            near = np.abs(values - limit) < max(0.02 * np.ptp(values), 1.5 * _quantum(values))
            cut = _runs(at, _CLIPPED)
            if cut.any() and values.std() > 0.0 and at.sum() > _PILED * (near & ~at).sum():
                rows.told(
                    f"effort is cut off at {limit:.4g}: the rows are left out", True, cut, rows.name("effort", joint)
                )
                bad |= at
        if values.std() == 0.0:
            rows.told("the effort never changes: nothing can be said of it", False, None, rows.name("effort", joint))
    if bad.any():
        rows.keep(~bad)


def _quantum(values: Array) -> float:
    """The usual step between neighbouring values that occur."""
    steps = np.diff(np.unique(values))
    return float(np.median(steps)) if len(steps) else 0.0


def _velocities(rows: _Rows) -> None:
    """Velocities that are not those of the positions: wrong units, signs or order."""
    if "velocity" not in rows.arrays:
        return
    t = rows.arrays["t"]
    steps = np.diff(t)
    usual = float(np.median(steps))
    inside = (steps < _GAP * usual) & (np.diff(rows.arrays["episode"]) == 0.0)
    doubtful: list[str] = []
    for joint in range(rows.arrays["position"].shape[1]):
        slope = np.diff(rows.arrays["position"][:, joint])[inside] / steps[inside]
        speed = 0.5 * (rows.arrays["velocity"][1:, joint] + rows.arrays["velocity"][:-1, joint])[inside]
        power = float(speed @ speed)
        if max(power, float(slope @ slope)) < _STILL**2 * len(speed):
            continue
        ratio = float(slope @ speed) / (power + 1e-300)
        fits = float(slope @ speed) / np.sqrt(power * float(slope @ slope) + 1e-300)
        wrong = next((name for name, factor in _MISTAKES.items() if abs(ratio / factor - 1.0) < _SLOPE), "")
        if abs(fits) > 0.8 and wrong:
            message = f"positions change {ratio:.3g} times as fast as the velocity says: {wrong}"
            raise rows.refuse("velocity", joint, 0, message)
        if fits < 0.9 or abs(ratio - 1.0) > _SLOPE:
            doubtful.append(rows.name("velocity", joint))
    if doubtful:
        names = ", ".join(doubtful)
        rows.told(f"velocities do not follow the positions ({names}): positions are differentiated instead", True)
        del rows.arrays["velocity"]


def _limits(rows: _Rows, arm: Arm | None) -> None:
    """Positions that the arm cannot have."""
    if arm is None or rows.map.position.unit == "percent":
        return
    bad = np.zeros(len(rows.row), dtype=bool)
    for joint, (limits, values) in enumerate(zip(arm.joints, rows.arrays["position"].T, strict=True)):
        beyond = np.maximum(values - limits.upper, limits.lower - values) > _LIMIT
        if beyond.mean() > _FEW:
            row = int(np.argmax(beyond))
            expected = f"expected {limits.lower:.3g} to {limits.upper:.3g}, got {values[row]:.4g}"
            raise rows.refuse("position", joint, row, f"{expected}: is the unit right?")
        if beyond.any():
            name = rows.name("position", joint)
            rows.told("positions beyond the joint's limits: the rows are left out", True, beyond, name)
            bad |= beyond
    if bad.any():
        rows.keep(~bad)


def _finished(rows: _Rows, arm: Arm | None) -> Measurement:
    arrays = rows.arrays
    t, episode = arrays["t"], arrays["episode"].astype(np.int64)
    steps = np.diff(t)
    new = np.diff(episode) != 0
    usual = float(np.median(steps[~new])) if (~new).any() else 0.0
    gap = (steps > _GAP * usual) & ~new
    if gap.any():
        rows.told(f"gaps of up to {steps[gap].max():.3g} s: each side counts by itself", True, np.append(gap, False))
    names = rows.map.position.columns if arm is None else tuple(joint.name for joint in arm.joints)
    kind: Effort | None = None
    if (role := rows.map.effort) is not None and role.unit:
        kind = EFFORTS[role.unit][1]
    return Measurement(
        rows.source,
        names,
        t,
        arrays["position"],
        arrays.get("velocity"),
        arrays.get("effort"),
        kind,
        arrays.get("command"),
        arrays.get("temperature"),
        (0, *(np.flatnonzero(new | gap) + 1).tolist()),
        episode,
        tuple(rows.odd),
    )
