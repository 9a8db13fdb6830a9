"""docs/cells.md, walked with what the page says and nothing else."""

import io
import re
import shlex
import shutil
import subprocess
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from dtwin.cli import main
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log
from dtwin.parameters import ROOT
from dtwin.run.cell_file import _KEYS, _SECTIONS, _Boxes, _Control, _Noise, _Stand

PAGE = (ROOT / "docs" / "cells.md").read_text()


def listings(language: str, after: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.partition(after)[2], re.DOTALL)


def carry_out(line: str) -> None:
    """Carries a line of the page out: a command of dtwin in this process, which has loaded all, others in a shell."""
    command, _, otherwise = line.partition("||")
    program, *words = shlex.split(command, comments=True)
    if program != "scripts/dtwin":
        subprocess.run(["bash", "-c", line], check=True, timeout=60)
    elif status := main(words):
        assert otherwise, f"{line}: {status}"
        print(shlex.split(otherwise, comments=True)[1])


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder in which all listings of the page were carried out in order, and what was printed."""
    folder = tmp_path_factory.mktemp("cells")
    shutil.copytree(ROOT / "fb", folder / "blocks")
    (cell,), (block,) = listings("toml", "## Another cell"), listings("xml", "## Another block")
    (folder / "mine.toml").write_text(cell)
    (folder / "blocks" / "GENTLE.fbt").write_text(block)
    script = "".join(listings("sh", "# Cells")).replace("dtwin run ", "dtwin run --duration 60 ")
    script = script.replace("60 --cell-file four-colours", "10 --cell-file four-colours")  # nobody looks at its log
    said = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said), redirect_stderr(said):
        patch.chdir(folder)
        for line in script.splitlines():
            carry_out(line)
    return folder, said.getvalue()


@pytest.fixture(scope="module")
def mine(walked: tuple[Path, str]) -> Log:
    return read_log(walked[0] / "mine.parquet")


def test_the_cell_of_the_page_sorts(mine: Log) -> None:
    kinds = [event.kind for event in mine.events]
    assert kinds.count("delivered") >= 5
    assert "misplaced" not in kinds
    assert set(mine.columns["box_colour"]) == {"", "orange", "blue"}


def test_a_place_out_of_reach_is_refused(walked: tuple[Path, str]) -> None:
    assert re.search(r"far\.toml: places\.orange: the arm does not reach the place: ", walked[1])
    assert "refused" in walked[1].splitlines()


def test_the_faults_of_the_page_happen_and_are_found(walked: tuple[Path, str]) -> None:
    events = [event.text for event in read_log(walked[0] / "worn.parquet").events if event.kind == "fault"]
    assert events == ["K2*=0.5@20 began", "bias1+=0.01@30 began".replace("@30", "@30-40"), "bias1+=0.01@30-40 ended"]
    assert re.search(r"voltage constant.*joint 2|K2", walked[1])


def test_the_block_of_the_page_acts(walked: tuple[Path, str], mine: Log) -> None:
    gentle = read_log(walked[0] / "gentle.parquet").columns["volts_4"]
    assert set(np.abs(mine.columns["volts_4"])) == {3.0}
    assert set(np.abs(gentle)) == {2.0}


def test_the_page_names_every_key() -> None:
    named = set(re.findall(r"`(\w+)`", PAGE.partition("| section |")[2].partition("\n\n")[0]))
    fields = {name for kind in (_Stand, _Boxes, _Control, _Noise) for name in kind.__struct_fields__}
    assert fields | (set(_KEYS) - set(_SECTIONS)) <= named
    assert all(f"[{section}" in PAGE for section in _SECTIONS)
