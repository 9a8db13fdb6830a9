"""Motions found in a log, and predicted from their first sample."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.errors import RecordingError
from dtwin.logs.log import Log
from dtwin.parameters import HANGING, PICKUP, PLACES, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.simulation.measured import compare, find, motions, settings_of
from dtwin.simulation.whatif import Simulator

CONTROL = ControlSettings(1.7, usual_gains("computed_torque", kp=(250.0, 500.0, 300.0)))


@pytest.fixture(scope="module")
def log() -> Log:
    cell = Cell(CellSettings(duration=60.0, seed=3, noise=0.001, control=CONTROL))
    cell.run()
    return cell.log.freeze()


def test_all_motions_are_found(log: Log) -> None:
    found = list(motions(log))
    ended = [event for event in log.events if event.time < 57.0]  # what began later does not end in the log
    picked = [event for event in ended if event.kind == "picked"]
    delivered = [event for event in ended if event.kind == "delivered"]
    carrying = [motion for motion in found if motion.carries]
    assert len(carrying) == len(picked) > 1
    assert len(found) == 1 + len(picked) + len(delivered)
    for motion, event in zip(carrying, picked, strict=True):
        assert motion.time == pytest.approx(event.time, abs=0.011)
        assert motion.goal in [place.theta for place in PLACES.values()]
    assert {motion.target_time for motion in found} == {1.7}
    assert [motion.goal for motion in found if not motion.carries] == [PICKUP.theta] * (1 + len(delivered))
    assert log.stack("measured")[found[0].start] == pytest.approx(HANGING, abs=0.01)
    for motion, following in itertools.pairwise(found):
        assert motion.stop == following.start


def test_motions_are_predicted(log: Log, simulator: Simulator) -> None:
    for motion in motions(log):
        found = compare(log, motion, settings_of(log), ArmParameters(), 0.2, simulator)
        assert min(found.fit) > 0.99
        assert len(found.measured) == motion.stop - motion.start == len(found.predicted.theta)
        true = log.stack("theta")[motion.start : motion.stop]
        assert np.abs(true - found.predicted.theta).max() < 0.02
        assert max(found.figures.tracking_max) < 0.02


def test_a_wrong_model_predicts_worse(log: Log, simulator: Simulator) -> None:
    motion = find(log, 10.0)
    settings = settings_of(log)
    right, wrong = (
        compare(log, motion, settings, ArmParameters(damping=(d, d, d)), 0.2, simulator) for d in (0.05, 0.1)
    )
    assert min(wrong.fit) < min(right.fit) - 0.005


def test_a_path_that_came_as_fifteen_digits_is_the_same(log: Log) -> None:
    """The log has its numbers as a 4diac FORTE writes them."""
    rounded = {f"target_{joint}": np.array([float(f"{x:.15g}") for x in path]) for joint, path in targets(log)}
    assert any((rounded[name] != log.columns[name]).any() for name in rounded)
    assert list(motions(Log({**log.columns, **rounded}, log.events, {}))) == list(motions(log))


def targets(log: Log) -> list[tuple[int, list[float]]]:
    return [(joint, log.columns[f"target_{joint}"].tolist()) for joint in (1, 2, 3)]


def test_a_log_without_motion_has_none(log: Log) -> None:
    still = {name: np.full_like(log.columns[name], 0.5) for name in ("target_1", "target_2", "target_3")}
    assert list(motions(Log({**log.columns, **still}, log.events, {}))) == []


def test_settings_come_from_the_log(log: Log) -> None:
    assert settings_of(log) == CONTROL
    with pytest.raises(RecordingError, match="no usable control settings"):
        settings_of(Log(log.columns, log.events, {}))


def test_no_motion_after_the_last(log: Log) -> None:
    assert find(log, 0.0).start == 0
    with pytest.raises(RecordingError, match="no motion of the log starts at or after 900 s: the last one starts at"):
        find(log, 900.0)
