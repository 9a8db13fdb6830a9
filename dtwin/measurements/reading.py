"""A log of any arm, from its file to a measurement, in one call."""

from __future__ import annotations

from pathlib import Path

from dtwin.arm.chain import Arm
from dtwin.measurements.checks import measurement_of
from dtwin.measurements.columns import ColumnMap, checked_map, guess_map
from dtwin.measurements.doors import read_table
from dtwin.measurements.measurement import Measurement


def read_measurement(path: Path, columns: ColumnMap | None = None, arm: Arm | None = None) -> Measurement:
    """Reads a log.

    Args:
        path: CSV, Parquet, NPZ or MAT file, or the folder of a LeRobot data set.
        columns: what its columns mean; None for a guess.
        arm: the arm, if it is known: the number of its joints and their limits are checked.

    Raises:
        RecordingError: the file cannot be read, or something is wrong with it that cannot be put right; the message
            names column and row.
    """
    table = read_table(path)
    joints = None if arm is None else len(arm)
    chosen = guess_map(table, joints) if columns is None else columns
    return measurement_of(table, checked_map(chosen, table, joints), arm)
