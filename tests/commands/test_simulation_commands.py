"""`dtwin simulate`, `optimise` and `history` as a user meets them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest

import dtwin
from dtwin.api.live import SAMPLES, LiveCell
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload
from dtwin.cli import main
from dtwin.commands.simulation import simulate
from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.identification.machine.record import write_record
from dtwin.parameters import PERIOD, PICKUP, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.signals import Sensors, Voltages
from dtwin.simulation.history import Entry, History
from dtwin.simulation.whatif import MotionCase
from dtwin.twin.effects import Effects
from tests.support.records import recorded

PNG = b"\x89PNG\r\n\x1a\n"


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    assert main([*words, "--json"]) == 0
    return msgspec.json.decode(capsys.readouterr().out)


def test_simulate_compares_candidates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "motions.png"
    report = answer(
        capsys,
        *("simulate", "--goal", "0.15,0.28", "--target-time", "4", "--payload", "0.2"),
        *("--candidate", "T=2", "--candidate", "D3=0.1", "--plot", str(picture)),
    )
    base, faster, rough = report["candidates"]
    assert base["target"] == pytest.approx([1.8515, -0.5320, -1.3195], abs=2e-3)
    assert faster["target_time"] == 2.0
    assert faster["settling_time"] < base["settling_time"]
    assert max(rough["tracking_max"]) > 3 * max(base["tracking_max"])
    assert base["seconds"] > 0.0
    assert picture.read_bytes().startswith(PNG)


def test_simulate_carries_what_the_cell_carries_on_that_motion(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--goal", "green"]) == 0
    assert re.search(r"load\W+0\.2 kg", capsys.readouterr().out)
    assert main(["simulate", "--start", "green", "--goal", "pickup"]) == 0
    assert re.search(r"load\W+0 kg", capsys.readouterr().out)


def test_simulate_predicts_what_was_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = Cell(CellSettings(duration=12.0, noise=0.001, control=ControlSettings(1.5)))
    cell.run()
    path = tmp_path / "run.parquet"
    cell.log.freeze().write_parquet(path)
    report = answer(capsys, "simulate", "--log", str(path), "--plot", str(tmp_path / "compared.png"))
    assert report["measured"]["time"] == 0.0
    assert min(report["measured"]["fit"]) > 0.99
    assert report["candidates"][0]["target_time"] == 1.5
    assert main(["simulate", "--log", str(path)]) == 0
    assert "fit 0.99" in capsys.readouterr().out


def test_simulate_takes_the_record_of_an_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record = tmp_path / "arm.json"
    write_record(recorded(Effects(stiction=(0.02, 0.02, 0.02))), record)
    (rough,) = answer(capsys, "simulate", "--commissioned", str(record))["candidates"]
    assert tuple(rough["tracking_max"]) == dtwin.simulate(commissioned=record).figures.tracking_max
    assert max(rough["tracking_max"]) > 2.0 * max(dtwin.simulate().figures.tracking_max)
    assert main(["simulate", "--commissioned", str(record), "--model", "other.json"]) == 2
    assert "--commissioned: expected no --model beside it" in capsys.readouterr().err


def test_optimise_saves_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved, picture = tmp_path / "best.json", tmp_path / "front.png"
    report = answer(
        capsys,
        *("optimise", "--motion", "red:pickup", "--candidates", "120", "--workers", "1", "--noise", "0"),
        *("--cost", "time=1", "--cost", "energy=0.5", "--save", str(saved), "--plot", str(picture)),
    )
    assert report["best"]["cost"] < 1.0
    assert report["candidates"] == 120
    assert report["motions_per_second"] > 0
    content = msgspec.json.decode(saved.read_bytes())
    assert content["target_time"] == report["best"]["target_time"]
    assert content["gains"] == report["best"]["gains"]
    assert picture.read_bytes().startswith(PNG)
    assert content["target_time"] == round(content["target_time"], 3)
    assert all(gain == round(gain, 1) for gains in content["gains"].values() for gain in gains)
    costs = [(each["terms"]["time"], each["terms"]["tracking"]) for each in report["front"]]
    assert costs == sorted(costs)


def test_history_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    history = History(tmp_path / "h.jsonl")
    history.append(Entry(1, 0.0, "start", "dtwin", "", "", ControlSettings(), "found in force"))
    history.append(Entry(2, 7.5, "upload", "anna", "faster", "target", ControlSettings(1.5)))
    report = answer(capsys, "history", "--file", str(history.path))
    assert [entry["version"] for entry in report["entries"]] == [1, 2]
    assert main(["history", "--file", str(history.path)]) == 0
    text = capsys.readouterr().out
    assert "upload target by anna: faster" in text
    assert "T 1.5 s" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["simulate", "--goal", "moon"], "unknown place 'moon'"),
        (["simulate", "--goal", "3,3"], "the reach is"),
        (["simulate", "--candidate", "speed=3"], "unknown name 'speed'"),
        (["simulate", "--payload", "-1"], "payload: expected"),
        (["simulate", "--set", "K9=1"], "unknown parameter 'K9': expected K1,"),
        (["simulate", "--model", "nobody"], "nobody"),
        (["simulate", "--plot", "/nowhere/a.png"], "cannot be written"),
        (["simulate", "--log", "/nowhere.parquet"], "cannot be read"),
        (["optimise", "--cost", "speed=1"], "unknown term 'speed'"),
        (["optimise", "--cost", "time=x"], "expected TERM=WEIGHT"),
        (["optimise", "--motion", "red"], "expected FROM:TO"),
        (["optimise", "--candidates", "3"], "candidates: expected at least 80"),
        (["history", "--file", "/nowhere.jsonl"], "there is no history yet"),
        (["demo", "recovery", "--runs", "0"], "--runs: expected at least 1"),
        (["demo", "recovery", "--fault", "K9*=2"], "unknown fault target"),
        (["demo", "recovery", "--commissioned", "nothere.json"], "nothere.json"),
        (["experiment", "recovery", "--commissioned", "a.json", "--machines", "2"], "expected without --machines"),
        (["experiment", "recovery", "--runs", "0"], "--runs: expected at least 1"),
        (["experiment", "accuracy", "--runs", "0"], "--runs: expected at least 1"),
        (["upload", "target", "--why", "x", "--time", "1", "--cell", "nowhere"], "is not up on this machine"),
    ],
)
def test_mistakes_are_one_line(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.startswith("dtwin: ")
    assert said.count("\n") == 1


@pytest.mark.parametrize(("payload", "holds", "load"), [(None, True, 0.2), (None, False, 0.0), (0.1, False, 0.1)])
def test_the_load_of_a_running_arm_is_what_it_holds(
    payload: float | None, holds: bool, load: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless another one is asked for."""
    monkeypatch.setattr(simulate, "connect", lambda cell: _Running(holds))
    found: list[MotionCase] = []
    monkeypatch.setattr(simulate, "_print", lambda outcomes, *_: found.append(outcomes["base"].case))
    assert simulate.Simulate(payload=payload, live=True).execute() == 0
    (case,) = found
    assert (case.payload, case.theta) == (load, PICKUP.theta)
    assert case.omega == pytest.approx((0.1, 0.0, 0.0))


class _Running(LiveCell):
    """A running cell: what it tells of an arm that moves, and does as its own bus."""

    def __init__(self, holds: bool) -> None:
        super().__init__(cast(Bus, self))
        self._holds = holds

    def close(self) -> None:
        pass

    def samples(self, count: int | None = None, *, bound: int = 1000, patience: float = 5.0) -> Iterator[Sensors]:
        first, second, third = PICKUP.theta
        for k in range(1 - SAMPLES, 1):
            yield Sensors(k + 20, 0.2 + PERIOD * k, (first + 0.1 * PERIOD * k, second, third), 0.4, False, "")

    def settings(self) -> Upload:
        return Upload(1, 0.0, "start", "", False, usual_gains("cascade"), 2.0, "cascade", ArmParameters())

    def subscribe(self, topic: object, message: object, receive: Callable[[Voltages], None]) -> SimpleNamespace:
        receive(Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), self._holds))
        return SimpleNamespace(end=lambda: None)


def test_another_arm_does_its_work_on_its_twin_with_every_candidate(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["simulate", "--arm", "planar-2r", "--duration", "6", "--pole", "10"]
    assert main([*words, "--candidate", "payload=0.3", "--candidate", "speed=1.5, payload=0", "--json"]) == 0
    base, loaded, quick = msgspec.json.decode(capsys.readouterr().out)["candidates"]
    given = dtwin.simulate_arm("planar-2r", 6.0, pole=10.0, payload=0.3)
    assert loaded["tracking_max"] == np.abs(given.error).max(axis=0).tolist()
    assert max(base["tracking_max"]) < max(loaded["tracking_max"])
    assert quick["reached"] > base["reached"] == loaded["reached"]
    assert main(words) == 0
    assert "shoulder, farthest from its path, mrad" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--arm", "planar-2r", "--candidate", "T=3"],
            "--candidate 'T=3': expected a number for pole, observer, speed",
        ),
        (["--arm", "planar-2r", "--pole", "900"], "--pole: expected 1 to 60 rad/s, got 900"),
        (["--arm", "planar-2r", "--duration", "0"], "--duration: expected above 0 and at most 86400 s, got 0"),
        (["--arm", "planar-2r", "--goal", "blue"], "--goal: has no meaning for another arm than the thesis's"),
        (["--arm", "servo-2r"], "expected a drive commanded in V, N m or A"),
        (["--speed", "1.1"], "--speed: expected --arm with another arm, or --live where one is up"),
    ],
)
def test_what_cannot_be_asked_of_another_arm_is_told(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", *words]) == 2
    assert message in capsys.readouterr().err
