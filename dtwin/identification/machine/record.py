"""The record of an identified machine as a JSON file: numbers, how sure they are, how well they fit, what is left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from dtwin.controller.proposed import ProposedSettings
from dtwin.errors import DtwinError, ModelError
from dtwin.files import replacing
from dtwin.parameters import ONE_A_JOINT, PARAMETER_NAMES, ArmParameters, CellJoints
from dtwin.twin.effects import EFFECT_NAMES, Effects

Grade = Literal["identified", "approximate", "unusable"]

NotNegative = Annotated[float, msgspec.Meta(ge=0.0)]

SCHEMA: Final = "dtwin machine record 6"
USUAL_BOX: Final = 0.2
"""kg, mass of the boxes in the mean"""
LEARNED: Final = tuple(f"{symbol}{joint}" for symbol in ("K", "D", "mu", "bias") for joint in (1, 2, 3))
"""Names of what is learned of a machine while it is watched: parameters, and offsets of encoders, rad."""


class Number(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A number of the machine, SI units.

    Attributes:
        value: its value.
        deviation: its standard deviation; 0 if it was not identified.
        expected: value of the data sheet.
        tolerance: standard deviation of the data sheet's value.
        told: whether the data tell it; otherwise the data sheet tells nearly all that is known.
    """

    value: float
    deviation: float
    expected: float
    tolerance: float
    told: bool


class Learned(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A number of the machine as the monitor learned it, SI units.

    Attributes:
        value: its value.
        deviation: its standard deviation.
    """

    value: float
    deviation: NotNegative


class Passed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How far one of the monitor's statistics went while the machine was healthy.

    Attributes:
        level: a value that it passed now and then.
        rate: how often it did, 1/h.
        excess: by how much it passed it on average.
    """

    level: NotNegative
    rate: NotNegative
    excess: NotNegative


class Healthy(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the machine does at work, while it is healthy, that the numbers do not explain.

    Attributes:
        slow: standard deviation of torques that last, N m.
        memory: time that they last, s.
        grip: standard deviation of torques while a box is gripped or let go, N m.
        displacement: standard deviation of the angle by which the gears move a link in a sample without torque, rad.
        compliance: (3,), angle by which the gears swing after a torque of the motor has jumped, rad/(N m).
        stick: share of the dry friction that is in doubt near standstill.
        tails: how far the monitor's statistic of each fault went, by fault.
        misfit: mean square of some innovations in standard deviations that it has not passed.
        learned: what parameters and offsets of encoders came to be while it was watched.
        duration: how long the machine was watched, s.
        closing: standard deviation of torques while jaws close that hold no box yet, N m; None in records of before
            they were watched, where it is that of `grip`.
        rates: rates at which parameters changed from the first third of that time to the second, and from there to
            the last, as shares, 1/s, of those that certainly did.
    """

    slow: Annotated[tuple[NotNegative, ...], ONE_A_JOINT]
    memory: Annotated[float, msgspec.Meta(gt=0.0)]
    grip: NotNegative
    displacement: NotNegative
    compliance: Annotated[tuple[NotNegative, ...], ONE_A_JOINT]
    stick: NotNegative
    tails: dict[str, Passed]
    misfit: NotNegative
    learned: dict[str, Learned]
    duration: NotNegative
    closing: NotNegative | None = None
    rates: dict[str, tuple[float, float]] = {}


class EncoderCheck(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What its readings tell of an encoder.

    Attributes:
        step: its resolution, rad; None if the readings have no steps.
        rest: standard deviation of the readings about a line where the arm rests, rad; None if it never rests. An
            encoder whose noise is small beside its step stands still there.
        noise: standard deviation of the readings about a smooth motion, rad, rounding to steps included.
        spikes: number of single readings that are far off, 1/h.
        least_spike: smallest spike that could have been told from noise and motion, rad.
        repeats: how often in a row it gave one reading again at most; None in records from before this was counted.
    """

    step: Annotated[float, msgspec.Meta(gt=0.0)] | None
    rest: NotNegative | None
    noise: NotNegative
    spikes: NotNegative
    least_spike: NotNegative
    repeats: Annotated[int, msgspec.Meta(ge=0)] | None = None


class SensorCheck(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the log tells of the sensors.

    Attributes:
        encoders: those of the three joints.
        lost: number of samples in which all encoders read the same again although the arm moved, 1/h; None if it
            never moved fast enough to tell.
        told: time in which a lost sample would have been noticed, s.
        missing: number of ticks that the log lacks, 1/h.
        duration: length of the log, s.
    """

    encoders: Annotated[tuple[EncoderCheck, ...], ONE_A_JOINT]
    lost: NotNegative | None
    told: NotNegative
    missing: NotNegative
    duration: NotNegative


class MachineRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An identified machine.

    Attributes:
        schema: name and version of the file format, SCHEMA.
        grade: what the record is good for.
        numbers: every parameter and effect by name.
        fit: fit of every joint on motion that was held out; 1 is perfect.
        unexplained: standard deviation of what is not explained, rad.
        encoders: noise of the encoders, rad.
        sensors: what the readings tell of the encoders themselves.
        converged: whether the search ended at a minimum.
        remarks: what a person should know of it, in words.
        source: description of the data.
        data: SHA-256 of the segments that were fitted.
        segments: number of these.
        versions: versions of the software that made the record.
        settings: settings of the controller for this machine; None if nobody has designed them.
        healthy: what it does beside at work; None if nobody has watched it.
        load: mass with which a box moves on a machine of these numbers, as a share of the mass that it has; None if
            nobody has watched it carry boxes. Motion without a box tells ratios of torques, not their scale.
    """

    schema: str
    grade: Grade
    numbers: dict[str, Number]
    fit: CellJoints
    unexplained: CellJoints
    encoders: CellJoints
    sensors: SensorCheck
    converged: bool
    remarks: list[str]
    source: str
    data: str
    segments: int
    versions: dict[str, str]
    settings: ProposedSettings | None = None
    healthy: Healthy | None = None
    load: Annotated[float, msgspec.Meta(gt=0.0)] | None = None

    @property
    def arm(self) -> ArmParameters:
        """The parameters of the arm."""
        return ArmParameters.from_vector(tuple(self.numbers[name].value for name in PARAMETER_NAMES))

    @property
    def effects(self) -> Effects:
        """What the arm has beside its equations of motion."""
        return Effects().with_values({name: self.numbers[name].value for name in EFFECT_NAMES})


class _Schema(msgspec.Struct):
    """What every version of a record has."""

    schema: str


def write_record(record: MachineRecord, path: Path) -> None:
    """Writes a record; the file appears complete or not at all, and equal records give equal bytes.

    Raises:
        RecordingError: the path cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(msgspec.json.format(msgspec.json.encode(record), indent=2) + b"\n")


def read_record(path: Path) -> MachineRecord:
    """Reads and validates a record.

    Raises:
        ModelError: the file is missing or no record, or a value in it is impossible; the message names the value.
    """
    try:
        data = path.read_bytes()
        schema = msgspec.json.decode(data, type=_Schema).schema
        if schema != SCHEMA:
            raise ModelError(f"{path}: schema: expected {SCHEMA!r}, got {schema!r}; commission the machine anew")
        record = msgspec.json.decode(data, type=MachineRecord)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected the record of a machine: {error}") from None
    if missing := [name for name in (*PARAMETER_NAMES, *EFFECT_NAMES) if name not in record.numbers]:
        raise ModelError(f"{path}: numbers: {missing[0]} is missing")
    if record.healthy and (absent := [name for name in LEARNED if name not in record.healthy.learned]):
        raise ModelError(f"{path}: healthy.learned: {absent[0]} is missing")
    try:
        _ = record.arm, record.effects
    except DtwinError as error:
        raise ModelError(f"{path}: {error}") from None
    return record
