"""Commands for other arms than the thesis's, on small logs that are drawn."""

import json
from pathlib import Path

import pytest

from dtwin.cli import main
from tests.commands.test_cli import complain
from tests.measurements.test_doors import lerobot
from tests.support.chains import csv_of, drawn_arm, measured
from tests.support.pages.blocks import blocks

ARM = ["--arm", "drawn.urdf"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the description of an arm and two logs, the second with a load of 1.5 kg."""
    arm = drawn_arm(tmp_path, 2, 11)
    for name, seed, load in (("empty", 1, 0.0), ("full", 2, 1.5)):
        rows = csv_of(measured(arm, 15.0, seed, load=load))
        (tmp_path / f"{name}.csv").write_text("\n".join(",".join(row) for row in rows))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_another_arm_is_identified_from_its_logs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--also", "full.csv", "--load", "full.csv=?", "--out", "found.toml", "--urdf", "found.urdf", "--json"]
    assert main(["identify", "empty.csv", "--arm", "drawn.urdf", *words]) == 0
    found = json.loads(capsys.readouterr().out)
    load = found["numbers"]["load full m"]
    assert abs(load["value"] - 1.5) < load["half"] + 0.02
    assert (folder / "found.toml").is_file()
    assert (folder / "found.urdf").is_file()


def test_what_was_found_is_an_arm_that_other_commands_take(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--mjcf", "found.xml", "--arm-out", "mine.toml"]
    assert main(["identify", "empty.csv", "--arm", "drawn.urdf", *words]) == 0
    capsys.readouterr()
    assert main(["arm", "show", "mine.toml"]) == 0
    assert "mine: 2 joints" in capsys.readouterr().out
    for name in ("mine.toml", "found.xml"):
        assert main(["identify", "empty.csv", "--arm", name, "--also", "full.csv", "--load", "full.csv=?"]) == 0
    capsys.readouterr()
    before = (folder / "drawn.urdf").read_text()
    said = complain(capsys, "identify", "empty.csv", "--arm", "drawn.urdf", "--arm-out", "drawn.toml")
    assert "--arm-out: expected another name than that of the arm's model" in said
    assert (folder / "drawn.urdf").read_text() == before


def test_a_log_is_shown_with_its_map_and_its_page(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--map", "map.toml", "--page", "page.html"]
    assert main(["log", "show", "empty.csv", "--arm", "drawn.urdf", *words]) == 0
    assert "nothing is odd" in capsys.readouterr().out
    assert "<table>" in (folder / "page.html").read_text()
    assert main(["log", "show", "empty.csv", "--columns", "map.toml", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["odd"] == []


def test_a_folder_of_logs_is_a_benchmark(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = (
        'arm = "drawn.urdf"\ntrain = ["empty.csv", "full.csv"]\ntest = ["other.csv"]\nload = { "full.csv" = 0.0 }\n'
    )
    rows = csv_of(measured(drawn_arm(folder, 2, 11), 12.0, 9))
    (folder / "other.csv").write_text("\n".join(",".join(row) for row in rows))
    (folder / "benchmark.toml").write_text(plan + 'truth = { "full.csv" = 1.5 }\n')
    assert main(["experiment", "real", ".", "--out", "out", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert max(found["ratios"]) < 1.0
    assert abs(found["loads"][0]["found"] - found["loads"][0]["truth"]) < found["loads"][0]["half"] + 0.02
    report = (folder / "out" / "report.html").read_text()
    assert "Real logs" in report
    assert "figaroh" in report  # its figures, or how to get it
    asked = found["tested"][0]["figaroh"]
    assert len(asked) == (2 if "not installed" not in found["figaroh"] else 0)
    (folder / "benchmark.toml").write_text(plan.replace("train", "trains"))
    assert "benchmark.toml: expected a benchmark" in complain(capsys, "experiment", "real", ".")


def test_the_health_of_a_data_set_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["health", str(lerobot(tmp_path / "set"))]) == 0
    assert "without currents" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["identify", *ARM], "--arm: expected a log"),
        (["identify", "empty.csv", "--arm", "missing.urdf"], "missing.urdf: cannot be read"),
        (
            ["identify", "empty.csv", *ARM, "--load", "full.csv=1"],
            "--load 'full.csv=1': expected FILE=KG",
        ),
        (
            ["identify", "empty.csv", *ARM, "--load", "empty.csv=x"],
            "expected a mass above 0 kg, or ?",
        ),
        (["log", "show", "missing.csv"], "missing.csv: there is no such file or folder"),
        (["health", "empty.csv"], "expected columns of commanded positions"),
    ],
)
def test_mistakes_get_one_line(folder: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said in complain(capsys, *words)


def test_a_log_is_held_against_any_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(tmp_path / "run.parquet")
    assert main(["run", "--arm", "planar-2r", "--duration", "3", "--log", log]) == 0
    assert main(["log", "show", log, "--arm", "planar-2r"]) == 0
    assert "elbow" in capsys.readouterr().out
    assert main(["log", "show", log, "--arm", "six-axis"]) == 2
    assert "expected 6 columns of positions, one for each joint" in capsys.readouterr().err


def test_the_readmes_commands_for_a_foreign_log_run_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All after the installation, which needs an index: a page of what is in the data set, then its health."""
    lines = [
        line for block in blocks() if block.page == "README.md" and block.language == "sh" for line in block.lines
    ]
    first = next(k for k, line in enumerate(lines) if line.startswith("pip install"))
    commands = [line.partition(" #")[0].split() for line in lines[first + 1 : first + 3]]
    assert [words[:-1] for words in commands] == [["dtwin", "log", "show"], ["dtwin", "health"]]
    lerobot(tmp_path / commands[0][-1])
    monkeypatch.chdir(tmp_path)
    said = []
    for words in commands:
        assert main(words[1:]) == 0
        said.append(capsys.readouterr().out)
    assert "2 episodes" in said[0]
    assert "[command]" in said[0]
    assert "without currents" in said[1]
