"""What all experiments share: the report and the frame of the commands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest
from rich.console import Console

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import OnMachine, Page, SeriesCommand
from dtwin.errors import ParameterError, RecordingError
from dtwin.experiments.report import Picture, Report, ensure_folder, page, table
from dtwin.pictures import new_figure


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


@pytest.mark.parametrize(
    ("machine", "title"),
    [("ideal", "A title"), ("servo", "A title, machine servo"), ("17", "A title, machine 17")],
)
def test_the_title_names_the_machine(machine: str, title: str) -> None:
    assert OnMachine(machine=machine).titled(report()).title == title


def test_nothing_of_a_page_is_cut_on_a_narrow_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    heads = [f"measure_of_{number}" for number in range(8)]
    text = page("A title", table(heads, [[f"{number}.123456789" for number in range(8)]])).text
    Console(width=60).print(Page(text))
    shown = capsys.readouterr().out
    assert "\u2026" not in shown
    columns = [line for line in shown.splitlines() if line.strip()]
    assert max(map(len, columns)) <= 60
    assert sum(line.count("9") for line in columns) == 8
