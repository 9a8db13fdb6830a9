"""docs/arms.md, walked with what the page says and nothing else."""

import io
import re
import shlex
import subprocess
import sys
from contextlib import ExitStack, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.arm import sorting
from dtwin.arm.file import _JOINT, _TOLERANCES, _TOP
from dtwin.arm.urdf import read_urdf
from dtwin.cli import main
from dtwin.parameters import ROOT

PAGE = (ROOT / "docs" / "arms.md").read_text()
FILES = {
    "xml": ("mine.urdf",),
    "toml": ("mine.toml", "poses.toml", "sort.toml", "cell.toml", "worn.toml"),
    "csv": ("path.csv",),
}


def status(words: list[str]) -> int:
    """The exit status of a command; a film is made by a process that chooses its own OpenGL, if there is one."""
    if words[0] != "film":
        return main(words)
    done = subprocess.run([sys.executable, "-m", "dtwin", *words], capture_output=True, text=True, check=False)
    return 0 if "no OpenGL" in done.stderr else done.returncode


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder in which all blocks of the page were carried out in order, and what was printed."""
    folder = tmp_path_factory.mktemp("arms")
    for name in ("six-axis", "blocks", "joints"):
        (folder / name).mkdir()
    waiting = {language: list(names) for language, names in FILES.items()}
    printed = io.StringIO()
    with (
        TemporaryDirectory() as runtime,
        pytest.MonkeyPatch.context() as patch,
        redirect_stdout(printed),
        ExitStack() as afterwards,
    ):
        patch.chdir(folder)
        patch.setenv("XDG_RUNTIME_DIR", runtime)  # its path is short, and no other cell is up there
        afterwards.callback(main, ["down"])  # a walk that ends in between leaves no cell behind
        for language, text in re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL):
            if language in waiting:
                (folder / waiting[language].pop(0)).write_text(text)
            elif language == "sh":
                short = re.sub(r"--duration \d+(?!.*--fault|.*healthy\.parquet)", "--duration 10", text)
                short = short.replace("--candidates 24", "--candidates 24 --arms 0").replace("--end 4", "--end 1")
                for line in short.replace("excite mine.toml", "excite mine.toml --candidates 2").splitlines():
                    program, *words = shlex.split(line, comments=True)
                    patch.setattr(sys, "argv", ["dtwin", *words])  # of which a cell in the background is made
                    found = int(words[0] == "monitor")
                    assert (program, status(words)) == ("scripts/dtwin", found), (
                        f"{line}\n{printed.getvalue()[-999:]}"
                    )
    assert not any(waiting.values())
    return folder, printed.getvalue()


def test_the_page_leads_from_a_urdf_to_an_identified_arm(walked: tuple[Path, str]) -> None:
    folder, printed = walked
    assert "add joints.turn.acceleration" in printed
    assert "it can be driven" in printed
    assert re.search(r"boxes .* [1-9] delivered, ([1-9]) of them within 5 mm, 0 missed", printed)
    assert re.search(r"turn +0\.0\d+ rad off its path at most", printed)
    found = msgspec.toml.decode((folder / "found.toml").read_bytes())
    assert found
    before, after = read_urdf(folder / "mine.urdf"), read_urdf(folder / "found.urdf")
    assert [link.name for link in after.links] == [link.name for link in before.links]
    assert not np.allclose(before.parameters, after.parameters)


def test_the_services_log_what_the_run_of_the_page_does(walked: tuple[Path, str]) -> None:
    table = pq.read_table(walked[0] / "served.parquet")
    assert len(table) == 1000
    assert {"q_3", "target_3", "sent_3", "current_3"} <= set(table.schema.names)


def test_the_fault_of_the_page_is_named(walked: tuple[Path, str]) -> None:
    assert re.search(r"7\d\.\d+ s: drive of lift: part of its torque lost", walked[1])


def test_the_blocks_of_the_page_are_there(walked: tuple[Path, str]) -> None:
    folder, printed = walked
    assert "problems: 0" in printed
    assert (folder / "boot" / "FORTE_PC.fboot").stat().st_size > 10_000
    assert (folder / "six-axis" / "six-axis.sys").exists()


def test_the_page_names_all_keys() -> None:
    shown = re.findall(r"```toml\n(.*?)```|`([^`\n]+)`", PAGE, re.DOTALL)
    code = " ".join(block + word for block, word in shown)
    for key in (*_TOP, *_JOINT, *_TOLERANCES, "commanded", "payload", *sorting._KEYS):
        assert re.search(rf"\b{key}\b", code), key
