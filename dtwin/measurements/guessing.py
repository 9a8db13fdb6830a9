"""What the columns of a table seem to mean: a guess by their names, or, without a header, by their numbers.

It is shown, and a person corrects it as a map.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from dtwin.errors import RecordingError, choices
from dtwin.measurements import naming
from dtwin.measurements.columns import ANGLES, EFFORTS, TIME, ColumnMap, Role, places_of
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Oddity

_TURN: Final = 2.0 * np.pi
_NAMES: Final = {
    "motor": r"((motor|rotor)_?(pos|angle)|(pos|angle|theta)_?(motor|rotor)|^q_?m(otor)?_?\d|^theta_?m_?\d)",
    "command": r"(^action\b|cmd|command|target|desired|goal|setpoint|_des\b|des_|_ref\b)",
    "velocity": r"(^qd\b|^q?d_?q|^qd\d|_qd(_|\d|\[|\b)|^dq|^v\d|vel|qdot|omega|speed)",
    "effort": r"(tau|torq|effort|^eff_?\d|curr(?!ent_?(joint_?)?(pos|ang|state|q))|^i_?\d|amp|volt|load)",
    "temperature": r"(temp)",
    "position": (
        r"(^q\b|^q_?\d|^q\.|^(actual|meas\w*|present)_q|pos|angle|theta|joint|observation\.state|state|measured)"
    ),
}
_TIME_NAMES: Final = (
    r"_*(t|time|timestamp|stamp|sec|seconds|elapsed|zeit|datetime)([_ ]?(in )?(s|ms|us|ns))?",
    r".*[._/ ](time|timestamp|stamp)(_(s|ms|us|ns))?",
)
"""Names of stamps, the surest first."""
_TIMES: Final = {"sec": "s", "seconds": "s", "msec": "ms", "usec": "us", "µs": "us", "nsec": "ns"} | {
    u: u for u in TIME
}
_EPOCHS: Final = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""Sizes that only stamps since 1970 in such a unit have."""
_UNITS: Final = (
    dict.fromkeys(("rad", "radian", "radians"), "rad")
    | dict.fromkeys(("deg", "degree", "degrees", "°"), "deg")
    | dict.fromkeys(("turn", "turns", "rev", "revs"), "turn")
    | dict.fromkeys(("nm", "n m", "n.m", "n*m", "n·m"), "N m")
    | dict.fromkeys(("mnm", "mn m", "mn.m"), "mN m")
    | dict.fromkeys(("a", "amp", "amps", "ampere"), "A")
    | {"m": "m", "mm": "mm", "%": "percent", "n": "N", "ma": "mA", "v": "V", "c": "C", "°c": "C", "degc": "C"}
)
"""Units as people write them."""
_BRACKETS: Final = re.compile(r"\s*[\[(]\s*([^\[\]()\d][^\[\]()]*?)\s*[\])]\s*$")
_SUFFIX: Final = re.compile(
    r"[_ .](rad|deg|degrees|mm|mnm|nm|ma|amps?|turns|ticks|counts)(?:[_ .]?\d+|\[\d+\])?$", re.IGNORECASE
)
_COUNTED: Final = re.compile(r"(tick|count|pulse|inc)s?")
_WORDS: Final = (
    r"((actual|measured)[_ ])?"
    r"(positions?|pos|angles?|velocity|velocities|vel|speed|efforts?|torques?|tau|currents?|temperatures?|temp|"
    r"commands?|cmd|targets?|q|dq|qd)"
)
"""What quantities are called beside the name of a joint."""
_MEASURED: Final = r"(meas|actual|present)"
"""Words that tell what was measured from what was computed."""
_NO_ANGLE: Final = rf"({_NAMES['velocity'][1:-1]}|^qd|{_NAMES['effort'][1:-1]})"
"""Names of commands that are no positions."""
_EPISODES: Final = r"^(episode|episode_index|episode_id|run|trial)$"
_FEW_DEGREES: Final = 4.0
"""Largest angle of a whole arm that is more likely said in radians, or in parts of a range, than in degrees."""
_APART: Final = 10
"""Rows over which a slope is taken, so that steps of the encoder and jitter of the stamps do not hide it."""
_CELL: Final = ("measured_1", "measured_2", "measured_3", "volts_1", "volts_2", "volts_3", "t")
"""Columns of a log of the cell: what was measured, not what was true."""
_TARGETS: Final = ("target_1", "target_2", "target_3")
_LEFT_OUT: Final = (
    r"(frame|index|ee_|est|err|mask|valid|raw|feedback|feedforward|friction|rigid|qdd|accel|quat|payload)"
)


def guess_map(table: Table, joints: int | None = None, names: Sequence[str] = ()) -> ColumnMap:
    """What the columns seem to mean, by their names, or by their numbers where the file has no header.

    Units of effort are never guessed by the size of numbers: only a name that says them counts.

    Raises:
        RecordingError: no columns look like positions.
    """
    return guess(table, joints, names)[0]


def guess(table: Table, joints: int | None = None, names: Sequence[str] = ()) -> tuple[ColumnMap, tuple[Oddity, ...]]:
    """What the columns seem to mean, and what of it is not clear.

    Args:
        table: columns of a file.
        joints: number of joints, if it is known.
        names: names of the joints, if they are known: of more columns of a kind those that have them are taken.

    Raises:
        RecordingError: no columns look like positions.
    """
    if not table.named:
        return _by_numbers(table, joints), ()
    if naming.is_ours(table.columns):
        return _by_our_names(table, names), ()
    if set(_CELL) <= set(table.columns):
        cell = ColumnMap(Role(_CELL[:3], "rad"), "t", effort=Role(_CELL[3:6], "V"), command=_targets(table))
        return cell, ()
    named = list(table.columns)
    time = _time(named) or next(iter(table.stamps), "")
    episode = next((n for n in named if re.search(_EPISODES, n, re.IGNORECASE)), "")
    found: dict[str, list[str]] = {}
    for name in named:
        if name in (time, episode, naming.GRIPPED) or re.search(_LEFT_OUT, name, re.IGNORECASE):
            continue
        role = next((r for r, pattern in _NAMES.items() if re.search(pattern, name, re.IGNORECASE)), None)
        if role:
            found.setdefault(role, []).append(name)
    if "position" not in found and "motor" in found:  # the only encoders that there are
        found["position"] = found.pop("motor")
    if not found.get("position"):
        raise RecordingError(
            f"{table.source}: no columns look like positions: give --columns MAP; the file has {', '.join(named)}"
        )
    count = len(names) or joints or _largest(table.source, found["position"])
    roles: dict[str, Any] = {}
    unclear: list[Oddity] = []
    for role, columns in found.items():
        groups = _groups(columns, count, names)
        if role == "position" and not groups:
            raise RecordingError(
                f"{table.source}: expected {count} columns of positions, one for each joint: give --columns MAP; "
                f"those that look so are {'; '.join([', '.join(columns), *(odd.what for odd in table.oddities)])}"
            )
        chosen, why = _chosen(role, groups)
        unclear += why
        if chosen:
            unit, why = _unit(role, chosen, table)
            roles[role] = Role(tuple(chosen), unit)
            unclear += why
    gripped = naming.GRIPPED if naming.GRIPPED in table.columns else ""
    unit = _time_unit(table, time)
    return ColumnMap(time=time, time_unit=unit, episode=episode, gripped=gripped, **roles), tuple(unclear)


def _time(names: Sequence[str]) -> str:
    """The column of the stamps; "" where none is called so."""
    for pattern in _TIME_NAMES:
        for name in names:
            if re.fullmatch(pattern, _BRACKETS.sub("", name), re.IGNORECASE):
                return name
    return ""


def _time_unit(table: Table, time: str) -> str:
    """The unit of the stamps, by what the file says or by their size if they count from 1970; else seconds.

    Raises:
        RecordingError: it says a unit that stamps have not.
    """
    brackets = _BRACKETS.search(time)
    if said := table.units.get(time) or (brackets and brackets.group(1)):
        if said.lower() not in _TIMES:
            raise RecordingError(f"{table.source}: column {time}: expected stamps in {choices(TIME)}, got {said!r}")
        return _TIMES[said.lower()]
    if found := re.search(r"(?:_|^t|^time)(ms|us|ns)$", time, re.IGNORECASE):
        return found.group(1).lower()
    size = float(np.nanmedian(np.abs(table.columns[time]))) if time else 0.0
    return next((unit for least, unit in _EPOCHS if size > least), "s")


def _chosen(role: str, stems: dict[str, list[str]]) -> tuple[list[str], list[Oddity]]:
    """The columns of a quantity among groups that have one for each joint, and what is not clear.

    Which of several sensors of temperature tells that of the friction or of the magnets, no name says; so none is
    taken.
    """
    if role == "command":
        stems = {stem: found for stem, found in stems.items() if not re.search(_NO_ANGLE, stem, re.IGNORECASE)}
    measured = {stem: found for stem, found in stems.items() if re.search(_MEASURED, stem, re.IGNORECASE)}
    left = measured if len(measured) == 1 else stems
    if len(left) < 2 or role == "command":
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


def _by_our_names(table: Table, names: Sequence[str] = ()) -> ColumnMap:
    """What the columns of a file that we wrote are: they say it. Quantities that not every joint has are left out."""
    found: dict[str, dict[str, str]] = {}
    units: dict[str, str] = {}
    for name in table.columns:
        if (said := naming.parsed_name(name)) is not None:
            role = "effort" if said.quantity in naming.KINDS else said.quantity
            found.setdefault(role, {})[said.joint] = name
            units[role] = "" if said.unit == "?" else said.unit
    joints: Sequence[str] = list(found.get("position", {}))
    if names and set(names) <= set(joints):  # others, such as those of a gripper, are left out
        joints = names
    if not joints:
        raise RecordingError(f"{table.source}: no columns of positions: the file has {', '.join(table.columns)}")
    roles: dict[str, Any] = {
        role: Role(tuple(columns[joint] for joint in joints), units[role])
        for role, columns in found.items()
        if set(joints) <= set(columns)
    }
    episode, gripped = (name if name in table.columns else "" for name in (naming.EPISODE, naming.GRIPPED))
    return ColumnMap(time=naming.TIME, episode=episode, gripped=gripped, **roles)


def _stem(name: str) -> str:
    """What the columns of one quantity have in common: q of q1 and q.0, position of position.elbow."""
    for known in ("action", "observation.state"):
        if name.startswith(f"{known}."):
            return known
    return name.rpartition(".")[0] or re.sub(r"\d+$", "", name).rstrip("_")


def _by_part(name: str) -> str:
    """The quantity where it is one of the parts of a name: of /joint_states/elbow/position or elbow.pos."""
    parts = re.split(r"[./]", _bare(name))
    said = [part for part in parts if re.fullmatch(_WORDS, part, re.IGNORECASE)]
    return said[-1] if said and len(parts) > 1 else name


def _by_number(name: str) -> str:
    """A name without its last number: of q[0], Joint 1 Position (deg), panda_joint1_position."""
    return re.sub(r"\d+(?=\D*$)", "", _bare(name))


def _by_end(name: str) -> str:
    """The quantity where a name ends with it: of elbow_joint_position."""
    found = re.search(rf"[_ -]({_WORDS})$", _bare(name), re.IGNORECASE)
    return found.group(1) if found else name


def _by_begin(name: str) -> str:
    """The quantity where a name begins with it: of position_elbow_joint."""
    found = re.match(rf"({_WORDS})[_ -]", _bare(name), re.IGNORECASE)
    return found.group(1) if found else name


_STEMS: Final[tuple[Callable[[str], str], ...]] = (_stem, _by_part, _by_number, _by_end, _by_begin)
"""Ways to tell the columns of one quantity from another, the first that finds one for each joint."""


def _bare(name: str) -> str:
    """A name without its unit."""
    return _SUFFIX.sub(lambda found: found.group(0)[len(found.group(1)) + 1 :], _BRACKETS.sub("", name)).strip()


def _stemmed(columns: Sequence[str], stem: Callable[[str], str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name in columns:
        found.setdefault(stem(name), []).append(name)
    return found


def _groups(columns: Sequence[str], count: int, joints: Sequence[str]) -> dict[str, list[str]]:
    """Columns of one quantity each, one for each joint, by what they have in common; none where no way finds them."""
    for stem in _STEMS:
        found: dict[str, list[str]] = {}
        for common, mine in _stemmed(columns, stem).items():
            places = places_of(joints, mine) if joints else None
            if places is not None:
                found[common] = [mine[place] for place in sorted(places)]
            elif len(mine) == count:
                found[common] = mine
        if found:
            return found
    return {}


def _largest(source: str, columns: Sequence[str]) -> int:
    """How many joints the columns of positions seem to have.

    Raises:
        RecordingError: there are several columns, and no two belong together.
    """
    sizes = [max(map(len, _stemmed(columns, stem).values())) for stem in _STEMS]
    if max(sizes) == 1 < len(columns):
        raise RecordingError(
            f"{source}: columns of positions that do not belong together: give --columns MAP; they are "
            f"{', '.join(columns)}"
        )
    return sizes[0] if sizes[0] > 1 else max(sizes)


def _unit(role: str, names: list[str], table: Table) -> tuple[str, list[Oddity]]:
    """The unit of a quantity, and what is not clear of it.

    Raises:
        RecordingError: its columns say several units, or ticks without a number a turn.
    """
    if role == "temperature":
        return "C", []
    said = {name: _said_unit(name, table.units) for name in names}
    several = sorted({unit for unit in said.values() if unit})
    if len(several) > 1:
        name = next(name for name in names if said[name] == several[1])
        raise RecordingError(
            f"{table.source}: column {name}: expected one unit for all columns of {role}, got {choices(several)}"
        )
    unit = several[0] if several else ""
    if role == "effort":
        return (unit if unit in EFFORTS else "" if unit else _effort_unit(names)), []
    if _COUNTED.fullmatch(unit.lower()):
        raise RecordingError(
            f"{table.source}: column {names[0]}: ticks: expected how many a turn: give --columns MAP with "
            'unit = "tick" and ticks = N'
        )
    return _angle_unit(role, names, table, unit)


def _angle_unit(role: str, names: list[str], table: Table, unit: str) -> tuple[str, list[Oddity]]:
    words = " ".join(names).lower()
    largest = max(_size(table.columns[name]) for name in names)
    far = largest > 2.0 * _TURN and role in ("position", "command")
    if unit in ANGLES:
        doubt = f"{role} is said to be in rad and reaches {largest:.4g}: are these degrees?"
        return unit, [Oddity(doubt, False, names[0])] if unit == "rad" and far else []
    if "deg" in words:
        return "deg", []
    if all(re.fullmatch(r"(action|observation\.state)\..*\.pos", name) for name in names):
        # LeRobot: degrees or percent of the calibrated range, which the file does not say
        doubt = f"{role} reaches {largest:.3g} and is taken for degrees: a map of columns can say radians"
        return "deg", [Oddity(doubt, False, names[0])] if largest < _FEW_DEGREES else []
    return "deg" if far else "rad", []


def _size(values: np.ndarray) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(np.percentile(known, 99.0)) if len(known) else 0.0


def _effort_unit(names: Sequence[str]) -> str:
    """The unit of an effort by what it is called."""
    words = " ".join(names).lower()
    if re.search(r"tau|torq|_nm\b", words):
        return "N m"
    return "A" if re.search(r"curr|amp|^i", words) else "V" if "volt" in words else ""


def _said_unit(name: str, units: Mapping[str, str]) -> str:
    """The unit that a name or a row of units says, in our words where they have it, without "a second"."""
    found = _BRACKETS.search(name) or _SUFFIX.search(name)
    said = units.get(name) or (found.group(1) if found else "")
    plain = re.sub(r"\s*(/\s*s(ec)?|s\^?-1)$", "", said.strip().lower())
    return _UNITS.get(plain, plain)


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
