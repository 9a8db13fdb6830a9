"""What every log has to keep: values that an arm can have, and one row a tick.

The messages name the column, the row, what was expected and what came.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.logs.log import NUMBERS, TRUTH
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT
from dtwin.signals import LATEST

Array = NDArray[np.float64]

FARTHEST: Final = 1e4
"""Largest angle that a joint may have come to, rad: 1,600 turns."""
_MOTOR_VOLTS: Final = tuple(f"volts_{joint}" for joint in (1, 2, 3))
_MEASURED: Final = tuple(f"measured_{joint}" for joint in (1, 2, 3))
_LIMITS: Final[dict[str, tuple[float, float, str]]] = {
    "t": (0.0, LATEST, "s"),
    **dict.fromkeys(_MEASURED, (-FARTHEST, FARTHEST, "rad")),
    **dict.fromkeys(_MOTOR_VOLTS, (-VOLTAGE_LIMIT, VOLTAGE_LIMIT, "V")),
}
"""Least and largest value of what every log has, and its unit."""
_ROUNDING: Final = 1e-9
JITTER: Final = 0.002
"""Largest distance of a step of time from a whole number of ticks, s."""
_SAME_RATE: Final = 0.005
"""Relative distance of the usual step from a tick up to which it is one."""
_UNITS: Final = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}
_UNIX: Final = 1e8
"""Time from which on stamps look like those of a clock that counts from 1970, s: 1973."""
_TURN: Final = 2.0 * np.pi
_NEARLY_A_TURN: Final = 0.5
"""Distance of a jump from a turn up to which an angle looks wrapped, rad."""


def check(source: str, columns: Mapping[str, NDArray[Any]]) -> None:
    """Checks the columns of a log.

    Args:
        source: where they come from, in words.
        columns: the columns by the names of COLUMNS, numbers as float64.

    Raises:
        RecordingError: a number is not finite or out of range, an angle jumps by a turn, or the rows are no ticks.
    """
    for name in NUMBERS:
        if name not in TRUTH:
            _check_numbers(source, name, columns[name])
    _check_time(source, columns["t"])
    for name in _MEASURED:
        _check_turns(source, name, columns[name])


def _check_numbers(source: str, name: str, values: Array) -> None:
    if name not in _LIMITS:
        # The file may not tell it, or only now and then.
        if (wrong := np.isinf(values)).any():
            row = int(np.argmax(wrong))
            raise RecordingError(f"{source}: column {name}, row {row}: expected a finite number, got {values[row]}")
        return
    low, high, unit = _LIMITS[name]
    wrong = ~((values >= low - _ROUNDING) & (values <= high + _ROUNDING))
    if name == "t" and not (wrong & ~(values > high)).any():
        return  # what is too late is told by the unit of the stamps
    if wrong.any():
        row = int(np.argmax(wrong))
        hint = _hint(name, values)
        raise RecordingError(
            f"{source}: column {name}, row {row}: expected {low:g} to {high:g} {unit}, got {values[row]:g}{hint}"
        )


def _hint(name: str, values: Array) -> str:
    """What a voltage that no motor gets may be in."""
    largest = float(np.nanmax(np.where(np.isfinite(values), np.abs(values), 0.0)))
    if name not in _MOTOR_VOLTS or largest > 1e3 * VOLTAGE_LIMIT or largest <= 2.0 * VOLTAGE_LIMIT:
        return ""
    return f": the voltages look like {'percent' if largest <= 100.0 else 'millivolts'}"


def _check_time(source: str, t: Array) -> None:
    """One row a tick, of which some may be missing."""
    if len(t) and t[0] > LATEST:
        _check_unit(source, t)
        raise RecordingError(
            f"{source}: column t, row 0: expected 0 to {LATEST:g} s, got {t[0]:.12g}: {_as_clock(t)}"
        )
    if len(t) < 2:
        return
    steps = np.diff(t)
    if not (steps > 0).all():
        row = int(np.argmin(steps > 0)) + 1
        raise RecordingError(
            f"{source}: column t, row {row}: expected increasing time, more than {t[row - 1]:.12g}, got {t[row]:.12g}"
        )
    _check_unit(source, t)
    ticks = np.round(steps / PERIOD)
    off = (np.abs(steps - ticks * PERIOD) > JITTER) | (ticks < 1)
    if off.any():
        row = int(np.argmax(off)) + 1
        expected = t[row - 1] + max(ticks[row - 1], 1.0) * PERIOD
        raise RecordingError(
            f"{source}: column t, row {row}: expected {expected:.12g} within {1e3 * JITTER:g} ms, since rows are"
            f" {1e3 * PERIOD:g} ms apart or whole multiples of it, got {t[row]:.12g}"
        )


def _check_unit(source: str, t: Array) -> None:
    """The usual step is a tick, in seconds."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else PERIOD
    if abs(usual / PERIOD - 1.0) <= _SAME_RATE:
        return
    for factor, unit in _UNITS.items():
        if abs(usual / factor / PERIOD - 1.0) <= _SAME_RATE:
            raise RecordingError(
                f"{source}: column t: the stamps look like {unit}: expected steps of {PERIOD:g} s, got {usual:g}"
            )
    if len(t) > 2:
        raise RecordingError(
            f"{source}: column t: expected a row every {PERIOD:g} s (100 Hz), got one every {usual:.6g}"
            f" ({1.0 / usual:.4g} Hz)"
        )


def _as_clock(t: Array) -> str:
    if t[0] > _UNIX:
        return "the stamps look like those of a clock that counts from 1970; count from the beginning of the log"
    return "count from the beginning of the log"


def _check_turns(source: str, name: str, angles: Array) -> None:
    """No angle jumps by a turn, as one does that is kept between -pi and pi."""
    jumps = np.abs(np.abs(np.diff(angles)) - _TURN) < _NEARLY_A_TURN
    across = np.sign(angles[1:]) != np.sign(angles[:-1])
    if (wrapped := jumps & across).any():
        row = int(np.argmax(wrapped)) + 1
        raise RecordingError(
            f"{source}: column {name}, row {row}: the angle wraps at a half turn: expected one near"
            f" {angles[row - 1]:.4g} rad, got {angles[row]:.4g}; numpy.unwrap mends it"
        )
