"""A cell file with another arm, and the same from Python; what does not know other arms says so."""

import json
import re
from pathlib import Path

import pytest

import dtwin
from dtwin.cli import main
from dtwin.errors import DtwinError

POSES = "poses = [[0.1, 0.2], [0.6, -0.4]]\n"
CELL = 'arm = "planar-2r"\nmachine = "5"\nposes = "poses.toml"\nlate = 1\n'


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    (tmp_path / "poses.toml").write_text(POSES)
    (tmp_path / "cell.toml").write_text(CELL)
    return tmp_path / "cell.toml"


def score(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, object]:
    assert main(["run", *words, "--duration", "5", "--json"]) == 0
    figures: dict[str, object] = json.loads(capsys.readouterr().out)
    del figures["wall_seconds"]
    return figures


def test_a_cell_file_says_what_options_say(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    poses = str(cell.parent / "poses.toml")
    options = score(capsys, "--arm", "planar-2r", "--machine", "5", "--late", "1", "--poses", poses)
    assert score(capsys, "--cell-file", str(cell)) == options
    ran = dtwin.run_arm("planar-2r", 5.0, machine="5", poses=poses, late=1)
    assert ran.score()["tracking_error_max"] == options["tracking_error_max"]
    assert ran.measurement().joints == ("shoulder", "elbow")
    other = score(capsys, "--cell-file", str(cell), "--machine", "ideal")
    assert other["machine"] == "ideal"
    assert other["tracking_error_max"] != options["tracking_error_max"]


@pytest.mark.parametrize("arm", ["six-axis", "planar-2r"])
def test_the_blocks_of_an_ideal_machine_know_that_it_has_no_dry_friction(arm: str) -> None:
    errors = {m: dtwin.run_arm(arm, 10.0, machine=m).score()["tracking_error_max"] for m in ("ideal", "nominal")}
    assert max(errors["ideal"]) < 5e-4  # rad, within which a tick and the observer leave it
    assert max(errors["ideal"]) < max(errors["nominal"])


@pytest.mark.parametrize("words", [["cell", "check"], ["simulate"]])
def test_what_knows_the_arm_of_the_thesis_alone_says_so(
    words: list[str], cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(cell)] if words[0] == "cell" else ["--cell-file", str(cell)]
    assert main([*words, *given]) != 0
    told = capsys.readouterr().err
    assert "cell.toml: arm: 'planar-2r' is another arm than the thesis's" in told
    assert "dtwin run --cell-file" in told


@pytest.mark.parametrize("command", ["validate", "bench"])
def test_other_arms_are_refused_with_what_knows_them(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--arm", "six-axis"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "--arm, six-axis: this knows the arm of the thesis alone: expected `dtwin run`" in told


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (CELL + 'law = "cascade"', "expected the cell of another arm, with the keys arm, machine, .*`law`"),
        (CELL.replace("planar-2r", "no-arm"), "arm 'no-arm': expected a file"),
        (CELL.replace("late = 1", "late = 11"), "late: expected 0 to 10 ticks, got 11"),
        (CELL + 'sort = "poses.toml"', "sort, poses and path: expected one of them"),
        (CELL.replace('"5"', '"fifth"'), "machine 'fifth': expected ideal, nominal"),
    ],
)
def test_wrong_cells_say_what_was_expected(
    text: str, words: str, cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell.write_text(text)
    assert main(["run", "--cell-file", str(cell), "--duration", "1"]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert re.search(words, told), told


def test_python_refuses_what_no_arm_is() -> None:
    with pytest.raises(DtwinError, match="arm 'no-arm'"):
        dtwin.run_arm("no-arm")
