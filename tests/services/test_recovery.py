"""The whole loop over the services: a fault is found, the arm identified anew, its settings changed."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.experiments.recovery.operator import LIMIT, Story
from dtwin.experiments.recovery.outcome import TOLERANCE, healthy_run, judge, tracked
from dtwin.parameters import ROOT, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.recording import read_log
from dtwin.run.settings import CellSettings
from tests.support.desk import Desk


def test_a_cell_with_grown_friction_recovers(desk: Desk, tmp_path: Path) -> None:
    log, plot = tmp_path / "run.parquet", tmp_path / "run.png"
    command = [sys.executable, "-m", "dtwin", "demo", "recovery", "--seed", "1", "--json"]
    command += ["--log", str(log), "--plot", str(plot)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr + done.stdout
    assert desk.processes() == {}
    (run,) = json.loads(done.stdout)["runs"]
    assert run["trouble"] == ""
    assert run["named"] == {"cause": "friction", "parameter": run["fault"][:2]}
    assert 0.0 < run["detected_after_s"] < run["uploaded_after_s"] < run["recovered_after_s"] < LIMIT
    factor = float(run["fault"].partition("=")[2])
    assert run["refitted"] == pytest.approx(factor * ArmParameters().get(run["fault"][:2]), rel=0.02)
    ratios = [(one["after_s"], one["error_rad"] / one["healthy_rad"]) for one in run["motions"]]
    assert ratios[0][1] > 2.0
    since = [ratio for after, ratio in ratios if after >= run["recovered_after_s"]]
    assert max(since) <= TOLERANCE
    assert {one["carries"] for one in run["motions"]} == {True, False}
    assert [m["time"] for m in run["moments"]] == sorted(m["time"] for m in run["moments"])
    assert {m["who"] for m in run["moments"]} == {"cell", "monitoring", "identification", "simulation", "operator"}
    told = {(event.time, event.text) for event in read_log(log).events}
    assert {(m["time"], m["text"]) for m in run["moments"]} <= told
    assert plot.stat().st_size > 10_000


def test_a_run_is_judged_by_the_same_motions_of_the_healthy_arm() -> None:
    settings = CellSettings(duration=60.0, seed=2, noise=0.002)
    healthy = healthy_run(settings, ArmParameters(), 0.0)
    cell = Cell(settings)
    cell.run()
    story = Story(fault=30.0, uploaded=30.0)
    same = judge(2, "D1*=1.6", story, cell.log.freeze(), healthy)
    assert len(same.motions) >= 3
    assert all(one.ratio == 1.0 for one in same.motions)
    assert same.recovered == same.motions[0].motion.stop
    assert not same.succeeded, "nobody has named the fault"
    poor = Cell(replace(settings, arm=ArmParameters().with_values({"D1": 0.08})))
    poor.run()
    worse = judge(2, "D1*=1.6", story, poor.log.freeze(), healthy)
    assert worse.recovered is None
    assert all(one.ratio > 2.0 for one in worse.motions)
    masses = {(motion.mass, motion.carries) for motion in tracked(healthy)}
    assert masses >= {(one.motion.mass, one.motion.carries) for one in same.motions}
