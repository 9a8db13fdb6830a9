"""The log of any arm, as `dtwin run --arm` and the recorder of `dtwin up --arm` write it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dtwin.arm.chain import Arm
from dtwin.arm.effort import logged, unladen
from dtwin.arm.samples import Samples
from dtwin.errors import RecordingError, choices
from dtwin.files import reason_of
from dtwin.run.chain import EFFORTS, GRIPPED


def read_arm_log(path: Path, arm: Arm) -> Samples:
    """Reads the log of an arm, a row for each tick; without a column `gripped` its gripper was open all the time.

    Nobody knows what the arm carries where its gripper is closed.

    Raises:
        RecordingError: it cannot be read, has other columns, a gap, or a value that is no finite number.
    """
    try:
        table = pq.read_table(path)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (pa.ArrowException, ValueError) as error:
        raise RecordingError(f"{path}: expected a Parquet log: {error}") from None
    numbers = range(1, len(arm) + 1)
    efforts = [EFFORTS.get(joint.actuator.commanded, "command") for joint in arm.joints]
    groups = [
        ["t"],
        [f"q_{k}" for k in numbers],
        [f"target_{k}" for k in numbers],
        [f"{name}_{k}" for k, name in zip(numbers, efforts, strict=True)],
    ]
    names = set(table.schema.names)
    if missing := [name for group in groups for name in group if name not in names]:
        wanted = choices([name for group in groups for name in group]).replace(" or ", " and ")
        raise RecordingError(f"{path}: column {missing[0]} is missing: expected {wanted} of the arm {arm.name}")
    try:
        t, q, target, effort, gripped = (
            np.column_stack([np.asarray(table[name], dtype=np.float64) for name in group])
            if set(group) <= names
            else np.zeros((table.num_rows, 1))
            for group in (*groups, [GRIPPED])
        )
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: expected numbers: {error}") from None
    for what, values in (("t", t), ("q", q), ("target", target), ("effort", effort), (GRIPPED, gripped)):
        if not np.isfinite(values).all():
            row = int(np.argmin(np.isfinite(values).all(axis=1))) + 1
            raise RecordingError(f"{path}: row {row}: {what}: expected finite numbers")
    gaps = np.abs(np.diff(t[:, 0]) - arm.period) > 0.1 * arm.period
    if gaps.any():
        row = int(np.argmax(gaps)) + 2
        raise RecordingError(f"{path}: row {row}: t: expected {arm.period:g} s after the row before")
    effort = effort / logged(arm)
    return Samples(t[:, 0], q, target, unladen(effort, gripped[:, 0] != 0.0), effort)
