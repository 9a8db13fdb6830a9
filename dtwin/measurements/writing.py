"""A measurement as a file that other programs read: CSV, Parquet, or MCAP with messages of ROS 2.

What is written is in SI units and names its units, so that `read_measurement` takes no guess and needs no map.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dtwin.errors import RecordingError
from dtwin.files import replacing
from dtwin.measurements.measurement import Array, Measurement
from dtwin.measurements.naming import EPISODE, GRIPPED, TIME, UNITS, checked_joints, column_name

POSITIONS: Final = {"rad": 1.0, "m": 1.0, "percent": 100.0}
"""Units in which positions may be written, with the number of them in what a measurement holds."""


def write_measurement(measurement: Measurement, path: Path, unit: str = "rad") -> None:
    """Writes a measurement; the file is there whole, or not at all.

    Args:
        measurement: what was measured.
        path: file that ends in .csv, .parquet or .mcap.
        unit: what positions, velocities and commands are: rad, m, or percent of a range.

    Raises:
        RecordingError: the name ends otherwise, the file cannot be written, joints have names that a file cannot
            keep, or .mcap is asked for and rosbags is not installed or has no word for what was measured.
    """
    checked_joints(measurement.source, measurement.joints)
    with replacing(path, *_WRITERS) as temporary:
        _WRITERS[path.suffix.lower()](measurement, temporary, unit)


def columns_of(measurement: Measurement, unit: str) -> dict[str, Array]:
    """All columns by their names, (N,) each."""
    factor = POSITIONS[unit]
    kind, effort_unit = UNITS[measurement.kind]
    quantities: Mapping[str, tuple[Array | None, str]] = {
        "position": (measurement.q * factor, unit),
        "velocity": (None if measurement.v is None else measurement.v * factor, unit),
        kind: (measurement.effort, effort_unit),
        "command": (None if measurement.command is None else measurement.command * factor, unit),
        "temperature": (measurement.temperature, "C"),
        "motor": (None if measurement.motor is None else measurement.motor * factor, unit),
    }
    found = {TIME: measurement.t}
    for name, (values, written) in quantities.items():
        if values is not None:
            pairs = zip(measurement.joints, values.T, strict=True)
            found |= {column_name(name, joint, written): column for joint, column in pairs}
    if measurement.episodes is not None:
        found[EPISODE] = measurement.episodes.astype(np.float64)
    if measurement.gripped is not None:
        found[GRIPPED] = measurement.gripped.astype(np.float64)
    return found


def _csv(measurement: Measurement, path: Path, unit: str) -> None:
    columns = columns_of(measurement, unit)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(np.stack(list(columns.values()), axis=1).tolist())


def _parquet(measurement: Measurement, path: Path, unit: str) -> None:
    pq.write_table(pa.table(columns_of(measurement, unit)), path)


def _mcap(measurement: Measurement, path: Path, unit: str) -> None:
    if unit == "percent":
        raise RecordingError(f"{measurement.source}: positions are percent: a JointState has them in rad or m")
    from dtwin.measurements.formats.bag_writing import write_bag  # an extra, which few logs need

    write_bag(measurement, path)


_WRITERS: Final[dict[str, Callable[[Measurement, Path, str], None]]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".mcap": _mcap,
}
ENDINGS: Final = tuple(_WRITERS)
"""Endings of the files that are written."""
