"""Arrays that another program has in memory as a measurement, checked as files are."""

from __future__ import annotations

import reprlib
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import numpy as np

from dtwin.errors import ParameterError, choices
from dtwin.measurements import naming
from dtwin.measurements.checks import measurement_of
from dtwin.measurements.columns import ANGLES, EFFORTS, ColumnMap, Role
from dtwin.measurements.columns import TIME as TIMES
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Array, Measurement

Numbers = np.ndarray | Sequence
"""An array, or lists that make one."""
_POSITIONS: Final = tuple(unit for unit in ANGLES if unit != "tick")  # whose number a turn nothing here says
UNITS: Final[Mapping[str, Collection[str]]] = {
    "t": TIMES,
    "q": _POSITIONS,
    "command": _POSITIONS,
    "velocity": _POSITIONS,
    "torque": [unit for unit, (_, kind) in EFFORTS.items() if kind == "torque"],
    "current": [unit for unit, (_, kind) in EFFORTS.items() if kind == "current"],
}
"""Units of each argument; the first one counts where none is said."""
_QUANTITIES: Final = {"q": "position", "command": "command", "velocity": "velocity", "torque": "torque"} | {
    "current": "current"
}


def measurement_from(
    stamps: Numbers | float, given: Mapping[str, Numbers], names: Sequence[str], units: Mapping[str, str]
) -> Measurement:
    """Makes a measurement of arrays.

    Args:
        stamps: (N,), or rows a second.
        given: arrays (N, n), or (N,) of a single joint, by their argument: q, command, velocity, torque or current.
        names: of the joints, (n,); none for 1 to n.
        units: of each argument; the first of `UNITS` where none is said, and that of q for command and velocity.

    Raises:
        ParameterError: shapes, names or units are not what they should be.
        RecordingError: a number is impossible, or something is wrong that cannot be put right; the message names
            column and row.
    """
    if "torque" in given and "current" in given:
        raise ParameterError("torque, current: expected one of them: a measurement has one kind of effort")
    chosen = _units(units)
    q = _matrix("q", given["q"], None)
    rows, n = q.shape
    joints = tuple(names) or tuple(str(number) for number in range(1, n + 1))
    if len(joints) != n:
        raise ParameterError(f"names: expected {n}, one for each column of q, got {len(joints)}")
    naming.checked_joints("names", joints)
    columns: dict[str, Array] = {}
    roles: dict[str, Any] = {}
    for argument, values in given.items():
        matrix = _matrix(argument, values, (rows, n))
        mine = [naming.column_name(_QUANTITIES[argument], joint, chosen[argument]) for joint in joints]
        columns |= dict(zip(mine, matrix.T, strict=True))
        role = "effort" if argument in ("torque", "current") else _QUANTITIES[argument]
        roles[role] = Role(tuple(mine), chosen[argument])
    if isinstance(stamps, (int, float)):
        if not 0.0 < stamps < float("inf"):
            raise ParameterError(f"t: expected stamps, or rows a second above 0, got {stamps:g}")
        stamped = ColumnMap(rate=float(stamps), **roles)
    else:
        columns["t"] = _array("t", stamps)
        if columns["t"].shape != (rows,):
            raise ParameterError(
                f"t: expected shape ({rows},), one stamp for each row of q, got {columns['t'].shape}"
            )
        stamped = ColumnMap(time="t", time_unit=chosen["t"], **roles)
    return measurement_of(Table("arrays", columns, np.arange(rows)), stamped)


def _units(units: Mapping[str, str]) -> dict[str, str]:
    for argument, unit in units.items():
        if argument not in UNITS:
            raise ParameterError(f"units: expected {choices(UNITS)}, got {argument!r}")
        if unit not in UNITS[argument]:
            raise ParameterError(f"units: {argument}: expected {choices(UNITS[argument])}, got {unit!r}")
    usual = {argument: next(iter(valid)) for argument, valid in UNITS.items()}
    angle = units.get("q", usual["q"])
    return usual | {"command": angle, "velocity": angle} | dict(units)


def _matrix(argument: str, values: Numbers, shape: tuple[int, int] | None) -> Array:
    """An array (N, n); one of a single joint may be (N,)."""
    found = _array(argument, values)
    upright = found[:, None] if found.ndim == 1 else found
    if upright.ndim != 2 or not upright.size or (shape is not None and upright.shape != shape):
        expected = "(N, n)" if shape is None else f"{shape}, as q has"
        raise ParameterError(f"{argument}: expected shape {expected}, got {found.shape}")
    return upright


def _array(argument: str, values: Numbers) -> Array:
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ParameterError(f"{argument}: expected numbers, got {reprlib.repr(values)}") from None
