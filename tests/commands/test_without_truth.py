"""What the twin says of a run depends on what was measured and commanded alone: truth only scores."""

import json
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.cli import main
from dtwin.emulation.faults import parse_fault
from dtwin.logs.log import TRUTH, Log
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings

SCORES = ("truth", "seconds", "real_time_factor", "model_file", "computed_in_ms")


@pytest.fixture(scope="module")
def log() -> Log:
    control, faults = ControlOptions().control(), (parse_fault("K2*=0.5@9"),)
    cell = Cell(CellSettings(duration=12.0, seed=4, noise=0.002, control=control, faults=faults))
    cell.run()
    return cell.log.freeze()


def scrambled(log: Log) -> Log:
    generator = np.random.default_rng(1)
    wrong = {name: generator.normal(size=len(log)) for name in TRUTH}
    notes = {**log.metadata, "arm": {**log.metadata["arm"], "mass": [0.2, 0.3, 0.4]}, "faults": []}
    return replace(log, columns=MappingProxyType({**log.columns, **wrong}), metadata=notes)


def written(log: Log, path: Path) -> Path:
    log.write_parquet(path)
    return path


def without(log: Log, path: Path) -> Path:
    log.write_parquet(path)
    pq.write_table(pq.read_table(path).drop_columns(list(TRUTH)), path)
    return path


def said(capsys: pytest.CaptureFixture[str], *words: str) -> Any:
    """What a command prints as JSON, but for what scores it or depends on the machine it runs on."""
    assert main(words) in (0, 1)
    return scoreless(json.loads(capsys.readouterr().out))


def scoreless(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: scoreless(part) for name, part in value.items() if name not in SCORES}
    return [scoreless(part) for part in value] if isinstance(value, list) else value


@pytest.mark.parametrize(
    "words",
    [
        ("identify", "LOG", "--free", "K,D", "--save", "None", "--json"),
        ("monitor", "LOG", "--json"),
        ("simulate", "--log", "LOG", "--json"),
    ],
    ids=" ".join,
)
def test_truth_changes_nothing_that_is_said(
    log: Log, words: tuple[str, ...], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def said_of(file: Path) -> Any:
        return said(capsys, *(str(file) if word == "LOG" else word for word in words))

    known = said_of(written(log, tmp_path / "run.parquet"))
    assert said_of(written(scrambled(log), tmp_path / "run.parquet")) == known
    assert said_of(without(log, tmp_path / "run.parquet")) == known


def test_a_run_without_truth_is_drawn(log: Log, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = without(log, tmp_path / "real.parquet")
    picture = tmp_path / "real.rrd"
    assert main(("monitor", str(file), "--record", str(picture), "--json")) in (0, 1)
    assert picture.stat().st_size > 10_000
