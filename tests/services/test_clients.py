"""The program in C of docs/clients.md, compiled as the page says, at a cell that is up."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from dtwin.parameters import ROOT
from tests.support.desk import Desk

PAGE = (ROOT / "docs" / "clients.md").read_text()


def missing() -> str:
    """What keeps the program from being compiled, and what to do; empty for nothing."""
    programs = [name for name in ("cc", "pkg-config") if shutil.which(name) is None]
    if programs:
        return f"needs {' and '.join(programs)}"
    if subprocess.run(["pkg-config", "--exists", "zenohpico"]).returncode:
        return "needs zenoh-pico: build it as docs/clients.md says and put its lib/pkgconfig into PKG_CONFIG_PATH"
    return ""


@pytest.mark.skipif(bool(missing()), reason=missing())
def test_a_program_in_c_joins(desk: Desk, tmp_path: Path) -> None:
    program = re.search(r"```c\n(.*?)```", PAGE, re.DOTALL)
    command = re.search(r"^cc .*$", PAGE, re.MULTILINE)
    assert program is not None
    assert command is not None
    (tmp_path / "client.c").write_text(program[1])
    built = subprocess.run(["sh", "-c", command[0]], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert built.returncode == 0, built.stderr
    endpoint = desk.detach().partition("connects to ")[2].partition(",")[0]
    done = subprocess.run([tmp_path / "client", endpoint], capture_output=True, text=True, timeout=60)
    samples = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(samples) == 100, done.stderr
    numbers = [sample["sequence"] for sample in samples]
    assert numbers == sorted(set(numbers))
    assert all(len(sample["theta"]) == 3 for sample in samples)
    desk.run("down")
    nobody = subprocess.run([tmp_path / "client", endpoint], capture_output=True, text=True, timeout=60)
    assert nobody.returncode == 1
    assert "no cell there" in nobody.stderr
