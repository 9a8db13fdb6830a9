"""A log of any arm, from its file to a measurement, in one call."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dtwin.arm.chain import Arm
from dtwin.measurements.checks import measurement_of
from dtwin.measurements.columns import ColumnMap, checked_map, in_order
from dtwin.measurements.doors import RECORDINGS, Table, read_table
from dtwin.measurements.guessing import guess
from dtwin.measurements.measurement import Measurement, Oddity


def table_of(path: Path, arm: Arm | None = None) -> Table:
    """The table of a file or folder, whatever kind it is; of several arms in a recording that of `arm`.

    Raises:
        RecordingError: it cannot be read.
    """
    bag = path.suffix.lower() in RECORDINGS or (path / "metadata.yaml").is_file()
    if not bag or not path.exists():
        return read_table(path)
    from dtwin.measurements.formats.bags import read_bag  # an extra, which few logs need

    return read_bag(path, () if arm is None else names_of(arm))


def names_of(arm: Arm) -> tuple[str, ...]:
    """The names of the joints."""
    return tuple(joint.name for joint in arm.joints)


def understood(table: Table, columns: ColumnMap | None, arm: Arm | None) -> tuple[Table, ColumnMap]:
    """What the columns mean, in the order of the arm's joints, and the table with what is not clear of it.

    Args:
        table: columns of a file.
        columns: what they mean; None for a guess.
        arm: the arm, if it is known.

    Raises:
        RecordingError: no columns look like positions, or the map names what the table has not.
    """
    joints = None if arm is None else len(arm)
    unclear: tuple[Oddity, ...] = ()
    if columns is None:
        columns, unclear = guess(table, joints, () if arm is None else names_of(arm))
    columns = checked_map(columns, table, joints)
    if arm is not None:
        columns, turned = in_order(columns, arm)
        unclear += turned
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
    table, chosen = understood(table_of(path, arm), columns, arm)
    return measurement_of(table, chosen, arm)
