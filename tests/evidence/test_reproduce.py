"""The thesis's evaluation in one go: what is kept, what goes on, and the page and print that come of it."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.campaign.spread import Progress
from dtwin.pictures import new_figure
from evidence.report import Picture
from evidence.reproduce.book import PAGE, PARTS, PRINT, make, write
from evidence.reproduce.chapter import POINTS, Chapter, Line, Part, Scope, curve
from evidence.reproduce.fits import DIFFERENCE
from evidence.reproduce.parameters import EIGHTEEN, thesis_settings
from evidence.reproduce.verification import VERIFICATION

SCOPE = Scope(quick=True, seed=5)


class Counted:
    """A part that counts how often it is measured, and takes another time on every machine."""

    def __init__(self, name: str) -> None:
        self.times = 0
        self.part = Part(name, f"Part {name}", self.measure, self.tell, ("seconds",))

    def measure(self, scope: Scope, progress: Progress) -> dict[str, Any]:
        self.times += 1
        return {"runs": scope.runs(20, 3), "seed": scope.seed, "seconds": 0.1 * self.times}

    def tell(self, numbers: Mapping[str, Any]) -> Chapter:
        figure = new_figure(4, 3)
        figure.subplots().plot([0, numbers["runs"]])
        line = Line("5.1", "runs", "20", str(numbers["runs"]))
        return Chapter("A test.", [line], "Nothing <but> this.", "Nothing.", [Picture(figure, "A line.")])


def test_what_is_done_is_not_measured_again(tmp_path: Path) -> None:
    first, second = Counted("first"), Counted("second")
    make(tmp_path, SCOPE, [first.part])  # as if it had been interrupted there
    told = []

    def begin(part: Part, done: bool) -> Progress:
        told.append((part.name, done))
        return lambda done, of: None

    found = make(tmp_path, SCOPE, [first.part, second.part], begin)
    assert told == [("first", True), ("second", False)]
    assert (first.times, second.times) == (1, 1)
    assert found["first"] == {"runs": 3, "seed": 5, "seconds": 0.1}


def test_another_scope_or_a_damaged_file_is_measured_anew(tmp_path: Path) -> None:
    counted = Counted("first")
    for scope in (SCOPE, replace(SCOPE, seed=6), replace(SCOPE, quick=False)):
        make(tmp_path, scope, [counted.part])
    assert counted.times == 3
    for name in ("first.json", "first.machine.json"):
        (tmp_path / "numbers" / name).write_text("{")
        make(tmp_path, replace(SCOPE, quick=False), [counted.part])
    assert counted.times == 5


def test_what_depends_on_the_machine_is_kept_apart(tmp_path: Path) -> None:
    contents = []
    counted = Counted("first")
    for folder in (tmp_path / "one", tmp_path / "other"):
        make(folder, SCOPE, [counted.part])
        contents.append([(folder / "numbers" / name).read_bytes() for name in ("first.json", "first.machine.json")])
    assert contents[0][0] == contents[1][0]
    assert contents[0][1] != contents[1][1]
    assert json.loads(contents[0][0])["key"]["seed"] == 5


def test_page_and_print_are_whole_and_the_same_every_time(tmp_path: Path) -> None:
    counted = Counted("first")
    written = []
    for _ in range(2):
        numbers = make(tmp_path, SCOPE, [counted.part])
        page = write(tmp_path, SCOPE, numbers, [counted.part])
        written.append((page.read_bytes(), (tmp_path / PRINT).read_bytes()))
    assert written[0] == written[1]
    text = written[0][0].decode()
    assert page == tmp_path / PAGE
    assert "Nothing &lt;but&gt; this." in text
    assert "<td>20</td><td>3</td>" in text
    assert text.count("<svg") == text.count("<figcaption>A line.") == 1
    assert not re.search(r"(src|href)=\"(?!#)", text)
    assert written[0][1].startswith(b"%PDF")
    assert {path.name for path in tmp_path.iterdir()} == {PAGE, PRINT, "numbers"}


def test_every_figure_of_the_evaluation_has_its_part() -> None:
    found: set[tuple[int, int]] = set()
    for part in PARTS:
        for first, last in re.findall(r"(\d+\.\d+)(?: to (\d+\.\d+))?", part.title):
            chapter, low = map(int, first.split("."))
            high = int(last.split(".")[1]) if last else low
            found |= {(chapter, number) for number in range(low, high + 1)}
    assert found == {(4, n) for n in range(7, 11)} | {(5, n) for n in range(1, 18)}


def test_the_verification_is_told_beside_the_thesis(tmp_path: Path) -> None:
    numbers = make(tmp_path, SCOPE, [VERIFICATION])["verification"]
    told = {line.what: (line.thesis, line.ours) for line in VERIFICATION.tell(numbers).lines}
    assert told["drop: least angle of link 1"] == ("-2.3422 rad at 0.67 s", "-2.3422 rad at 0.67 s")
    assert told["masses x 1.5: least angle of link 1"][1] == "-2.4867 rad, 6.2 % farther"
    assert all(case["passed"] for case in numbers.values())


def test_the_thesis_fits_eighteen_parameters_without_offsets() -> None:
    settings = thesis_settings()
    assert settings.free == EIGHTEEN
    assert len(EIGHTEEN) == 18
    assert not settings.offsets
    alone = thesis_settings(("mu1", "mu2", "mu3"), without=("D",))
    assert alone.known.damping == (0.0, 0.0, 0.0)
    assert alone.known.coulomb == (0.01, 0.01, 0.01)
    assert len(alone.free) == 18


def test_the_difference_of_the_thesis_is_of_sixth_order() -> None:
    t = np.arange(7.0)
    for power in range(7):
        assert DIFFERENCE @ t**power == pytest.approx(float(power == 1), abs=1e-9)


def test_curves_keep_their_ends_small() -> None:
    time = np.arange(5000.0)
    kept = curve(time, np.sin(time))
    assert len(kept) == 2
    assert len(kept[0]) <= POINTS
    assert kept[0][0] == 0.0
