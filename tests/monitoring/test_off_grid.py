"""Encoders whose readings are on no grid, as after a table has corrected them: what they repeat is a code."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.identification.machine.sensors import step_of
from dtwin.monitoring.sensing.readings import Readings
from dtwin.run.loop import run
from dtwin.signals import StepRecord
from tests.outside import readings
from tests.outside.around import Around

Array = NDArray[np.float64]
ERROR = 3e-3
"""rad, of interpolation"""
SURE = 5e-4
"""rad, standard deviation of a prediction"""
ENCODERS = [(12, 64, 0.0), (10, 64, 0.0), (12, 512, 0.0), (12, 512, 3e-4)]
"""Bits, knots of the table, noise in rad."""


@cache
def worked(bits: int, knots: int, noise: float) -> tuple[Array, Array]:
    """What corrected encoders read of an arm that sorts boxes, and its true angles, (N, 3) rad each."""
    rows: list[tuple[tuple[float, ...], tuple[float, ...]]] = []

    def watch(record: StepRecord) -> None:
        rows.append((record.sensors.theta, record.truth.theta))

    effect = readings.corrected(ERROR, 2.0 * math.pi / 2**bits, knots)
    plant = Around(Emulation(noise=noise, seed=5), effect, 5)
    run(plant, EmbeddedController(ControlSettings(law="cascade")), 1500, record=watch)
    measured, true = np.array(rows).transpose(1, 0, 2)
    return measured, true


def judged(measured: Array, true: Array, noise: float) -> tuple[Readings, Array]:
    """The readings after all samples, and at which encoders counted as stopped, (N, 3)."""
    found, frozen = Readings((noise, noise, noise)), []
    for reading, angle in zip(measured, true, strict=True):
        found.update(reading)
        found.judge(angle, np.full(3, SURE), True)
        found.listen(reading)
        frozen.append(found.frozen.copy())
    return found, np.array(frozen)


@pytest.mark.parametrize(("bits", "knots", "noise"), ENCODERS)
def test_a_code_that_is_repeated_is_no_stopped_encoder(bits: int, knots: int, noise: float) -> None:
    """No length divides the steps, so any repetition in slow motion proved that the encoder had stopped."""
    found, frozen = judged(*worked(bits, knots, noise), noise)
    assert found.resolution == pytest.approx(np.full(3, 2.0 * math.pi / 2**bits), rel=0.5)
    assert not frozen.any()


@pytest.mark.parametrize("start", [0, 700], ids=["from rest", "in motion"])
def test_such_an_encoder_that_stops_in_motion_is_found(start: int) -> None:
    measured, true = (angles[start:].copy() for angles in worked(12, 512, 0.0))
    moves = 450 + int(np.abs(np.diff(true[450:, 1])).argmax())
    measured[moves:, 1] = measured[moves, 1]
    _, frozen = judged(measured, true, 0.0)
    assert not frozen[: moves + 1].any()
    assert frozen[moves + 10, 1]


@pytest.mark.parametrize(("bits", "knots", "noise"), ENCODERS)
def test_commissioning_tells_the_width_of_the_codes(bits: int, knots: int, noise: float) -> None:
    measured, _ = worked(bits, knots, noise)
    assert [step_of(column) for column in measured.T] == pytest.approx([2.0 * math.pi / 2**bits] * 3, rel=0.5)


def test_an_encoder_that_loses_samples_shows_no_codes() -> None:
    generator = np.random.default_rng(0)
    fine = np.cumsum(0.01 * generator.standard_normal(4000)) + 5e-4 * generator.standard_normal(4000)
    kept = np.maximum.accumulate(np.where(generator.random(4000) < 0.1, 0, np.arange(4000)))
    assert step_of(fine[kept]) is None
