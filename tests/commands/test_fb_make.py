"""`dtwin fb make` where its folder is not there, and where it cannot be."""

from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.commands.arm.making import TYPES


def test_the_folder_of_an_application_is_made(tmp_path: Path) -> None:
    out = tmp_path / "new" / "arm.sys"
    assert main(["fb", "make", "planar-2r", str(out)]) == 0
    assert {file.name for file in out.parent.iterdir()} >= {out.name, *(f"{name}.fbt" for name in TYPES)}


def test_a_folder_that_cannot_be_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "taken").write_text("")
    assert main(["fb", "make", "planar-2r", str(tmp_path / "taken" / "arm.sys")]) == 2
    assert "taken" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]
