"""What the columns of a table mean: a map that is guessed, shown, and corrected by a person.

time = "t"
time_unit = "s"              # s, ms, us, ns; or rate = 100.0 where rows have no stamps

[position]
columns = ["q1", "q2"]
unit = "deg"                 # rad, deg, turn, percent, m, mm; ticks = 4096 a turn
sign = [1, -1]               # optional, one for each joint
offset = [0.0, 0.1]          # optional, rad or m, taken away
gear = [100.0, 100.0]        # optional, where the motor's side was measured

[effort]
columns = ["i1", "i2"]
unit = "A"                   # N m, mN m, N, A, mA, V

[command]                    # and [velocity], [temperature]

[motor]                      # a second encoder, at the motor; its gear brings it to the joint's side
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.errors import RecordingError, choices
from dtwin.files import reason_of
from dtwin.measurements import naming
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Effort, Oddity

_TURN: Final = 2.0 * np.pi
TIME: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLES: Final = {"rad": 1.0, "deg": np.pi / 180.0, "turn": _TURN, "m": 1.0, "mm": 1e-3, "percent": 0.01, "tick": 1.0}
"""Factors to rad or m; percent stays a part of the range, as nobody but the calibration knows that."""
EFFORTS: Final[dict[str, tuple[float, Effort]]] = {
    "N m": (1.0, "torque"),
    "mN m": (1e-3, "torque"),
    "N": (1.0, "torque"),
    "A": (1.0, "current"),
    "mA": (1e-3, "current"),
    "V": (1.0, "voltage"),
}


ROLES: Final = ("position", "velocity", "effort", "command", "temperature", "motor")
"""Quantities that a map may name columns of."""


class Role(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Columns of one quantity, one for each joint.

    Attributes:
        columns: their names.
        unit: their unit; "" where nobody said it.
        sign: 1 or -1 for each joint; none for 1.
        offset: what is taken away of each, rad or m.
        gear: turns of what was measured for one of the joint.
        ticks: steps a turn where the unit is tick.
    """

    columns: tuple[str, ...]
    unit: str = ""
    sign: tuple[float, ...] = ()
    offset: tuple[float, ...] = ()
    gear: tuple[float, ...] = ()
    ticks: float = 4096.0


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the columns of a table mean.

    Attributes:
        position: measured positions.
        time: column of the stamps; "" where there are none.
        time_unit: unit of the stamps.
        rate: rows a second where there are no stamps.
        velocity: measured velocities.
        effort: torque, current or voltage.
        command: commanded positions.
        temperature: temperatures of the drives, degrees Celsius.
        motor: positions on the motors' side of the gears, where they were measured as well.
        episode: column of the episode's number.
    """

    position: Role
    time: str = ""
    time_unit: str = "s"
    rate: float = 0.0
    velocity: Role | None = None
    effort: Role | None = None
    command: Role | None = None
    temperature: Role | None = None
    motor: Role | None = None
    episode: str = ""

    def roles(self) -> dict[str, Role]:
        found = {name: getattr(self, name) for name in ROLES}
        return {name: role for name, role in found.items() if role is not None}


def read_map(path: Path) -> ColumnMap:
    """Reads a map.

    Raises:
        RecordingError: the file cannot be read, or holds what no map has.
    """
    try:
        return msgspec.toml.decode(path.read_bytes(), type=ColumnMap)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise RecordingError(f"{path}: expected a map of columns: {error}") from None


def map_text(columns: ColumnMap) -> str:
    """The map as the TOML that `read_map` reads."""
    values = msgspec.to_builtins(columns)
    plain = {k: v for k, v in values.items() if v not in (None, "", 0.0) and not isinstance(v, dict)}
    lines = [f"{name} = {msgspec.json.encode(value).decode()}" for name, value in plain.items()]
    for name, role in values.items():
        if isinstance(role, dict):
            usual = role["unit"] == "tick"
            kept = {
                k: v for k, v in role.items() if (v not in ((), [], "") and k != "ticks") or (k == "ticks" and usual)
            }
            lines += ["", f"[{name}]", *(f"{k} = {msgspec.json.encode(v).decode()}" for k, v in kept.items())]
    return "\n".join(lines) + "\n"


def checked_map(columns: ColumnMap, table: Table, joints: int | None = None) -> ColumnMap:
    """The map, if the table has what it names.

    Args:
        columns: a map.
        table: columns of a file.
        joints: number of joints of the arm; None where no arm is known.

    Raises:
        RecordingError: a column, a unit or a number of joints is not what it should be.
    """
    wanted = len(columns.position.columns) if joints is None else joints
    if columns.time_unit not in TIME:
        raise RecordingError(f"map: time_unit: expected {choices(TIME)}, got {columns.time_unit!r}")
    singles = [name for name in (columns.time, columns.episode) if name]
    for name in singles + [c for role in columns.roles().values() for c in role.columns]:
        if name not in table.columns:
            raise RecordingError(
                f"{table.source}: column {name!r} is missing: the file has {', '.join(table.columns)}"
            )
    for what, role in columns.roles().items():
        if len(role.columns) != wanted:
            raise RecordingError(
                f"map: {what}: expected {wanted} columns, one for each joint, got {len(role.columns)}"
            )
        units = EFFORTS if what == "effort" else ["C"] if what == "temperature" else ANGLES
        if role.unit and role.unit not in units:
            raise RecordingError(f"map: {what}: expected a unit {choices(units)}, got {role.unit!r}")
        for name in ("sign", "offset", "gear"):
            if (got := len(getattr(role, name))) not in (0, wanted):
                raise RecordingError(f"map: {what}: {name}: expected {wanted} numbers or none, got {got}")
        if any(abs(sign) != 1.0 for sign in role.sign):
            raise RecordingError(f"map: {what}: sign: expected 1 or -1, got {role.sign}")
        if any(not gear for gear in role.gear) or not role.ticks > 0.0:
            raise RecordingError(f"map: {what}: expected gears other than 0 and ticks above 0")
    return columns


_NAMES: Final = {
    "motor": r"((motor|rotor)_?(pos|angle)|(pos|angle|theta)_?(motor|rotor)|^q_?m(otor)?_?\d|^theta_?m_?\d)",
    "command": r"(^action\b|cmd|command|target|desired|goal|setpoint|_des\b|des_|_ref\b)",
    "velocity": r"(^qd\b|^q?d_?q|^qd\d|^dq|^v\d|vel|qdot|omega|speed)",
    "effort": r"(tau|torq|effort|curr(?!ent_?(joint_?)?(pos|ang|state|q))|^i_?\d|amp|volt|load)",
    "temperature": r"(temp)",
    "position": r"(^q\b|^q_?\d|^q\.|pos|angle|theta|joint|observation\.state|state|measured)",
}
_TIME_NAMES: Final = (
    r"^(t|time|timestamp|stamp|sec|seconds|time_?s|timestamp_s|elapsed|t_?(ms|us|ns)|time_?(ms|us|ns))$"
)
_MEASURED: Final = r"(meas|actual|present)"
"""Words that tell what was measured from what was computed."""
_NO_ANGLE: Final = rf"({_NAMES['velocity'][1:-1]}|^qd|{_NAMES['effort'][1:-1]})"
"""Names of commands that are no positions."""
_EPISODES: Final = r"^(episode|episode_index|episode_id|run|trial)$"
_APART: Final = 10
"""Rows over which a slope is taken, so that steps of the encoder and jitter of the stamps do not hide it."""
_CELL: Final = ("measured_1", "measured_2", "measured_3", "volts_1", "volts_2", "volts_3", "t")
"""Columns of a log of the cell: what was measured, not what was true."""
_TARGETS: Final = ("target_1", "target_2", "target_3")
_LEFT_OUT: Final = (
    r"(frame|index|ee_|est|err|mask|valid|raw|feedback|feedforward|friction|rigid|qdd|accel|quat|payload)"
)


def guess_map(table: Table, joints: int | None = None) -> ColumnMap:
    """What the columns seem to mean, by their names, or by their numbers where the file has no header.

    Units of effort are never guessed by the size of numbers: only a name that says them counts.

    Raises:
        RecordingError: no columns look like positions.
    """
    return guess(table, joints)[0]


def guess(table: Table, joints: int | None = None) -> tuple[ColumnMap, tuple[Oddity, ...]]:
    """What the columns seem to mean, and what of it is not clear.

    Raises:
        RecordingError: no columns look like positions.
    """
    if not table.named:
        return _by_numbers(table, joints), ()
    if naming.is_ours(table.columns):
        return _by_our_names(table), ()
    if set(_CELL) <= set(table.columns):
        cell = ColumnMap(Role(_CELL[:3], "rad"), "t", effort=Role(_CELL[3:6], "V"), command=_targets(table))
        return cell, ()
    names = list(table.columns)
    time = next((n for n in names if re.search(_TIME_NAMES, n, re.IGNORECASE)), "")
    episode = next((n for n in names if re.search(_EPISODES, n, re.IGNORECASE)), "")
    groups: dict[str, dict[str, list[str]]] = {}
    for name in names:
        if name in (time, episode) or re.search(_LEFT_OUT, name, re.IGNORECASE):
            continue
        role = next((r for r, pattern in _NAMES.items() if re.search(pattern, name, re.IGNORECASE)), None)
        if role:
            groups.setdefault(role, {}).setdefault(_stem(name), []).append(name)
    if "position" not in groups and "motor" in groups:  # the only encoders that there are
        groups["position"] = groups.pop("motor")
    if not groups.get("position"):
        raise RecordingError(
            f"{table.source}: no columns look like positions: give --columns MAP; the file has {', '.join(names)}"
        )
    count = len(_fitting(groups["position"], joints))
    roles: dict[str, Any] = {}
    unclear: list[Oddity] = []
    for role, stems in groups.items():
        found, why = _chosen(role, {stem: found for stem, found in stems.items() if len(found) == count})
        unclear += why
        if found:
            roles[role] = Role(tuple(found), _unit(role, found, table))
    unit = next((u for u in ("ms", "us", "ns") if re.search(rf"_?{u}$", time, re.IGNORECASE)), "s")
    return ColumnMap(time=time, time_unit=unit, episode=episode, **roles), tuple(unclear)


def _chosen(role: str, stems: dict[str, list[str]]) -> tuple[list[str], list[Oddity]]:
    """The columns of a quantity among groups that have one for each joint, and what is not clear.

    Which of several sensors of temperature tells that of the friction or of the magnets, no name says; so none is
    taken.
    """
    if role == "command":
        stems = {stem: found for stem, found in stems.items() if not re.search(_NO_ANGLE, stem, re.IGNORECASE)}
    measured = {stem: found for stem, found in stems.items() if re.search(_MEASURED, stem, re.IGNORECASE)}
    left = measured if len(measured) == 1 else stems
    if len(left) < 2 or role in ("position", "command"):
        return next(iter(left.values()), []), []
    names, first = ", ".join(left), next(iter(left))
    if role == "temperature":
        what = f"temperatures of several kinds ({names}): none is taken, as a map of columns has to say which counts"
        return [], [Oddity(what, False, left[first][0])]
    what = f"{role} of several kinds ({names}): {first} is taken, a map of columns can name another one"
    return left[first], [Oddity(what, False, left[first][0])]


def _targets(table: Table) -> Role | None:
    """Desired positions of a log of the cell, where it has them."""
    return Role(_TARGETS, "rad") if set(_TARGETS) <= set(table.columns) else None


def _by_our_names(table: Table) -> ColumnMap:
    """What the columns of a file that we wrote are: they say it. Quantities that not every joint has are left out."""
    found: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for name in table.columns:
        if (said := naming.parsed_name(name)) is not None:
            role = "effort" if said.quantity in naming.KINDS else said.quantity
            found.setdefault(role, {})[said.joint] = name
            units[role] = "" if said.unit == "?" else said.unit
    joints = found.get("position", {})
    if not joints:
        raise RecordingError(f"{table.source}: no columns of positions: the file has {', '.join(table.columns)}")
    roles: dict[str, Any] = {
        role: Role(tuple(columns[joint] for joint in joints), units[role])
        for role, columns in found.items()
        if set(columns) == set(joints)
    }
    return ColumnMap(time=naming.TIME, episode=naming.EPISODE if naming.EPISODE in table.columns else "", **roles)


def _stem(name: str) -> str:
    """What the columns of one quantity have in common: q of q1 and q.0, position of position.elbow."""
    for known in ("action", "observation.state"):
        if name.startswith(f"{known}."):
            return known
    return name.rpartition(".")[0] or re.sub(r"\d+$", "", name).rstrip("_")


def _fitting(stems: dict[str, list[str]], joints: int | None) -> list[str]:
    """The columns of the first stem that has one for each joint, or of the largest."""
    return next((found for found in stems.values() if len(found) == joints), max(stems.values(), key=len))


def _unit(role: str, names: list[str], table: Table) -> str:
    said = " ".join(names).lower()
    if role == "effort":
        if re.search(r"tau|torq|_nm\b", said):
            return "N m"
        return "A" if re.search(r"curr|amp|^i", said) else "V" if "volt" in said else ""
    if role == "temperature":
        return "C"
    if "deg" in said:
        return "deg"
    if said.count(".pos"):  # LeRobot: degrees or percent of the calibrated range, which the file does not say
        return "deg"
    largest = max(float(np.nanpercentile(np.abs(table.columns[name]), 99.0)) for name in names)
    return "deg" if largest > 2.0 * _TURN and role in ("position", "command") else "rad"


def _by_numbers(table: Table, joints: int | None) -> ColumnMap:
    """Columns without names: a rising one is time, then blocks of one column for each joint."""
    names = list(table.columns)
    first = table.columns[names[0]]
    rising = np.mean(np.diff(first) > 0.0) > 0.95
    left = names[1:] if rising else names
    count = joints or next((n for n in (6, 7) if len(left) % n == 0), len(left))
    if len(left) < count:
        raise RecordingError(f"{table.source}: expected at least {count} columns beside the time, got {len(left)}")
    blocks = [tuple(left[k : k + count]) for k in range(0, len(left) - count + 1, count)]
    velocity = None
    if len(blocks) > 1 and rising and _is_slope(table, names[0], blocks[0], blocks[1]):
        velocity = Role(blocks[1], "rad")
    # Only where a velocity is known for one is the next block an effort, and not another velocity.
    rest = blocks[2:] if velocity else []
    return ColumnMap(
        Role(blocks[0], "rad"),
        time=names[0] if rising else "",
        velocity=velocity,
        effort=Role(rest[0]) if rest else None,
    )


def _is_slope(table: Table, time: str, positions: tuple[str, ...], speeds: tuple[str, ...]) -> bool:
    """Whether one block is the derivative of the other, wherever the joints move."""
    t = table.columns[time]
    slopes, rates = [], []
    for position, speed in zip(positions, speeds, strict=True):
        ends, rate = table.columns[position], table.columns[speed]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope = (ends[_APART:] - ends[:-_APART]) / (t[_APART:] - t[:-_APART])
            mean = np.convolve(rate, np.ones(_APART) / _APART, "valid")[: len(slope)]
            ok = (np.abs(slope) < 1e3) & (np.abs(mean) < 1e3)
        slopes.append(slope[ok])
        rates.append(mean[ok])
    one, other = np.concatenate(slopes), np.concatenate(rates)
    fast = np.abs(other) > max(float(np.median(np.abs(other))), 1e-3)
    return bool(fast.any()) and float(np.mean(np.abs(one - other)[fast] < 0.2 * np.abs(other)[fast])) > 0.7
