"""What all experiments share: the report and the frame of the commands."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest
from lxml import html
from rich.console import Console

from dtwin.campaign.spread import Progress
from dtwin.errors import ParameterError, RecordingError
from dtwin.pictures import new_figure
from evidence.experiment import OnMachine, Page, SeriesCommand
from evidence.report import Picture, Report, ensure_folder, page, table, versions


def report() -> Report:
    return page(
        "A title", "Words.", table(["a", "b"], [["1", "2"]]), Picture(new_figure(2, 2), "A picture of <nothing>.")
    )


def test_a_report_is_one_page_with_its_figures_in_it(tmp_path: Path) -> None:
    path = report().write(tmp_path / "new" / "folder", "Seed 1.")
    assert [file.name for file in path.parent.iterdir()] == ["report.html"]
    found = html.parse(str(path)).getroot()
    assert found.findtext(".//h1") == "A title"
    assert [" ".join(each.text_content().split()) for each in found.xpath("//tr")] == ["a b", "1 2"]
    (figure,) = found.xpath("//figure")
    assert len(figure.xpath("./svg")) == 1
    assert figure.findtext("./figcaption") == "A picture of <nothing>."
    assert [each.text_content() for each in found.xpath("//p")] == ["Words.", "Seed 1."]
    assert not found.xpath("//@src | //script | //link")
    assert path.read_text() == report().page("Seed 1."), "equal reports are equal bytes"
    assert report().text == "# A title\n\nWords.\n\n| a | b |\n| ---: | ---: |\n| 1 | 2 |\n"


def test_numbers_stand_at_the_right_of_their_column() -> None:
    made = table(["name", "off", "found", "none"], [["K2", "-1.5 %", "3", ""], ["cut1", "", "-", ""]])
    assert made.splitlines()[1] == "| :--- | ---: | ---: | :--- |"


def test_markup_in_what_is_told_is_shown_and_not_obeyed() -> None:
    told = "<script>alert(1)</script>"
    text = page(told, told, f"## {told}", table(["a"], [[told]]), Picture(new_figure(2, 2), told)).page(told)
    assert html.document_fromstring(text).xpath("//script") == []
    assert text.count("&lt;script&gt;") == 7  # the title counts twice


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
    assert (found["sum"], found["report"]) == (6, "experiment-sums/report.html")
    written = Path("experiment-sums/report.html").read_text()
    assert "<p>It is 6.</p>" in written
    assert "dtwin experiment sums with seed 0" in written
    assert versions() in html.document_fromstring(written).text_content()
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
