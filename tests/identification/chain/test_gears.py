"""What gears yield and their play, of drawn arms with encoders on both sides whose gears are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Joint, Link
from dtwin.equations.rigid import regressor
from dtwin.errors import RecordingError
from dtwin.identification.chain.gears import gears, said_of
from dtwin.identification.chain.identify import Sample, Settings, identify
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from dtwin.measurements.writing import write_measurement
from tests.support.chains import csv_of, drawn_arm, measured, motion_of

YIELDS = np.array([2e-4, 5e-5, 0.0])
"""Compliance of each gear, rad/(N m)."""
PLAY = np.array([0.0, 4e-3, 2e-3])
"""Play of each gear, rad."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 11)


def ahead(arm: Arm, log: Measurement, seconds: float, seed: int) -> np.ndarray:
    """Positions of the motors: what the gears yield, their play on the flank of the torque, an offset, and noise."""
    _, q, v, a = motion_of(len(arm), seconds, 100.0, seed)
    torque = regressor(arm, q, v, a) @ arm.parameters
    noise = 1e-5 * np.random.default_rng(3).normal(size=q.shape)
    return q + 0.01 + YIELDS * torque + 0.5 * PLAY * np.sign(torque) + noise


@pytest.fixture(scope="module")
def log(arm: Arm) -> Measurement:
    plain = measured(arm, 25.0, 1, noise=0.01)
    return replace(plain, motor=ahead(arm, plain, 25.0, 1))


def test_what_gears_yield_and_their_play_are_found_with_intervals(arm: Arm, log: Measurement) -> None:
    found = gears(identify(arm, [Sample(log)], Settings(groups=())), [Sample(log)])
    assert found.measured
    for gear, soft, play in zip(found.each, YIELDS, PLAY, strict=True):
        assert abs(gear.compliance.value - soft) < 1.5 * gear.compliance.half + 0.02 * soft
        if gear.sides:
            assert abs(gear.play.value - play) < 1.5 * gear.play.half + 0.03 * play
    assert [gear.compliance.told for gear in found.each[:2]] == [True, True]
    assert any(gear.play.told for gear in found.each)
    words = " ".join(said_of(found))
    assert "joint_1 compliance 2.0" in words
    assert "servo" not in words


def test_a_gear_whose_torque_keeps_its_side_tells_no_play() -> None:
    """A beam that a joint holds up all the time: its teeth lie on one flank."""
    hinge = Joint("hinge", "revolute", np.array([0.0, 1.0, 0.0]), np.eye(3), np.zeros(3), effort=100.0, speed=3.0)
    beam = Arm("beam", (hinge,), (Link("beam", 3.0, np.array([0.3, 0.0, 0.0]), np.diag([0.01, 0.05, 0.05])),))
    t, q, v, a = motion_of(1, 25.0, 100.0, 4)
    q, v, a = 0.3 * q, 0.3 * v, 0.3 * a
    torque = regressor(beam, q, v, a) @ beam.parameters
    assert (np.sign(torque) == np.sign(torque[0])).all()
    generator = np.random.default_rng(1)
    effort = torque + 0.2 * np.tanh(v / 0.02) + 0.15 * v + 0.01 * generator.normal(size=q.shape)
    motor = q + 1e-3 * torque + 1e-5 * generator.normal(size=q.shape)
    log = Measurement("beam", ("hinge",), t, q, v, effort, "torque", motor=motor)
    told = gears(identify(beam, [Sample(log)], Settings(groups=())), [Sample(log)])
    (gear,) = told.each
    assert not gear.sides
    assert not gear.play.told
    assert gear.compliance.told
    assert abs(gear.compliance.value - 1e-3) < 1.5 * gear.compliance.half + 2e-5
    assert any("hardly changes its side: hinge play" in line for line in said_of(told))


def test_logs_without_a_second_encoder_say_so(arm: Arm, log: Measurement) -> None:
    plain = replace(log, motor=None)
    found = gears(identify(arm, [Sample(plain)], Settings(groups=())), [Sample(plain)])
    assert found.each == ()
    assert "no encoder at the motors" in said_of(found)[0]


def test_a_command_tells_servo_and_gear_together(arm: Arm, log: Measurement) -> None:
    plain = replace(log, motor=None, command=log.motor)
    found = gears(identify(arm, [Sample(plain)], Settings(groups=())), [Sample(plain)])
    assert not found.measured
    assert abs(found.each[0].compliance.value - YIELDS[0]) < 1.5 * found.each[0].compliance.half + 0.02 * YIELDS[0]
    assert all("servo and gear" in line for line in said_of(found))


def test_the_motors_side_is_read_and_written(log: Measurement, tmp_path: Path) -> None:
    for ending in ("csv", "parquet", "mcap"):
        if ending == "mcap":
            pytest.importorskip("rosbags")
        file = tmp_path / f"log.{ending}"
        write_measurement(log, file)
        found = read_measurement(file)
        assert found.motor is not None
        assert log.motor is not None
        assert np.allclose(found.motor, log.motor, atol=1e-12)


def test_a_motor_whose_gear_nobody_tells_is_refused(arm: Arm, log: Measurement, tmp_path: Path) -> None:
    rows = csv_of(log)
    assert log.motor is not None
    for row, motor in zip(rows, [["m"] * 3, *(100.0 * log.motor).tolist()], strict=True):
        row += [f"motor_pos_{k}" if value == "m" else f"{value:.6f}" for k, value in enumerate(motor)]
    file = tmp_path / "log.csv"
    file.write_text("\n".join(",".join(row) for row in rows))
    with pytest.raises(
        RecordingError, match=r"column motor_pos_0, row \d+: it turns 100\.?\d* times as far as the joint"
    ):
        read_measurement(file, None, arm)
