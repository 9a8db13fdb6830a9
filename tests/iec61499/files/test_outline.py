"""What files say in lines, and what differs between two of them."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from dtwin.cli import main
from iec61499.files.outline import difference, outline
from tests.support.iec61499.counter import HOLDS, write_counter

ROOT = Path(__file__).resolve().parents[3]


def changed(folder: Path, *replacements: tuple[str, str]) -> list[str]:
    """What differs when texts of a type are replaced."""
    before = write_counter(folder, HOLDS)
    after = folder / "AFTER.fbt"
    text = before.read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    after.write_text(text)
    return difference(outline(before), outline(after))


@pytest.mark.parametrize(
    ("old", "new", "lines"),
    [
        ('InitialValue="2"', 'InitialValue="3"', ["~ input PV: INT := 2 -> INT := 3"]),
        ('<With Var="R"/>', "", ["~ event input CU: with R, PV -> with PV"]),
        ('"CU[R]"', '"CU[NOT R]"', ["~ transition START -> RESET: CU[R] -> CU[NOT R]"]),
        ('<ECState Name="START"/>', '<ECState Name="START" x="7"/>', []),
        ('<VarDeclaration Name="Q" Type="BOOL"/>', "", ["- output Q: BOOL"]),
        (
            "Q := TRUE;",
            "Q := NOT R;",
            [
                "~ algorithm UP",
                "    @@ -2,3 +2,3 @@",
                "     IF CV >= PV THEN",
                "    -  Q := TRUE;",
                "    +  Q := NOT R;",
                "     ELSE",
            ],
        ),
    ],
)
def test_what_differs_is_told_in_words(tmp_path: Path, old: str, new: str, lines: list[str]) -> None:
    assert changed(tmp_path, (old, new)) == lines


def test_the_order_of_transitions_counts(tmp_path: Path) -> None:
    first = '<ECTransition Source="START" Destination="RESET" Condition="CU[R]"/>'
    second = '<ECTransition Source="START" Destination="COUNT" Condition="CU"/>'
    found = changed(tmp_path, (first, "FIRST"), (second, first), ("FIRST", second))
    assert found == ["~ order of transitions"]


def test_systems_and_projects_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROOT / "fb", tmp_path / "new")
    shutil.copytree(ROOT / "fb", tmp_path / "old")
    system = tmp_path / "new" / "motion.sys"
    text = system.read_text()
    system.write_text(text.replace('Name="T" Value="', 'Name="T" Value="9', 1))
    assert system.read_text() != text
    (tmp_path / "new" / "SAFE_STOP.fbt").unlink()
    assert main(["fb", "diff", str(tmp_path / "old"), str(tmp_path / "new")]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "- file SAFE_STOP.fbt"
    assert said[1] == "file motion.sys"
    assert said[2].startswith("~ parameter ")
    assert said[-1] == "files that differ: 2"
    assert main(["fb", "diff", str(tmp_path / "old"), str(ROOT / "fb")]) == 0


def test_it_is_the_text_view_of_git(tmp_path: Path) -> None:
    write_counter(tmp_path)
    view = f"{sys.executable} -m dtwin fb outline"

    def git(*words: str) -> str:
        command = [
            "git",
            "-c",
            "user.name=a",
            "-c",
            "user.email=a@example.org",
            "-c",
            f"diff.fb.textconv={view}",
            *words,
        ]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60).stdout

    (tmp_path / ".gitattributes").write_text("*.fbt diff=fb\n")
    git("init", "-q")
    git("add", ".")
    git("commit", "-q", "-m", "first")
    file = tmp_path / "COUNTER.fbt"
    file.write_text(
        file.read_text().replace('InitialValue="2"', 'InitialValue="3"').replace("<ECState ", '<ECState x="1" ')
    )
    said = [line for line in git("diff").splitlines() if line[:1] in "+-" and line[1:2] not in "+-"]
    assert said == ["-input PV: INT := 2", "+input PV: INT := 3"]
