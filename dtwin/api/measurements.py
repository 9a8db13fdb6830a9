"""Logs of any arm, and its identification from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.arm.chain import Arm
from dtwin.arm.urdf import read_urdf
from dtwin.identification.chain.identify import Identification, Sample, Settings
from dtwin.identification.chain.identify import identify as identified
from dtwin.measurements.columns import ColumnMap, read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement


@checked
def read_arm(path: AnyPath, *, base: str | None = None, tip: str | None = None) -> Arm:
    """Reads the serial chain of a robot's description.

    Args:
        path: URDF file.
        base: link that stands still; None for the root.
        tip: last link of the chain; None for the end of the longest one.

    Raises:
        ModelError: the file is no URDF, or its chain is not clear.
    """
    return read_urdf(Path(path), base, tip)


@checked
def read_log(path: AnyPath, *, columns: AnyPath | None = None, arm: AnyPath | None = None) -> Measurement:
    """Reads a log of any arm: CSV, Parquet, NPZ, MAT, or the folder of a LeRobot data set.

    Args:
        path: the file or folder.
        columns: TOML file that says what its columns mean; None for a guess, which `dtwin log show` prints.
        arm: URDF file of the arm, by whose joints and limits the log is checked.

    Raises:
        RecordingError: the log cannot be read, or something is wrong that cannot be put right.
        ModelError: the arm cannot be read.
    """
    return read_measurement(Path(path), _map(columns), None if arm is None else read_urdf(Path(arm)))


def _map(path: AnyPath | None) -> ColumnMap | None:
    return None if path is None else read_map(Path(path))


@checked
def identify_chain(
    arm: Arm, logs: Sequence[Measurement], *, loads: Sequence[str] = (), masses: Mapping[str, float] | None = None
) -> Identification:
    """Identifies any serial arm from measurements of its motion.

    Args:
        arm: the arm as it is known.
        logs: measurements with torque, current or voltage.
        loads: name of what was held in each of them, "" for an empty hand; none where all hands were empty.
        masses: mass of each load that was weighed, kg, by its name; others are found.

    Raises:
        IdentificationError: the measurements do not tell enough.
    """
    names = list(loads) or [""] * len(logs)
    samples = [Sample(log, load) for log, load in zip(logs, names, strict=True)]
    return identified(arm, samples, Settings(masses or {}))
