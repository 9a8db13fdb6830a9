"""The record of an identified machine as a JSON file: numbers, how sure they are, how well they fit, what is left."""

from __future__ import annotations

import platform
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin import __version__
from dtwin.errors import DtwinError, ModelError
from dtwin.files import replacing
from dtwin.identification.data import fingerprint
from dtwin.identification.machine.judged import Grade, Judged
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Triple
from dtwin.twin.effects import EFFECT_NAMES, Effects

SCHEMA: Final = "dtwin machine record 1"


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


class MachineRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An identified machine.

    Attributes:
        schema: name and version of the file format, SCHEMA.
        grade: what the record is good for.
        numbers: every parameter and effect by name.
        fit: fit of every joint on motion that was held out; 1 is perfect.
        unexplained: standard deviation of what is not explained, rad.
        encoders: noise of the encoders, rad.
        converged: whether the search ended at a minimum.
        remarks: what a person should know of it, in words.
        source: description of the data.
        data: SHA-256 of the segments that were fitted.
        segments: number of these.
        versions: versions of the software that made the record.
    """

    schema: str
    grade: Grade
    numbers: dict[str, Number]
    fit: Triple
    unexplained: Triple
    encoders: Triple
    converged: bool
    remarks: list[str]
    source: str
    data: str
    segments: int
    versions: dict[str, str]

    @property
    def arm(self) -> ArmParameters:
        """The parameters of the arm."""
        return ArmParameters.from_vector(tuple(self.numbers[name].value for name in PARAMETER_NAMES))

    @property
    def effects(self) -> Effects:
        """What the arm has beside its equations of motion."""
        return Effects().with_values({name: self.numbers[name].value for name in EFFECT_NAMES})


def record_of(judged: Judged, arm: ArmParameters, source: str) -> MachineRecord:
    """The record of an identification.

    Args:
        judged: the machine and how far to trust it.
        arm: arm as it was designed.
        source: description of the data.
    """
    found = judged.found
    priors, deviations, told = found.problem.priors, found.deviations, judged.told
    values = dict(zip((*PARAMETER_NAMES, *EFFECT_NAMES), found.vector.tolist(), strict=False))
    numbers = {
        name: Number(value, deviations.get(name, 0.0), priors[name].mean, priors[name].deviation, name in told)
        for name, value in values.items()
    }
    return MachineRecord(
        SCHEMA,
        judged.grade,
        numbers,
        _triple(judged.fit),
        _triple(found.noise),
        _triple(judged.encoders),
        found.converged,
        judged.remarks(),
        source,
        fingerprint(found.problem.segments),
        len(found.problem.segments),
        {"dtwin": __version__, "numpy": np.__version__, "python": platform.python_version()},
    )


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
        record = msgspec.json.decode(path.read_bytes(), type=MachineRecord)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected the record of a machine: {error}") from None
    if record.schema != SCHEMA:
        raise ModelError(f"{path}: schema: expected {SCHEMA!r}, got {record.schema!r}")
    if missing := [name for name in (*PARAMETER_NAMES, *EFFECT_NAMES) if name not in record.numbers]:
        raise ModelError(f"{path}: numbers: {missing[0]} is missing")
    try:
        _ = record.arm, record.effects
    except DtwinError as error:
        raise ModelError(f"{path}: {error}") from None
    return record


def _triple(values: np.ndarray) -> Triple:
    first, second, third = values.tolist()
    return first, second, third
