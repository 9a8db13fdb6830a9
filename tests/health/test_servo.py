"""Servos whose delay, play and drift are known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dtwin.errors import IdentificationError
from dtwin.health.servo import findings, servo_health
from dtwin.measurements.measurement import Measurement

RATE = 30.0


def servo(delay: int = 3, play: float = 0.02, drift: float = 0.05, stuck: bool = False) -> Measurement:
    """Two episodes of steps with rests: positions follow late, stay short by half the play, and drift."""
    generator = np.random.default_rng(0)
    command, q, episode = [], [], []
    for number in range(2):
        ends = generator.uniform(-1.0, 1.0, 15)
        told = np.concatenate([np.r_[np.linspace(a, b, 30), np.full(40, b)] for a, b in pairwise(ends)])
        side = np.concatenate([np.full(70, np.sign(b - a)) for a, b in pairwise(ends)])
        follows = np.r_[np.full(delay, told[0]), told[:-delay]] - 0.5 * play * side + drift * number
        if stuck:
            follows = np.minimum(follows, 0.2)
        command.append(told)
        q.append(follows + 1e-4 * generator.normal(size=len(told)))
        episode.append(np.full(len(told), number))
    rows = sum(map(len, q))
    positions, commands = np.concatenate(q)[:, None], np.concatenate(command)[:, None]
    t = np.arange(rows) / RATE
    starts = (0, len(q[0]))
    return Measurement(
        "servo", ("pan",), t, positions, command=commands, starts=starts, episodes=np.concatenate(episode)
    )


def test_delay_play_and_drift_are_found_with_intervals() -> None:
    (found,) = servo_health(servo())
    assert found.delay is not None
    assert abs(found.delay.value - 3 / RATE) < 0.01
    assert found.width is not None
    assert abs(found.width.value + 0.02) < found.width.half + 2e-3
    assert found.drift is not None
    assert found.drift.differs
    assert abs(found.drift.value - 0.05) < found.drift.half + 5e-3
    assert found.overloaded == 0.0


def test_a_joint_that_is_held_is_told_and_what_nobody_can_know_too() -> None:
    measurement = servo(stuck=True)
    said = findings(measurement, servo_health(measurement))
    assert any("away from its command" in line for line in said)
    assert any("without currents" in line for line in said)


def test_no_drift_is_claimed_where_there_is_none() -> None:
    measurement = servo(drift=0.0)
    (found,) = servo_health(measurement)
    assert found.drift is not None
    assert abs(found.drift.value) < 0.02
    assert not any("calibration" in line and "pan" in line for line in findings(measurement, [found]))


def test_positions_alone_are_refused() -> None:
    with pytest.raises(IdentificationError, match="expected columns of commanded positions"):
        servo_health(replace(servo(), command=None))
