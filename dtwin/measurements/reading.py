"""A log of any arm, from its file to a measurement, in one call."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dtwin.arm.chain import Arm
from dtwin.measurements.checks import measurement_of
from dtwin.measurements.columns import ColumnMap, checked_map, guess
from dtwin.measurements.doors import Table, read_table
from dtwin.measurements.measurement import Measurement


def table_of(path: Path) -> Table:
    """The table of a file or folder, whatever kind it is.

    Raises:
        RecordingError: it cannot be read.
    """
    bag = path.suffix.lower() in (".mcap", ".db3") or (path / "metadata.yaml").is_file()
    if not bag or not path.exists():
        return read_table(path)
    from dtwin.measurements.bags import read_bag  # an extra, which few logs need

    return read_bag(path)


def guessed(table: Table, joints: int | None) -> tuple[Table, ColumnMap]:
    """The table with what is not clear of its columns, and what they seem to mean.

    Raises:
        RecordingError: no columns look like positions.
    """
    columns, unclear = guess(table, joints)
    return replace(table, oddities=(*table.oddities, *unclear)), columns


def read_measurement(path: Path, columns: ColumnMap | None = None, arm: Arm | None = None) -> Measurement:
    """Reads a log.

    Args:
        path: CSV, Parquet, NPZ, MAT or MCAP file, or the folder of a LeRobot data set or of a rosbag2.
        columns: what its columns mean; None for a guess.
        arm: the arm, if it is known: the number of its joints and their limits are checked.

    Raises:
        RecordingError: the file cannot be read, or something is wrong with it that cannot be put right; the message
            names column and row.
    """
    table = table_of(path)
    joints = None if arm is None else len(arm)
    table, chosen = guessed(table, joints) if columns is None else (table, columns)
    return measurement_of(table, checked_map(chosen, table, joints), arm)
