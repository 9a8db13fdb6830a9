"""A log that is written in parts and survives its writer."""

from pathlib import Path

from dtwin.run.recording import Log, RunLog, read_log
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages
from services.parts.log_parts import Parts
from services.parts.part_files import SUFFIX


def log(first: int, last: int) -> Log:
    collected = RunLog()
    for k in range(first, last):
        t = 0.01 * k
        sample = Sensors(k, t, (t, 0.0, 0.0), 0.9, k > 5, "red" if k > 5 else "")
        truth = Truth(t, (t, 0.0, 0.0), (0.0, 0.0, 0.0), 0.9, 0.0)
        collected.append(StepRecord(truth, sample, (t, 0.0, 0.0), Voltages(k, t, (1.0, 0.0, 0.0, 3.0), False)))
    collected.add_events([Event(0.01 * first, "arrived", "")])
    return collected.freeze()


def test_parts_of_two_writers_become_the_log_of_one(tmp_path: Path) -> None:
    killed = Parts(tmp_path / "run.parquet")
    killed.add(log(0, 4))
    killed.add(log(4, 10))
    again = Parts(tmp_path / "run.parquet")
    assert [len(part) for part in again.logs] == [4, 6]
    again.add(log(10, 11))
    again.finish({"seed": 3})
    assert not (tmp_path / f"run.parquet{SUFFIX}").exists()
    found = read_log(tmp_path / "run.parquet")
    assert found.columns["t"].tolist() == [0.01 * k for k in range(11)]
    assert [event.time for event in found.events] == [0.0, 0.04, 0.1]
    assert found.metadata == {"seed": 3}


def test_every_part_can_be_read_while_the_run_goes_on(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 8))
    (file,) = (tmp_path / f"run.parquet{SUFFIX}").glob("*.parquet")
    assert len(read_log(file)) == 8


def test_a_run_without_rows_leaves_nothing(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 2))
    parts.clear()
    assert parts.finish({}) is None
    assert list(tmp_path.iterdir()) == []
