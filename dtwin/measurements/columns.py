"""What the columns of a table mean: a map that is guessed, shown, and corrected by a person.

time = "t"
time_unit = "s"              # s, ms, us, ns; or rate = 100.0 where rows have no stamps
gripped = "closed"           # optional: not 0 while the gripper is closed on what nobody has weighed

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
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError, choices
from dtwin.files import reason_of
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
        gripped: column that is not 0 while the gripper is closed; "" where there is none.
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
    gripped: str = ""

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
    singles = [name for name in (columns.time, columns.episode, columns.gripped) if name]
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


def in_order(columns: ColumnMap, arm: Arm) -> tuple[ColumnMap, tuple[Oddity, ...]]:
    """The map with its columns in the order of the arm's joints, where their names have those of the joints.

    Recordings name joints in any order, ROS often in that of the alphabet. Quantities whose columns do not name each
    joint once are left as they are.
    """
    names = [joint.name for joint in arm.joints]
    roles: dict[str, Role] = {}
    for what, role in columns.roles().items():
        found = places_of(names, role.columns)
        if found is not None and len(role.columns) == len(names) and found != sorted(found):
            lists = {key: getattr(role, key) for key in ("columns", "sign", "offset", "gear")}
            turned = {key: tuple(values[k] for k in found) if values else () for key, values in lists.items()}
            roles[what] = msgspec.structs.replace(role, **turned)
    if not roles:
        return columns, ()
    what = f"joints come in another order than the arm's ({', '.join(roles)}): they are taken by their names"
    return msgspec.structs.replace(columns, **roles), (Oddity(what, True),)


def places_of(joints: Sequence[str], columns: Sequence[str]) -> list[int] | None:
    """Where the column of each joint is, if each joint's name is in one of them alone, and no two share one."""
    found = []
    for joint in joints:
        pattern = re.compile(rf"(?<![A-Za-z0-9]){re.escape(joint)}(?![A-Za-z0-9])", re.IGNORECASE)
        places = [place for place, column in enumerate(columns) if pattern.search(column)]
        if len(places) != 1:
            return None
        found += places
    return found if len(set(found)) == len(found) else None
