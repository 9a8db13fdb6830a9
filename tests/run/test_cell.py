"""The closed loop on real physics: boxes, tracking, determinism, faults."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.emulation.faults import parse_fault
from dtwin.errors import DivergenceError, ParameterError
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell, RunSummary
from dtwin.run.loop import tick_count
from dtwin.run.settings import CellSettings


def run(settings: CellSettings) -> tuple[Log, RunSummary]:
    cell = Cell(settings)
    cell.run()
    log = cell.log.freeze()
    return log, cell.summary(log)


@pytest.mark.parametrize(("seed", "noise", "placement_mm"), [(1, 0.0, 1.0), (2, 0.005, 10.0)])
def test_every_picked_box_is_delivered(seed: int, noise: float, placement_mm: float) -> None:
    _, summary = run(CellSettings(duration=300.0, seed=seed, noise=noise))
    boxes = summary.boxes
    assert boxes.picked > 10
    assert boxes.misplaced == 0
    assert boxes.delivered == boxes.picked - boxes.held
    assert boxes.held <= 1
    assert "grip_missed" not in summary.events
    assert summary.placement_error_mm is not None
    assert summary.placement_error_mm.max <= placement_mm
    if noise == 0.0:
        assert summary.saturated_ticks == 0


def test_equal_seeds_give_equal_bytes(tmp_path: Path) -> None:
    settings = CellSettings(duration=20.0, seed=5, noise=0.002, faults=(parse_fault("K2*=0.9@10"),))
    files = [tmp_path / "a.parquet", tmp_path / "b.parquet", tmp_path / "c.parquet"]
    for path, chosen in zip(files, (settings, settings, replace(settings, seed=6)), strict=True):
        run(chosen)[0].write_parquet(path)
    first, second, other = (path.read_bytes() for path in files)
    assert first == second
    assert first != other


def test_noise_changes_no_box() -> None:
    quiet, noisy = (run(CellSettings(duration=60.0, seed=8, noise=noise))[1] for noise in (0.0, 0.003))
    assert quiet.boxes.arrived == noisy.boxes.arrived > 0


def test_a_weak_motor_tracks_worse() -> None:
    settings = CellSettings(duration=30.0, seed=1)
    _, healthy = run(settings)
    _, weak = run(replace(settings, faults=(parse_fault("K1*=0.7@0"),)))
    assert weak.tracking_error_rad.max[0] > 3 * healthy.tracking_error_rad.max[0]


def test_target_time_sets_the_speed_of_motion() -> None:
    fast, slow = (
        np.abs(run(CellSettings(duration=10.0, control=ControlSettings(target_time=t)))[0].stack("omega")).max()
        for t in (1.0, 4.0)
    )
    assert 3.0 < fast / slow < 5.0  # a cubic path's peak velocity is 1.5 d / T


def test_the_row_sum_law_sorts_boxes_too() -> None:
    control = ControlSettings(law="row_sum")
    _, summary = run(CellSettings(duration=120.0, seed=1, control=control))
    assert summary.boxes.delivered >= 5
    assert summary.boxes.misplaced == summary.saturated_ticks == 0


CASCADE = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")


def test_the_cascade_sorts_boxes_closer_to_their_places() -> None:
    _, summary = run(CellSettings(duration=120.0, control=CASCADE))
    assert summary.boxes.delivered == summary.boxes.picked == 7
    assert summary.placement_error_mm is not None
    assert summary.placement_error_mm.max < 0.03
    assert max(summary.tracking_error_rad.max) < 0.005
    assert summary.saturated_ticks == 0


@pytest.mark.parametrize("fault", [f"K{motor}*={factor}@20" for motor in (1, 2, 3) for factor in (0.8, 1.2)])
def test_the_cascade_works_with_a_motor_weaker_or_stronger_by_a_fifth(fault: str) -> None:
    _, summary = run(CellSettings(duration=70.0, control=CASCADE, faults=(parse_fault(fault),)))
    assert summary.boxes.delivered == 4
    assert summary.boxes.misplaced == 0


def test_the_cascade_works_with_coulomb_friction_that_it_does_not_know() -> None:
    arm = ArmParameters(coulomb=(0.03, 0.03, 0.03))
    _, summary = run(CellSettings(duration=120.0, control=CASCADE, arm=arm))
    assert summary.boxes.delivered == 7


def test_an_arm_that_cannot_follow_is_stopped_instead_of_whirling() -> None:
    settings = CellSettings(duration=60.0, control=CASCADE, faults=(parse_fault("K2*=0.1@20"),))
    log, _ = run(settings)
    late = log.stack("omega")[4000:]
    assert np.abs(late).max() < 0.05
    assert np.abs(log.stack("omega")).max() < 25.0
    assert (log.stack("volts")[-100:, :3] == 0.0).all() or np.abs(log.stack("volts")[-100:, :3]).max() < 8.0


def test_the_run_ends_between_two_ticks_when_asked() -> None:
    cell = Cell(CellSettings(duration=60.0))
    cell.run(lambda done: done < 300)
    assert len(cell.log) == 300


def test_divergence_keeps_what_was_recorded() -> None:
    cell = Cell(CellSettings(duration=10.0, faults=(parse_fault("D1*=1e6@2"),)))
    with pytest.raises(DivergenceError, match=r"t = 2\.\d+ s"):
        cell.run()
    log = cell.log.freeze()
    assert len(log) >= 200
    assert np.isfinite(log.stack("theta")).all()


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf"), 0.004])
def test_impossible_durations(duration: float) -> None:
    with pytest.raises(ParameterError, match="duration"):
        tick_count(duration)
