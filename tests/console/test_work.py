"""Calculations without a server: the signal is found among voltages, and what the page asks for is done."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from dtwin.console.calculations.excited import find_signal
from dtwin.console.calculations.tasks import Candidate, Optimise, Recall, Simulate, Task, Work
from dtwin.controller.settings import usual_gains
from dtwin.errors import ParameterError
from dtwin.parameters import ROOT
from dtwin.run.cell_file import cell_of
from dtwin.simulation.places import angles_of
from dtwin.task import DEFAULT_TASK
from dtwin.task import Task as CellTask


def noise(samples: int) -> Any:
    return np.random.default_rng(0).normal(size=(samples, 3))


def test_the_last_signal_is_found_among_other_voltages() -> None:
    levels = [(6.0, 4.0, 3.0)] * 3 + [(-6.0, -4.0, -3.0)] * 2 + [(6.0, 4.0, 3.0), (-6.0, -4.0, -3.0)]
    signal = np.repeat(np.array(levels), 50, axis=0)
    volts = np.concatenate([noise(300), signal, noise(200), np.zeros((100, 3)), noise(50)])
    assert find_signal(volts) == slice(300, 650)
    with pytest.raises(ParameterError, match="no signal"):
        find_signal(np.concatenate([noise(300), np.zeros((100, 3))]))


def done(task: Task, folder: Path, recordings: str = "", cell: CellTask = DEFAULT_TASK) -> dict[str, Any]:
    """The last line that the process of a task says."""
    work = msgspec.json.encode(Work(task, str(folder / "store"), recordings, cell=cell))
    command = [sys.executable, "-m", "dtwin.console.calculations.work"]
    ended = subprocess.run(command, input=work + b"\n", cwd=ROOT, capture_output=True, timeout=120)
    assert ended.returncode == 0, ended.stderr.decode()
    last: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return last


def test_a_motion_is_simulated_with_every_candidate(tmp_path: Path) -> None:
    candidates = tuple(Candidate(f"T={time}", usual_gains("cascade"), time) for time in (1.5, 3.0))
    motions = done(Simulate("pickup", "red", candidates, 0.2), tmp_path)["result"]["motions"]
    assert [motion["name"] for motion in motions] == ["T=1.5", "T=3.0"]
    assert motions[0]["figures"]["settling_time"] < motions[1]["figures"]["settling_time"]
    assert len(motions[0]["theta"]) == 3
    assert len(motions[0]["theta"][0]) == len(motions[0]["time"])


def test_the_places_and_boxes_are_those_of_the_cell(tmp_path: Path) -> None:
    cell, gains = cell_of("four-colours").task, usual_gains("cascade")
    candidate = Candidate("one", gains, 2.0)
    [motion] = done(Simulate("pickup", "yellow", (candidate,)), tmp_path, cell=cell)["result"]["motions"]
    ends = [path[-1] for path in motion["path"]]
    assert ends == pytest.approx(angles_of("yellow", cell), abs=1e-4)
    refused = done(Simulate("pickup", "blue", (candidate,)), tmp_path, cell=cell)["error"]
    assert refused == "unknown place 'blue': expected pickup, yellow, red, violet, green, home or hanging"
    found = done(Optimise(gains, 2.0, 2.0, 2.0, 80), tmp_path, cell=cell)["result"]
    assert found["judged"] == 80


def test_what_is_wrong_is_said_in_a_line(tmp_path: Path) -> None:
    candidate = Candidate("one", usual_gains("cascade"), 2.0)
    assert "nowhere" in done(Simulate("nowhere", "red", (candidate,)), tmp_path)["error"]
    absent = Candidate("one", usual_gains("cascade"), 2.0, model="arm@7")
    assert "no model" in done(Simulate("pickup", "red", (absent,)), tmp_path)["error"]


@pytest.mark.parametrize("name", ["../run.parquet", "/etc/passwd", "no.parquet", "notes.txt"])
def test_only_logs_of_the_folder_are_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "notes.txt").write_text("secret")
    (tmp_path / "run.parquet").write_text("")
    assert "no log" in done(Recall(name), tmp_path, recordings=str(tmp_path / "logs"))["error"]
