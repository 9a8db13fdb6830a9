"""Logs of drawn arms held against the arm as it was identified: pushes, and what has changed since."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError
from dtwin.identification.chain.identify import Sample, Settings, identify
from dtwin.identification.chain.record import Record, read_record, record_of
from dtwin.identification.chain.result import write_toml
from dtwin.measurements.measurement import Measurement
from dtwin.monitoring.chain.watching import watch
from tests.support.chains import drawn_arm, measured

JOINTS = 3
GAIN = np.array([8.0, 12.0, 5.0])


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), JOINTS, 11)


@pytest.fixture(scope="module")
def record(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Record:
    """The record of an arm that was identified with an empty hand, written and read again."""
    found = identify(arm, [Sample(measured(arm, 25.0, 1, noise=0.02))], Settings(groups=()))
    path = tmp_path_factory.mktemp("record") / "found.toml"
    write_toml(found, path)
    assert read_record(path) == record_of(found)
    return read_record(path)


def changed(log: Measurement, torque: np.ndarray) -> Measurement:
    assert log.effort is not None
    return replace(log, effort=log.effort + torque)


def test_a_quiet_log_has_no_push_and_no_change(arm: Arm, record: Record) -> None:
    found = watch(record, arm, measured(arm, 25.0, 5, noise=0.02))
    assert found.pushes == ()
    assert [change.name for change in found.changes if change.told] == []
    assert {change.name for change in found.changes} == {
        "load", *(f"joint_{k} {what}" for k in (1, 2, 3) for what in ("constant", "friction"))
    }  # fmt: skip


def test_every_push_is_told_with_its_time_and_joint(arm: Arm, record: Record) -> None:
    log = measured(arm, 25.0, 5, noise=0.02)
    torque = np.zeros_like(log.q)
    size = 0.4 * record.torque[1]
    for begins in (6.0, 15.0):
        torque[(log.t > begins) & (log.t < begins + 0.8), 1] = size
    found = watch(record, arm, changed(log, torque))
    assert [round(push.start) for push in found.pushes] == [6, 15]
    assert all(push.joints[0] == "joint_2" and abs(push.size / size - 1.0) < 0.3 for push in found.pushes)


def test_stiffer_friction_in_a_short_log_is_no_push(arm: Arm, record: Record) -> None:
    """Eight seconds are too short to tell a change; a push in them is told beside it."""
    log = measured(arm, 8.0, 5, noise=0.02)
    assert log.v is not None
    stiff = 0.2 * record.torque[1] * np.tanh(log.v / 0.02) * np.array([0.0, 1.0, 0.0])
    quiet = watch(record, arm, changed(log, stiff))
    assert quiet.pushes == ()
    assert quiet.changes == ()
    pushed = stiff.copy()
    pushed[(log.t > 4.0) & (log.t < 4.8), 1] += 0.5 * record.torque[1]
    assert [round(push.start) for push in watch(record, arm, changed(log, pushed)).pushes] == [4]


def test_a_load_a_weaker_drive_and_more_friction_are_told_apart(arm: Arm, record: Record) -> None:
    loaded = watch(record, arm, measured(arm, 25.0, 5, noise=0.02, load=1.5))
    (load,) = [change for change in loaded.changes if change.told]
    assert load.name == "load"
    assert abs(load.value - 1.5) < load.half + 0.05
    log = measured(arm, 25.0, 5, noise=0.02)
    assert log.effort is not None
    weaker = watch(record, arm, replace(log, effort=log.effort * np.array([1.0, 1.25, 1.0])))
    constant = next(change for change in weaker.changes if change.name == "joint_2 constant")
    assert constant.told
    assert abs(constant.value + 0.2) < constant.half + 0.05
    assert log.v is not None
    stiffer = watch(record, arm, changed(log, 4.0 * np.tanh(log.v / 0.02) * np.array([0.0, 0.0, 1.0])))
    assert [change.name for change in stiffer.changes if change.told] == ["joint_3 friction"]


def test_a_log_of_another_arm_or_another_quantity_is_refused(arm: Arm, record: Record, tmp_path: Path) -> None:
    log = measured(arm, 10.0, 5)
    with pytest.raises(RecordingError, match="expected 3 joints"):
        watch(record, arm, replace(log, q=log.q[:, :2]))
    with pytest.raises(RecordingError, match="expected the torque of every drive, got current"):
        watch(record, arm, replace(log, kind="current"))
    with pytest.raises(RecordingError, match="cannot be read"):
        read_record(tmp_path / "none.toml")
    (tmp_path / "other.toml").write_text("a = 1\n")
    with pytest.raises(RecordingError, match="expected a file that dtwin identify"):
        read_record(tmp_path / "other.toml")
