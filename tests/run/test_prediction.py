"""What the twin says of a run: rollouts of the last moments, near a healthy arm and away from a faulty one."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from numpy.typing import NDArray

from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import ModelError
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.prediction import HORIZON, BelievedArm, OpenLoop, believed_by_controller
from dtwin.run.settings import CellSettings
from dtwin.task import DEFAULT_TASK
from dtwin.twin.effects import Effects
from dtwin.twin.rollout import rollout

EXACT = replace(DEFAULT_TASK, boxes=replace(DEFAULT_TASK.boxes, lightest=0.2, heaviest=0.2))
"""with boxes as heavy as the controller believes"""
START = 25
"""ticks before the first prediction"""


def run(settings: CellSettings) -> Log:
    cell = Cell(replace(settings, duration=30.0, control=ControlOptions().control()))
    cell.run()
    return cell.log.freeze()


def errors(log: Log, believed: BelievedArm | None = None) -> NDArray[np.float64]:
    """Predicted minus true angles, (ticks, 3), rad."""
    t, angles = OpenLoop(believed or believed_by_controller(log.metadata)).add(log)
    assert np.array_equal(t, log.columns["t"])
    return angles - log.stack("theta")


@pytest.fixture(scope="module")
def log() -> Log:
    return run(CellSettings(noise=0.003))


def test_a_prediction_is_a_rollout_from_the_parabola_through_the_readings(log: Log) -> None:
    believed = believed_by_controller(log.metadata)
    _, angles = OpenLoop(believed).add(log)
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    masses = 0.2 * log.columns["box_gripped"]
    assert np.array_equal(angles[:START], measured[:START])
    assert log.columns["box_gripped"].any()
    for tick in range(START, len(log), 97):
        start = round(tick - HORIZON / PERIOD)
        fitted = np.polyfit(PERIOD * np.arange(-5, 6), measured[start - 5 : start + 6], 2)
        states = rollout(believed.arm, [*fitted[2], *fitted[1]], volts[start:tick], masses[start:tick], substeps=2)
        assert angles[tick] == pytest.approx(states[-1, :3], abs=1e-9)


@pytest.mark.parametrize("length", [1, 7, 50, 2999])
def test_a_run_in_parts_is_predicted_like_the_whole(log: Log, length: int) -> None:
    believed = BelievedArm()
    whole = OpenLoop(believed, every=4).add(log)
    parts = OpenLoop(believed, every=4)
    found = [parts.add(log.part(start, start + length)) for start in range(0, len(log), length)]
    assert np.array_equal(whole[0], log.columns["t"][::4])
    for each, joined in zip(whole, map(np.concatenate, zip(*found, strict=True)), strict=True):
        assert np.array_equal(each, joined)


def test_after_a_gap_the_readings_count_until_enough_ticks_have_come(log: Log) -> None:
    kept = np.r_[0:500, 510:700]
    part = Log(MappingProxyType({name: column[kept] for name, column in log.columns.items()}))
    _, angles = OpenLoop(BelievedArm()).add(part)
    _, whole = OpenLoop(BelievedArm()).add(log)
    assert np.array_equal(angles[500 : 500 + START], part.stack("measured")[500 : 500 + START])
    assert np.array_equal(angles[500 + START :], whole[510 + START : 700])


def test_the_arm_that_is_believed_in_is_predicted_within_milliradians() -> None:
    log = run(CellSettings(task=EXACT))
    assert log.columns["box_gripped"].any()
    assert np.abs(errors(log)).max() < 3e-3


def test_noise_and_the_unknown_mass_of_a_box_are_some_hundredths_of_a_radian(log: Log) -> None:
    off = np.abs(errors(log))
    assert (np.median(off, axis=0) < 4e-3).all()
    assert off.max() < 0.04


@pytest.mark.parametrize(("fault", "least"), [("K2*=0.5@15", 0.5), ("freeze2@16", 0.2), ("mu2=0.05@15", 0.1)])
def test_a_faulty_arm_is_left(fault: str, least: float) -> None:
    off = np.abs(errors(run(CellSettings(faults=(parse_fault(fault),)))))
    assert off[:1500].max() < 0.03
    assert off[1500:, 1].max() > least


def test_what_a_record_tells_of_a_machine_brings_the_prediction_back() -> None:
    log = run(CellSettings(machine=machine_of("dead-zone"), task=EXACT))
    assert np.abs(errors(log)).max() > 0.1
    told = BelievedArm(effects=Effects(dead_zone=(0.3, 0.3, 0.3)))
    assert np.abs(errors(log, told)).max() < 0.01


def test_offsets_of_encoders_are_taken_off() -> None:
    log = run(CellSettings(task=EXACT))
    moved = {f"measured_{joint}": log.columns[f"measured_{joint}"] + 0.1 * joint for joint in (1, 2, 3)}
    known = BelievedArm(offset=(0.1, 0.2, 0.3))
    assert np.abs(errors(Log({**log.columns, **moved}), known)).max() < 3e-3


def test_a_prediction_that_diverges_is_left_out(log: Log) -> None:
    wild = BelievedArm(replace(ArmParameters(), damping=(1e9, 1e9, 1e9)))
    for believed in (wild, replace(wild, effects=Effects(lag=(0.01, 0.01, 0.01)))):
        t, angles = OpenLoop(believed).add(log)
        assert np.array_equal(t, log.columns["t"][:START])
        assert np.isfinite(angles).all()


def test_the_controller_believes_what_its_run_was_started_with() -> None:
    assert believed_by_controller({}) == BelievedArm()
    control = {"model": {"mass": [0.1, 0.2, 0.3]}, "payload": 0.3, "encoder_offset": [0.1, 0.0, 0.0]}
    believed = BelievedArm(replace(ArmParameters(), mass=(0.1, 0.2, 0.3)), 0.3, (0.1, 0.0, 0.0))
    assert believed_by_controller({"control": control}) == believed
    with pytest.raises(ModelError, match=r"metadata of the log: control: .*payload"):
        believed_by_controller({"control": {"payload": -1.0}})
