"""What `dtwin commission LOG --arm ARM` keeps of a healthy arm, so that a monitor knows it from the beginning."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.samples import Samples
from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing
from dtwin.monitoring.chain.drives import Drives
from dtwin.monitoring.chain.encoders import Habits
from dtwin.monitoring.chain.learning import AT_ONCE
from dtwin.monitoring.chain.sequential import FirstFault

SCHEMA = "dtwin arm commissioned 1"
Numbers = tuple[float, ...]


class Bound(msgspec.Struct, frozen=True):
    """From which likelihood ratio on a window is evidence.

    Attributes:
        window: its length in filtered samples.
        ratios: of every cause.
    """

    window: int
    ratios: Numbers


class ArmRecord(msgspec.Struct, frozen=True):
    """A healthy arm of n joints.

    Attributes:
        schema: SCHEMA.
        arm: its name.
        joints: names of the joints.
        period: time between two samples, s.
        seconds: how long it was watched, s.
        values: see `Expected`, 15 n numbers.
        covariance: of these, 15 n rows.
        noise: usual difference of command and expectation, in the units of the drives.
        bounds: of every window.
        alike: how many times larger likelihood ratios of healthy samples are than of white noise.
        habits: what its encoders show.
        carries: see `Drives`.
    """

    schema: str
    arm: str
    joints: tuple[str, ...]
    period: float
    seconds: float
    values: Numbers
    covariance: tuple[Numbers, ...]
    noise: Numbers
    bounds: tuple[Bound, ...]
    alike: float
    habits: Habits
    carries: bool = False

    def watch(self, arm: Arm) -> FirstFault:
        """Who looks for the first fault of that arm.

        Args:
            arm: the arm as its data sheet says.

        Raises:
            RecordingError: it is another arm.
        """
        names = tuple(joint.name for joint in arm.joints)
        if names != self.joints or arm.period != self.period:
            raise RecordingError(
                f"the record is of {self.arm} with the joints {', '.join(self.joints)} every {self.period:g} s, "
                f"got {arm.name} with {', '.join(names)} every {arm.period:g} s"
            )
        drives = Drives(arm)
        drives.expected.recall(*(np.array(each) for each in (self.values, self.covariance, self.noise)))
        bounds = [(bound.window, np.array(bound.ratios)) for bound in self.bounds]
        drives.recall(bounds, self.alike, self.carries)
        drives.beware(self.seconds)
        return FirstFault.knowing(arm, drives, self.habits)


def judged(record: ArmRecord, arm: Arm, samples: Samples) -> FirstFault:
    """Who knows the arm of a record, after the samples of a log.

    Raises:
        RecordingError: the record is of another arm.
    """
    watch = record.watch(arm)
    for part in samples.parts(AT_ONCE):
        watch.follow(*part)
        if watch.settled:
            break
    watch.end()
    return watch


def record_of(watch: FirstFault, arm: Arm, seconds: float) -> ArmRecord:
    """What is kept of an arm that was watched for a time, s."""
    assert watch.drives is not None
    assert watch.habits is not None
    drives, expected = watch.drives, watch.drives.expected
    return ArmRecord(
        SCHEMA,
        arm.name,
        tuple(joint.name for joint in arm.joints),
        arm.period,
        seconds,
        tuple(expected.values.tolist()),
        tuple(map(tuple, expected.covariance.tolist())),
        tuple(expected.noise.tolist()),
        tuple(Bound(window, tuple(ratios.tolist())) for window, ratios in drives.bounds),
        drives.alike,
        watch.habits,
        drives.carries,
    )


def write_arm_record(record: ArmRecord, path: Path) -> None:
    """Writes a record as JSON, whole or not at all.

    Raises:
        DtwinError: the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(msgspec.json.encode(record))


def read_arm_record(path: Path, arm: Arm) -> ArmRecord:
    """Reads a record of that arm.

    Raises:
        RecordingError: the file cannot be read, is no record, or one of another arm.
    """
    expected = f"{path}: expected a file that dtwin commission LOG --arm ARM --out FILE.json wrote"
    try:
        record = msgspec.json.decode(path.read_bytes(), type=ArmRecord)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise RecordingError(f"{expected}: {error}") from None
    joints, causes = len(record.joints), 4 * len(record.joints) + 1
    sizes = [(record.values, 15 * joints), (record.noise, joints), (record.covariance, 15 * joints)]
    sizes += [(row, 15 * joints) for row in record.covariance]
    sizes += [(bound.ratios, causes) for bound in record.bounds]
    sizes += [(getattr(record.habits, name), joints) for name in Habits.__struct_fields__]
    if record.schema != SCHEMA or any(len(row) != size for row, size in sizes):
        raise RecordingError(f"{expected}, {SCHEMA!r}, with {15 * joints} values of its {joints} joints")
    try:
        record.watch(arm)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return record
