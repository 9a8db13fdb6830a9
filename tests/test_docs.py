"""The pages say what the code does."""

import re
import runpy
import sys
from pathlib import Path
from typing import Any

import pytest

from dtwin.emulation.faults import TARGETS
from dtwin.emulation.machine.sections import SECTIONS, declared
from dtwin.logs.log import COLUMNS, NEEDED
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.parameters import PICKUP, PLACES, ROOT, ArmParameters

README = (ROOT / "README.md").read_text()
MODEL = (ROOT / "docs" / "model.md").read_text()


def table_row(page: str, *first_cells: str) -> list[str]:
    """The cells of the table row that begins with the given ones."""
    for line in page.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split(" | ")]
        if cells[: len(first_cells)] == list(first_cells):
            return cells[len(first_cells) :]
    raise AssertionError(f"no row {first_cells}")


def test_data_sheet() -> None:
    arm = ArmParameters()
    rows = {}
    for line in MODEL.splitlines():
        cells = [cell.strip() for cell in line.strip("| ").split("|")]
        if len(cells) == 6 and cells[1] in ("K", "m", "I", "l", "c", "D", "mu"):
            rows[cells[1]] = [float(value) for value in cells[2:5]]
    assert len(rows) == 7
    for symbol, values in rows.items():
        assert values == pytest.approx([arm.get(f"{symbol}{joint}") for joint in (1, 2, 3)], rel=1e-8)


def test_places() -> None:
    for name, place in (("pickup", PICKUP), *PLACES.items()):
        assert [float(cell) for cell in table_row(MODEL, name)] == [place.x, place.y, *place.theta]


def test_faults_are_listed() -> None:
    for target in TARGETS:
        assert parse_fault_id(target).kind in MODEL


def test_columns_of_logs_are_listed_with_what_is_needed() -> None:
    listed, needed = set(), set()
    for cells in re.findall(
        r"^\| (`.*?) \|.*?\|.*?\| (yes)? *\|", (ROOT / "docs" / "logs.md").read_text(), re.MULTILINE
    ):
        first, *last = re.findall(r"`(\w+)`", cells[0])
        names = {f"{first[:-1]}{k}" for k in range(1, int(last[0][-1]) + 1)} if last else {first}
        listed |= names
        needed |= names if cells[1] else set()
    assert listed == set(COLUMNS)
    assert needed == set(NEEDED)


def test_every_effect_of_a_machine_is_explained() -> None:
    explained = set(re.findall(r"`(\w+)`", (ROOT / "docs" / "machine.md").read_text()))
    for section in SECTIONS.values():
        assert set(declared(section)) <= explained, section.__name__


PYTHON = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("code", PYTHON, ids=range(len(PYTHON)))
def test_the_python_of_the_readme_runs(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(compile(code, "README.md", "exec"), found)
    assert len([line for line in code.splitlines() if line.strip()]) <= 10
    assert {path.name for path in tmp_path.iterdir()} == {"run.png", "arm.png"}
    values, truth = found["arm"].values, found["run"].arm
    assert set(values) == {"K2", "K3", "c1", "c2", "c3", "D1", "D2", "D3"}
    assert values["K2"] == pytest.approx(truth.get("K2"), rel=0.02)
    assert "K2 = " in capsys.readouterr().out


EXAMPLES = {
    "run_and_plot": (16, {"run.png", "run.rrd", "run.parquet"}, "delivered"),
    "identify_a_machine": (20, {"identified.png", "arm.json"}, "doubts: none"),
    "find_a_fault": (25, {"finding.png", "finding.rrd"}, "voltage constant of joint 1, -"),
}
"""seconds of plant time, files that are written, and a part of what is said"""


def test_every_example_is_tried_and_listed() -> None:
    folder = ROOT / "examples"
    assert {path.stem for path in folder.glob("*.py")} == set(EXAMPLES)
    listing = (folder / "README.md").read_text()
    assert all(f"]({name}.py)" in listing for name in EXAMPLES)


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seconds, files, said = EXAMPLES[name]
    path = ROOT / "examples" / f"{name}.py"
    monkeypatch.setattr(sys, "argv", [str(path), str(seconds), str(tmp_path)])
    runpy.run_path(str(path))
    assert {path.name for path in tmp_path.iterdir()} == files
    assert said in capsys.readouterr().out
    assert path.read_text().startswith("# %% [markdown]\n# # ")
