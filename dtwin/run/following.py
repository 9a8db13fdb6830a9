"""A path that an arm follows, recorded or drawn, from a CSV file with times: joint positions, or points of its tool.

t,shoulder,elbow          t,x,y,z
0.00,0.10,0.50            0.00,0.40,0.10,0.30
0.02,0.11,0.49            0.02,0.41,0.10,0.30
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.poses import MOST, Poses, ranges
from dtwin.equations.kinematics import Goal, joints_along, joints_for, tool_of
from dtwin.errors import ParameterError, UnreachableError, choices
from dtwin.files import reason_of

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_POINT: Final = ("x", "y", "z")
_LARGEST: Final = 16_000_000
"""Largest file that is read, bytes."""
_ROWS: Final = 100_000
_SHORTEST: Final = 5
"""Least number of ticks from point to point."""
_APART: Final = 0.01
"""Largest distance from the path of the file, rad or m for a joint; a fifth of it for the tool, m."""
_ORDER: Final = 5


def read_path(path: Path, arm: Arm, dwell: float = 0.5) -> Poses:
    """Reads a path, as points of a curve of fifth order that the blocks go through without a rest.

    The curve begins and ends at rest and is fitted to the rows by least squares, so that the noise of a recording
    does not come through.

    Args:
        path: CSV file with a header: t, s, and all joints of the arm, rad or m, or x, y and z of its tool, m.
        arm: the arm; its speeds and accelerations must be known.
        dwell: time at the beginning and the end, s.

    Raises:
        ParameterError: the file cannot be read, has other columns, or the path asks too much of a joint; names the
            row or time, the joint, what was expected and what there is.
        UnreachableError: the tool does not reach a point; names the time.
    """
    names, rows = _read(path)
    joints = tuple(joint.name for joint in arm.joints)
    of_tool = set(names) == {"t", *_POINT} and set(names) != {"t", *joints}
    wanted = ("t", *(_POINT if of_tool else joints))
    if sorted(names) != sorted(wanted):
        known = f"{choices(('t', *joints)).replace(' or ', ' and ')}; or t, x, y and z of the tool"
        raise ParameterError(f"{path}: row 1: expected the columns {known}, got {', '.join(names)}")
    rows = rows[:, [names.index(name) for name in wanted]]
    t, values = rows[:, 0] - rows[0, 0], rows[:, 1:]
    if not (np.diff(t) > 0.0).all():
        number = int(np.argmin(np.diff(t) > 0.0)) + 3
        raise ParameterError(
            f"{path}: row {number}: t: expected more than in the row before, got {rows[number - 2, 0]}"
        )
    knots = _knots(float(t[-1]), arm.period)
    curve = _tool_curve(path, arm, t, values, knots) if of_tool else _fitted(t, values, knots)
    _check(path, arm, curve, knots[-1])
    if not of_tool:
        _check_near(path, joints, t, np.abs(curve(t) - values), _APART)
    speeds, changes = curve.derivative(1)(knots), curve.derivative(2)(knots)
    speeds[[0, -1]] = changes[[0, -1]] = 0.0
    return Poses(curve(knots), dwell, spacing=float(knots[1]), velocities=speeds, accelerations=changes)


def _read(path: Path) -> tuple[list[str], Array]:
    try:
        if path.stat().st_size > _LARGEST:
            raise ParameterError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        lines = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f"{path}: expected a CSV file: {error}") from None
    names = [name.strip() for name in lines[0]] if lines else []
    if not 3 <= len(lines) <= _ROWS:
        raise ParameterError(f"{path}: expected a header and 2 to {_ROWS - 1} rows, got {len(lines)} lines")
    rows = np.zeros((len(lines) - 1, len(names)))
    for number, line in enumerate(lines[1:], start=2):
        if len(line) != len(names):
            raise ParameterError(f"{path}: row {number}: expected {len(names)} values, got {len(line)}")
        for k, text in enumerate(line):
            try:
                rows[number - 2, k] = float(text)
            except ValueError:
                raise ParameterError(f"{path}: row {number}: {names[k]}: expected a number, got {text!r}") from None
            if not np.isfinite(rows[number - 2, k]):
                raise ParameterError(f"{path}: row {number}: {names[k]}: expected a finite number, got {text!r}")
    return names, rows


def _knots(duration: float, period: float) -> Array:
    """Times of the points: at most as many as the blocks have room for, whole ticks apart."""
    ticks = max(_ORDER + 1, int(np.ceil(duration / period - 1e-9)))
    apart = max(_SHORTEST, -(-ticks // (MOST - 1)))
    count = max(_ORDER, -(-ticks // apart))
    knots: Array = period * apart * np.arange(count + 1, dtype=np.float64)
    return knots


def _spline(knots: Array, values: Array) -> BSpline:
    """The curve of fifth order through points, at rest and without acceleration at both ends."""
    from scipy.interpolate import make_interp_spline  # loaded for a path alone, which few arms follow

    still = [(1, np.zeros(values.shape[1])), (2, np.zeros(values.shape[1]))]
    return make_interp_spline(knots, values, k=_ORDER, bc_type=(still, still))


def _fitted(t: Array, values: Array, knots: Array) -> BSpline:
    """The curve that is nearest to all rows; what lies between two far rows is on the line between them."""
    dense = np.unique(np.concatenate([t, knots[knots < t[-1]], knots[:-1] + 0.5 * knots[1], knots]))
    there = np.column_stack([np.interp(dense, t, column) for column in values.T])
    basis = _spline(knots, np.eye(len(knots)))(dense)
    points: Array = np.linalg.lstsq(basis, there, rcond=None)[0]
    return _spline(knots, points)


def _tool_curve(path: Path, arm: Arm, t: Array, points: Array, knots: Array) -> BSpline:
    """Joint positions that lead the tool along points, from knot to knot on straight lines in one configuration."""
    goals = _fitted(t, points, knots)(knots)
    lower, upper = ranges(arm)
    refused: UnreachableError | None = None
    for start in joints_for(arm, Goal(goals[0]), 0.5 * (lower + upper)):
        found = [start]
        try:
            for goal in goals[1:]:
                found.append(joints_along(arm, Goal(goal), found[-1]))
        except UnreachableError as error:
            refused = refused or UnreachableError(f"{path}: t = {knots[len(found)]:.4g} s: {error}")
            continue
        curve = _spline(knots, np.array(found))
        _check_near(path, _POINT, t, np.abs(tool_of(arm, curve(t))[0] - points), 0.2 * _APART)
        return curve
    assert refused is not None
    raise refused


def _check(path: Path, arm: Arm, curve: BSpline, duration: float) -> None:
    """Refuses a curve that leaves the range of a joint, or is faster than it, and says how much slower it may be."""
    t = np.arange(0.0, duration + 0.25 * arm.period, 0.5 * arm.period)
    values, speeds, changes = curve(t), curve.derivative(1)(t), curve.derivative(2)(t)
    for k, joint in enumerate(arm.joints):
        away = np.maximum(joint.lower - values[:, k], values[:, k] - joint.upper)
        if (away > 0.0).any():
            first = int(np.argmax(away > 0.0))
            expected = f"expected {joint.lower:.6g} to {joint.upper:.6g}, got {values[first, k]:.6g}"
            raise ParameterError(f"{path}: t = {t[first]:.4g} s: {joint.name}: {expected}")
        for what, limit, found, power in (
            ("speed", float(arm.path_speeds[k]), np.abs(speeds[:, k]), 1.0),
            ("acceleration", joint.acceleration, np.abs(changes[:, k]), 0.5),
        ):
            worst = int(np.argmax(found))
            if found[worst] > limit:
                slower = f"the same path in {duration * (found[worst] / limit) ** power:.3g} s keeps it"
                expected = f"expected at most {limit:.4g} of {what}, got {found[worst]:.4g}: {slower}"
                raise ParameterError(f"{path}: t = {t[worst]:.4g} s: {joint.name}: {expected}")


def _check_near(path: Path, names: tuple[str, ...], t: Array, away: Array, largest: float) -> None:
    row, column = np.unravel_index(int(np.argmax(away)), away.shape)
    if away[row, column] > largest:
        why = f"a curve through {MOST} points that begins and ends at rest is {away[row, column]:.3g} away"
        expected = f"expected at most {largest:g}: take a smoother, slower or shorter path"
        raise ParameterError(f"{path}: t = {t[row]:.4g} s: {names[column]}: {why}: {expected}")
