"""The health of position-controlled arms, from commands and positions alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.health import servo
from dtwin.health.servo import JointHealth
from dtwin.measurements.columns import read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.page import oddities
from dtwin.measurements.reading import read_measurement


@dataclass(frozen=True, slots=True)
class ServoHealth:
    """What a log tells of the health of an arm's servos.

    Attributes:
        log: the log.
        joints: delay (s), gain, error at rest, difference of both directions and drift (rad) of every joint, with
            95 % intervals; None for what the log does not tell.
        findings: what is wrong or cannot be told, in words.
        odd: what was odd in the log, in words.
    """

    log: Measurement
    joints: tuple[JointHealth, ...]
    findings: tuple[str, ...]
    odd: tuple[str, ...]


@checked
def servo_health(log: Measurement | AnyPath, *, columns: AnyPath | None = None) -> ServoHealth:
    """Tells the health of a position-controlled arm, such as a LeRobot arm, as `dtwin health` does.

    Args:
        log: what `read_log` returned, the folder of a LeRobot data set, or a file as `read_log` takes it.
        columns: TOML file that says what the columns of a file mean; None for a guess.

    Raises:
        RecordingError: the log cannot be read, or something is wrong that cannot be put right.
    """
    if not isinstance(log, Measurement):
        log = read_measurement(Path(log), None if columns is None else read_map(Path(columns)))
    joints = servo.servo_health(log)
    return ServoHealth(log, tuple(joints), tuple(servo.findings(log, joints)), tuple(oddities(log)))
