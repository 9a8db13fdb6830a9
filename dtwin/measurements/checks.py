"""From a table and a map to a measurement: units, then what is wrong with rows and columns.

What can be put right without a guess about the arm is put right and told: rows out of order, repeated stamps, single
missing values, turns. What cannot be is left out as a gap, or refused with column and row.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError
from dtwin.measurements import jumps, repairs
from dtwin.measurements.columns import ANGLES, EFFORTS, TIME, ColumnMap, Role
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Array, Effort, Measurement
from dtwin.measurements.naming import GRIPPED, parsed_name
from dtwin.measurements.rows import Rows

_IMPOSSIBLE: Final = 1e4
"""No joint, speed or effort of a robot arm has such a number in SI units."""
_NEIGHBOURS: Final = 21
"""Rows whose middle stamp a row is held against."""
_OUT_OF_PLACE: Final = 10.0
"""Distance from it, in steps of all neighbours, that no gap explains for a few rows alone."""
_LOST: Final = 0.5
"""Share of rows that may be left out."""
_LEAST: Final = 20
"""Rows below which a log says nothing."""
_TURN: Final = 2.0 * np.pi


def measurement_of(table: Table, columns: ColumnMap, arm: Arm | None = None) -> Measurement:
    """Makes a measurement of a table.

    Args:
        table: columns of a file.
        columns: what they mean, checked against the table.
        arm: the arm, if it is known: its limits find wrong units.

    Raises:
        RecordingError: something is wrong that cannot be put right; the message names column and row.
    """
    rows = Rows(table, columns)
    if rows.count < _LEAST:
        raise RecordingError(f"{table.source}: expected at least {_LEAST} rows, got {rows.count}")
    for name, role in columns.roles().items():
        rows.arrays[name] = _in_units(table, name, role)
    rows.arrays["t"] = _stamps(table, columns)
    rows.arrays["episode"] = table.columns[columns.episode] if columns.episode else np.zeros(rows.count)
    if columns.gripped:
        rows.arrays[GRIPPED] = (table.columns[columns.gripped] != 0.0).astype(np.float64)
    _impossible(rows)
    _misplaced(rows)
    _time(rows)
    repairs.missing(rows)
    repairs.spikes(rows)
    repairs.turns(rows, arm)
    jumps.wraps(rows)
    repairs.limits(rows, arm)
    repairs.frozen(rows)
    jumps.jumps(rows)
    repairs.clipped(rows)
    repairs.held(rows)
    if len(rows.row) < max(_LEAST, (1.0 - _LOST) * rows.count):
        worst = max(rows.odd, key=lambda odd: odd.count, default=None)
        lost = f"{rows.count - len(rows.row)} of {rows.count} rows cannot be used"
        if worst is None:
            raise RecordingError(f"{table.source}: {lost}: expected at least {_LEAST}")
        place = f"column {worst.column or columns.time or columns.position.columns[0]}, row {max(worst.row, 0)}"
        raise RecordingError(f"{table.source}: {place}: {worst.what}; {lost}, {worst.count} of them for that")
    repairs.velocities(rows)
    repairs.motors(rows)
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
            f"{table.source}: no column of stamps: expected time, or rate (rows a second), in a map of columns "
            f"(--columns); the file has {', '.join(table.columns)}"
        )
    return table.rows / columns.rate


def _impossible(rows: Rows) -> None:
    """Rows with numbers that damaged files have."""
    bad = ~np.isfinite(rows.arrays["t"])
    for values in rows.arrays.values():
        with np.errstate(invalid="ignore"):
            bad |= (np.abs(values) > 1e15).reshape(rows.count, -1).any(axis=1)
    for name in rows.map.roles():
        with np.errstate(invalid="ignore"):
            bad |= (np.abs(rows.arrays[name]) > _IMPOSSIBLE).any(axis=1)
    if bad.mean() > _LOST:
        worst = next(
            (
                (n, int(j), int(r))
                for n in rows.map.roles()
                for r, j in np.argwhere(np.abs(rows.arrays[n]) > _IMPOSSIBLE)[:1]
            ),
            None,
        )
        if worst is None:
            where = f"column {rows.map.time or rows.map.episode}, row {rows.row[np.argmax(bad)]}"
            raise RecordingError(f"{rows.source}: {where}: expected stamps below 1e15 s: is the unit right?")
        name, joint, row = worst
        raise rows.refuse(name, joint, row, f"expected numbers below {_IMPOSSIBLE:g} in SI units: is the unit right?")
    if bad.any():
        rows.note("rows with impossible numbers are left out", True, bad)
        rows.keep(~bad)


def _misplaced(rows: Rows) -> None:
    """Rows whose stamps lie far from those of their neighbours, as fields that slipped make them."""
    t = rows.arrays["t"]
    if len(t) < 2 * _NEIGHBOURS:
        return
    from scipy.ndimage import median_filter  # loaded for foreign logs alone

    usual = float(np.median(np.abs(np.diff(t))))
    away = np.abs(t - median_filter(t, _NEIGHBOURS))
    away[: _NEIGHBOURS // 2] = np.abs(t - np.median(t[:_NEIGHBOURS]))[: _NEIGHBOURS // 2]
    away[-(_NEIGHBOURS // 2) :] = np.abs(t - np.median(t[-_NEIGHBOURS:]))[-(_NEIGHBOURS // 2) :]
    bad = away > _OUT_OF_PLACE * _NEIGHBOURS * usual
    if usual and bad.any():
        rows.note("rows with stamps out of place are left out", True, bad)
        rows.keep(~bad)


def _time(rows: Rows) -> None:
    """Stamps that repeat, go back, restart, and their unit."""
    t, episode = rows.arrays["t"], rows.arrays["episode"]
    back = np.diff(t, prepend=t[:1]) < 0.0
    restart = back & (t < t[0] + 0.25 * (np.maximum.accumulate(t) - t[0]))
    if 0.0 < restart.mean() < repairs.FEW and not rows.map.episode:
        rows.note("stamps begin again: taken as new episodes", True, restart)
        rows.arrays["episode"] = episode = np.cumsum(restart).astype(float)
    kept = np.ones(len(t), dtype=bool)
    for number in np.unique(episode):
        inside = np.flatnonzero(episode == number)
        latest = np.maximum.accumulate(t[inside])
        kept[inside] = np.concatenate([[True], t[inside][1:] > latest[:-1]])
    late = ~kept
    repeated = late & (np.diff(t, prepend=-np.inf) == 0.0)
    if repeated.any():
        rows.note("stamps repeat: the later rows are left out", True, repeated)
    if (late & ~repeated).any():
        rows.note("stamps go back: the rows are left out", True, late & ~repeated)
    if late.mean() > _LOST:
        raise RecordingError(
            f"{rows.source}: column {rows.map.time}, row {rows.row[np.argmax(late)]}: expected rising stamps, got "
            f"{late.sum()} that do not rise"
        )
    rows.keep(kept)
    steps = np.diff(rows.arrays["t"])
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if not 1e-5 <= usual <= 2.0:
        unit = "ms" if 2.0 < usual <= 2e3 else "us" if 2e3 < usual <= 2e6 else "ns" if usual > 2e6 else ""
        asked = f"is time_unit = {unit!r} meant?" if unit else "expected at least 1e-5 s: are these days?"
        raise RecordingError(
            f"{rows.source}: column {rows.map.time}, row {rows.row[0]}: a row every {usual:g} s: {asked}"
        )
    jitter = np.abs(steps / usual - 1.0) > 0.2
    if jitter.mean() > 0.05:
        rows.note(
            f"stamps jitter: {steps.min():.3g} to {np.percentile(steps, 99):.3g} s apart, brought to {usual:.3g} s",
            True,
        )


def _finished(rows: Rows, arm: Arm | None) -> Measurement:
    arrays = rows.arrays
    t, episode = arrays["t"], arrays["episode"].astype(np.int64)
    steps = np.diff(t)
    new = np.diff(episode) != 0
    usual = float(np.median(steps[~new])) if (~new).any() else 0.0
    gap = (steps > repairs.GAP * usual) & ~new
    apart = gap | (arrays[jumps.APART][1:] > 0.0)
    if gap.any():
        rows.note(f"gaps of up to {steps[gap].max():.3g} s: each side counts by itself", True, np.append(gap, False))
    names = _short(rows.map.position.columns) if arm is None else tuple(joint.name for joint in arm.joints)
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
        (0, *(np.flatnonzero(new | apart) + 1).tolist()),
        episode,
        tuple(rows.odd),
        arrays.get("motor"),
        arrays[GRIPPED] > 0.0 if GRIPPED in arrays else None,
    )


def _short(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of columns without the words that all of them have, such as observation.state.shoulder.pos."""
    said = [parsed_name(name) for name in names]
    if all(said):
        return tuple(each.joint for each in said if each)
    words = [name.split(".") for name in names]
    if len(names) < 2 or min(map(len, words)) < 2:
        return names
    while min(map(len, words)) > 1 and len({word[0] for word in words}) == 1:
        words = [word[1:] for word in words]
    while min(map(len, words)) > 1 and len({word[-1] for word in words}) == 1:
        words = [word[:-1] for word in words]
    return tuple(".".join(word) for word in words)
