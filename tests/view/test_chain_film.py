"""A log of any arm as a film: the arm stands where the log has it, and nothing else moves."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dtwin.cli import main

WIDTH, HEIGHT = 320, 180
_OTHER = 60
"""Difference of a colour that a palette does not make."""


def film(folder: Path) -> list[np.ndarray]:
    """The pictures at 0, 1.5 and 3 s of a planar arm that folds and stretches again."""
    t = np.arange(301) / 100.0
    swing = 1.0 - np.cos(2.0 * np.pi * t / 3.0)
    table = np.column_stack([t, 0.1 * swing, 1.2 * swing])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,q_1,q_2", comments="", fmt="%.9g")
    command = [
        sys.executable,
        "-m",
        "dtwin",
        "film",
        "log.csv",
        "film.gif",
        "--arm",
        "planar-2r",
        "--camera",
        "front",
    ]
    command += ["--width", str(WIDTH), "--height", str(HEIGHT), "--fps", "1", "--speed", "1.5", "--no-caption"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if "no OpenGL" in done.stderr:
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    pictures = []
    with Image.open(folder / "film.gif") as opened:
        for number in range(3):
            opened.seek(number)
            pictures.append(np.asarray(opened.convert("RGB")).astype(int))
    return pictures


def test_an_arm_is_drawn_where_its_log_has_it(tmp_path: Path) -> None:
    first, second, third = film(tmp_path)
    moved = np.abs(second - first).max(axis=2) > _OTHER
    assert moved.sum() > 100
    assert (np.abs(third - first).max(axis=2) > _OTHER).sum() < 10
    rows, columns = np.nonzero(moved)
    assert 0 < rows.min() <= rows.max() < HEIGHT - 1
    assert 0 < columns.min() <= columns.max() < WIDTH - 1


def test_what_cannot_be_filmed_of_an_arm_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.csv").write_text("t,q_1,q_2\n" + "".join(f"{k / 100},0.1,0.2\n" for k in range(200)))
    log, gif = str(tmp_path / "log.csv"), str(tmp_path / "film.gif")
    assert main(["film", log, gif, "--arm", "planar-2r", "--camera", "close"]) == 2
    assert "camera 'close': expected overview, front, side or top" in capsys.readouterr().err
    assert main(["film", log, gif, "--columns", "map.toml"]) == 2
    assert "--columns belongs to --arm" in capsys.readouterr().err
    assert not (tmp_path / "film.gif").exists()
