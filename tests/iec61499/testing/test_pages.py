"""The tests of blocks on pages of the documentation, as they stand there; and those of the project's own library."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from iec61499.lint.settings import read_settings

ROOT = Path(__file__).resolve().parents[3]


def test_the_tests_of_the_page_pass(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "block-tools.md").read_text()
    for number, text in enumerate(re.findall(r"```python\n(.*?)```", page, re.DOTALL)):
        (tmp_path / f"test_page_{number}.py").write_text(text)
    (tmp_path / "EVENT_COUNTER.fbt").write_bytes((ROOT / "fb" / "EVENT_COUNTER.fbt").read_bytes())
    assert "2 passed" in run_in(tmp_path, "test_page_0.py")


def test_the_first_block_of_the_page_passes_its_tests_and_is_checked(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "first-block.md").read_text()
    for name, language in (("BLINK.fbt", "xml"), ("test_blink.py", "python")):
        (text,) = re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)
        (tmp_path / name).write_text(text)
    assert "2 passed" in run_in(tmp_path)
    command = [sys.executable, "-m", "dtwin", "fb", "check", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, "problems: 0" in done.stdout) == (0, True)


def test_the_settings_of_the_page_are_read(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "block-tools.md").read_text(), re.DOTALL)
    (tmp_path / "fb.toml").write_text(text)
    settings = read_settings(tmp_path / "fb.toml")
    assert settings.rules == {"never-read": "warning", "unused-input": "off"}
    assert [allowed.rule for allowed in settings.allow] == ["event-loop"]


def test_the_sequences_of_the_cell_execute_every_state_and_line_of_their_types(tmp_path: Path) -> None:
    said = run_in(tmp_path, "--coverage", str(ROOT / "fb"))
    assert "failed" not in said
    total = re.search(r"^all +states (\d+)/(\d+)  transitions \d+/\d+  lines (\d+)/(\d+)$", said, re.MULTILINE)
    assert total is not None
    assert (total[1], total[3]) == (total[2], total[4])
    assert int(total[3]) > 40


def run_in(folder: Path, *words: str) -> str:
    """What `fb test` says in a folder; it must pass."""
    command = [sys.executable, "-m", "dtwin", "fb", "test", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
