"""What all experiments share: the pool of workers, the report and the frame of the commands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest

from dtwin.commands.frame import SeriesCommand
from dtwin.errors import ParameterError, RecordingError
from dtwin.experiments.report import Picture, Report, ensure_folder, page, table
from dtwin.pictures import new_figure
from dtwin.pool import Progress, Workers, spread


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_items(workers: int) -> None:
    told: list[tuple[int, int]] = []
    assert spread(math.sqrt, [16.0, 4.0, 9.0], workers, lambda *now: told.append(now)) == [4.0, 2.0, 3.0]
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert spread(math.sqrt, [], workers) == []


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_worker_is_raised(workers: int) -> None:
    with Workers(workers) as pool:
        assert pool.map(math.sqrt, [1.0]) == [1.0]
        with pytest.raises(ValueError, match="domain"):
            pool.map(math.sqrt, [1.0, -1.0])


def report() -> Report:
    return page("A title", "Words.", table(["a", "b"], [["1", "2"]]), Picture("p.png", "A picture", new_figure(2, 2)))


def test_a_report_is_a_page_with_its_pictures(tmp_path: Path) -> None:
    path = report().write(tmp_path / "new" / "folder")
    assert path.read_text() == "# A title\n\nWords.\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n\n![A picture](p.png)\n"
    assert (path.parent / "p.png").read_bytes().startswith(b"\x89PNG")
    assert report().words.text == report().text.removesuffix("\n![A picture](p.png)\n")


def test_a_folder_that_cannot_be_is_told_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(RecordingError, match="expected a folder"):
            ensure_folder(folder)
    ensure_folder(tmp_path / "new" / "folder")
    assert not (tmp_path / "new").exists()


@dataclass(frozen=True)
class Sums(SeriesCommand[int]):
    """Add the numbers up to one."""

    name: ClassVar = "sums"

    last: int = 3
    """The last number."""

    def measure(self, progress: Progress) -> int:
        progress(1, 1)
        return sum(range(self.last + 1))

    def report(self, result: int) -> Report:
        return page("Sums", f"It is {result}.")

    def figures(self, result: int) -> dict[str, Any]:
        return {"sum": result}

    def passed(self, result: int) -> bool:
        return result == 6


def test_the_frame_reports_prints_and_judges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert Sums(json=True).execute() == 0
    found = msgspec.json.decode(capsys.readouterr().out)
    assert (found["sum"], found["report"]) == (6, "experiment-sums/report.md")
    assert Path("experiment-sums/report.md").read_text() == "# Sums\n\nIt is 6.\n"
    assert Sums(last=4, out=Path("elsewhere")).execute() == 1
    assert "It is 10." in capsys.readouterr().out
    for wrong in (Sums(seed=-1), Sums(workers=0)):
        with pytest.raises(ParameterError, match="expected at least"):
            wrong.execute()
