"""Logs of any arm, and its identification from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.arm.chain import Arm
from dtwin.arm.urdf import read_urdf
from dtwin.identification.chain.identify import Identification, Sample, Settings
from dtwin.identification.chain.identify import identify as identified
from dtwin.measurements.arrays import Numbers, measurement_from
from dtwin.measurements.columns import ColumnMap, read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from dtwin.measurements.writing import write_measurement


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
    """Reads a log of any arm: CSV, Parquet, NPZ, MAT, MCAP, or the folder of a LeRobot data set or of a rosbag2.

    Args:
        path: the file or folder.
        columns: TOML file that says what its columns mean; None for a guess, which `dtwin log show` prints.
        arm: URDF file of the arm, by whose joints and limits the log is checked.

    Raises:
        RecordingError: the log cannot be read, or something is wrong that cannot be put right.
        ModelError: the arm cannot be read.
    """
    return read_measurement(Path(path), _map(columns), None if arm is None else read_urdf(Path(arm)))


@checked
def from_arrays(
    t: Numbers | float,
    q: Numbers,
    command: Numbers | None = None,
    *,
    velocity: Numbers | None = None,
    torque: Numbers | None = None,
    current: Numbers | None = None,
    names: tuple[str, ...] = (),
    units: Mapping[str, str] | None = None,
) -> Measurement:
    """Makes a log of any arm of what another program has measured, checked and repaired as `read_log` does.

    Of a single joint the arrays may be (N,). What is odd stands in `oddities` of the result.

    Args:
        t: (N,), stamps, s, which begin again with each episode; or rows a second where there are none.
        q: (N, n), positions, rad (m of joints that slide).
        command: (N, n), commanded positions; None where nobody knows them.
        velocity: (N, n), velocities, rad/s; None where they were not measured.
        torque: (N, n), torque of the joints, N m; None where it was not measured.
        current: (N, n), currents of the motors, A; None where they were not measured. A log has one of the two.
        names: names of the joints; none for 1 to n.
        units: other units by argument, such as {"t": "ms", "q": "deg", "current": "mA"}; command and velocity have
            that of q if nothing else is said.

    Raises:
        ParameterError: shapes do not agree, or a unit or a name is none; the message names the argument.
        RecordingError: something is wrong that cannot be put right; the message names column and row.
    """
    given = {"q": q, "command": command, "velocity": velocity, "torque": torque, "current": current}
    return measurement_from(t, {k: v for k, v in given.items() if v is not None}, names, units or {})


@checked
def write_log(log: Measurement, path: AnyPath) -> None:
    """Writes a log of any arm, in SI units, so that `read_log` and other programs read it without a map.

    Args:
        log: the log.
        path: file to write, *.csv, *.parquet, or *.mcap with JointState messages of ROS 2, which needs the extra
            rosbag; it appears complete or not at all.

    Raises:
        RecordingError: the path cannot be written.
    """
    write_measurement(log, Path(path))


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
