"""Runs, identification, monitoring and simulation from Python, against what the commands do."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import dtwin
from dtwin.cli import main
from dtwin.emulation.emulation import Emulation
from dtwin.logs.log import COLUMNS, Log


@pytest.fixture(scope="module")
def run() -> dtwin.Run:
    return dtwin.Cell(seed=1, noise=0.001, noise_kind="gaussian").run(16)


def test_equal_arguments_give_the_bytes_of_the_command(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.parquet", tmp_path / "theirs.parquet"
    fault, heavy = "K2*=0.8@1", {"m1": 0.15}
    cell = dtwin.Cell(machine="servo", seed=4, noise=0.002, fault=fault, set=heavy, target_time=1.5, law="row_sum")
    cell.run(3).save(ours)
    words = ["--machine", "servo", "--seed", "4", "--noise", "0.002", "--fault", fault, "--set", "m1=0.15"]
    words += ["--target-time", "1.5", "--law", "row_sum", "--duration", "3", "--log", str(theirs), "--json"]
    assert main(["run", *words]) == 0
    assert ours.read_bytes() == theirs.read_bytes()
    cell.run(3).save(theirs)
    assert ours.read_bytes() == theirs.read_bytes()


def test_a_run_has_columns_events_and_a_score(run: dtwin.Run) -> None:
    columns = run.arrays()
    assert tuple(columns) == COLUMNS
    assert {len(column) for column in columns.values()} == {1600}
    assert [event.kind for event in run.events] == ["arrived", "picked", "delivered"]
    assert run.score.boxes.delivered == 1
    with pytest.raises(ValueError, match="read-only"):
        columns["t"][0] = 1.0


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_a_frame_holds_the_columns(run: dtwin.Run, library: Literal["pandas", "polars"]) -> None:
    frame = run.frame(library)
    assert type(frame).__module__.startswith(library)
    assert tuple(frame.columns) == COLUMNS
    for name, column in run.arrays().items():
        assert np.array_equal(np.asarray(frame[name]).astype(column.dtype), column), name


def test_a_frame_without_its_library_says_so(run: dtwin.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    expected = dtwin.DtwinError  # imported on its first use, which the patch would prevent
    monkeypatch.setattr("dtwin.api.run.importlib.import_module", missing)
    with pytest.raises(expected, match="expected pandas or polars to be installed"):
        run.frame()
    with pytest.raises(expected, match="expected polars to be installed"):
        run.frame("polars")


def test_a_picture_shows_angles_paths_voltages_and_every_event(run: dtwin.Run) -> None:
    *joints, volts = run.plot().axes
    for joint, axis in enumerate(joints, 1):
        drawn = {line.get_label(): line.get_ydata() for line in axis.lines}
        assert np.array_equal(drawn["measured"], run.arrays()[f"measured_{joint}"])
        assert np.array_equal(drawn["path"], run.arrays()[f"target_{joint}"])
        marks = [np.asarray(line.get_xdata())[0] for line in axis.lines if line.get_gid()]
        assert marks == [event.time for event in run.events]
    assert {f"joint {joint}" for joint in (1, 2, 3)} <= {line.get_label() for line in volts.lines}


def test_no_legend_covers_a_curve(run: dtwin.Run) -> None:
    figure = run.plot()
    figure.canvas.draw()
    for axis in figure.axes:
        legend = axis.get_legend()
        assert legend is not None
        assert legend.get_window_extent().x0 > axis.get_window_extent().x1


def test_an_estimate_is_compared_with_the_machine_that_was_measured() -> None:
    run = dtwin.Cell(machine="weak-motor", seed=1).run(20)
    found = dtwin.identify(run, free="K2")
    assert found.truth == run.arm
    assert found.truth is not None
    assert found.truth.get("K2") == pytest.approx(0.9 * dtwin.ArmParameters().get("K2"))
    assert found.plot().axes[3].get_ylabel() == "% from the truth"


def test_a_saved_run_comes_back(run: dtwin.Run, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    run.save(path)
    again = dtwin.load(str(path))
    assert again.events == run.events
    assert again.arm == run.arm == dtwin.ArmParameters()
    assert all(np.array_equal(again.arrays()[name], run.arrays()[name], equal_nan=True) for name in COLUMNS[:-2])
    again.record(tmp_path / "run.rrd")
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
    with pytest.raises(dtwin.DtwinError, match=r"score: expected a run of Cell\.run"):
        _ = again.score


def test_a_drawn_machine_tells_the_arm_that_it_is() -> None:
    cell = dtwin.Cell(machine=7)
    made = cell.settings.machine.arm(dtwin.ArmParameters())
    assert cell.run(0.1).arm == made != dtwin.ArmParameters()


def test_a_run_that_fails_keeps_what_it_had(monkeypatch: pytest.MonkeyPatch) -> None:
    advance = Emulation.advance

    def fail(self: Emulation, period: float) -> None:
        if self.read().time > 0.5:
            raise dtwin.DtwinError("the plant is broken")
        advance(self, period)

    monkeypatch.setattr(Emulation, "advance", fail)
    with pytest.raises(dtwin.RunError, match="the plant is broken") as failed:
        dtwin.Cell(machine=7).run(2)
    assert 50 <= len(failed.value.run.log) < 60


def test_an_identification_tells_values_intervals_and_truth(run_cell: Callable[..., Log], tmp_path: Path) -> None:
    log = run_cell(25.0, 3)
    path = tmp_path / "run.parquet"
    log.write_parquet(path)
    found = dtwin.identify(dtwin.Run(log), free="D")
    assert set(found.values) == set(found.intervals) == {"D1", "D2", "D3"}
    for name, value in found.values.items():
        assert value == pytest.approx(0.05, rel=0.05)
        assert found.arm.get(name) == value
        assert 0 < found.intervals[name] < 0.01
    assert found.truth == dtwin.ArmParameters()
    assert dtwin.identify(path, free="D").values == found.values
    found.save(tmp_path / "arm.json")
    assert dtwin.monitor(path, model=tmp_path / "arm.json").states == dtwin.monitor(path, model=found).states
    assert found.plot().axes


def test_the_monitor_finds_what_was_injected(run_cell: Callable[..., Log], tmp_path: Path) -> None:
    log = run_cell(25.0, 3, "K1*=0.6@12.5")
    seen: list[tuple[int, int]] = []
    watched = dtwin.monitor(dtwin.Run(log), progress=lambda done, of: seen.append((done, of)))
    assert watched.states["joint 1"] == "failed"
    (finding,) = watched.history
    assert finding.size == pytest.approx(-0.4, abs=0.01)
    assert len(seen) >= 25
    assert {of for _, of in seen} == {2500}
    *joints, evidence = watched.plot().axes
    drawn = joints[0].lines[0].get_ydata()
    assert np.array_equal(drawn, 1e3 * (log.columns["measured_1"] - watched.trace.predicted[:, 0]))
    assert np.max(np.asarray(evidence.lines[0].get_ydata())) >= watched.trace.threshold


def test_a_simulation_is_that_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = dtwin.simulate("pickup", "green", target_time=1.5, set={"D2": 0.1}, gains=None)
    assert main(["simulate", "--goal", "green", "--target-time", "1.5", "--set", "D2=0.1", "--json"]) == 0
    (base,) = json.loads(capsys.readouterr().out)["candidates"]
    assert base["energy"] == outcome.figures.energy
    assert tuple(base["tracking_max"]) == outcome.figures.tracking_max
    slack = dtwin.simulate(
        "pickup", "green", target_time=1.5, set={"D2": 0.1}, gains=dtwin.usual_gains("computed_torque")
    )
    assert max(slack.figures.tracking_max) > max(outcome.figures.tracking_max)


def test_a_search_is_repeated_by_its_seed() -> None:
    found = dtwin.optimise(cost={"tracking": 1}, motion="red:pickup", candidates=80, noise=0, box=(0.2, 0.2), seed=3)
    again = dtwin.optimise(cost={"tracking": 1}, motion="red:pickup", candidates=80, noise=0, box=(0.2, 0.2), seed=3)
    assert found.best == again.best
    assert found.best.cost <= found.reference.cost == 1.0
