"""docs/tutorial.md, walked from its first command to its last."""

import re
from pathlib import Path

import pytest

from dtwin.cli import main
from iec61499.runtime.kept.folder import kept_folder
from tests.support.desk import Desk
from tests.support.pages.blocks import blocks, words_of

PAGE = "docs/tutorial.md"
BLOCKS = [block for block in blocks() if block.page == PAGE]
FOUND = {"monitor broken.parquet --model arm"}
"""What ends with status 1, because there is a finding."""
SHORT = {"watch events": ("--count", "1")}
"""What would go on until Ctrl-C."""


def judged(history: str) -> str | None:
    """The history once the trial is over, whatever came of it."""
    return history if "confirm" in history or "roll back" in history else None


def test_the_tutorial_ends_with_a_recovered_arm(
    desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = kept_folder()  # of machine code, which is not made again for a home that is empty
    monkeypatch.setenv("DTWIN_CACHE_DIR", str(kept))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    printed: dict[str, str] = {}
    for line in (line for block in BLOCKS if block.language == "sh" for line in block.lines):
        words = words_of(line)[1:]
        name = " ".join(words)
        if words[:2] == ["identify", "live"]:
            desk.until_worked(lambda: "joint 2 failed" in desk.summary()["verdict"], "the fault is found", 90.0)
        if words[:2] == ["monitor", "acknowledge"]:
            history = desk.until_worked(lambda: judged(desk.run("history")), "the trial is over", 90.0)
            assert "confirm" in history
            assert "tracking was as predicted" in history
        if name in FOUND:
            assert main(words) == 1
            printed[name] = capsys.readouterr().out
        else:
            printed[name] = desk.run(*words, *SHORT.get(name, ()))
    (shown,) = (block for block in BLOCKS if block.language == "text")
    runs = [text for name, text in printed.items() if name.startswith("run --noise")]
    assert set(shown.lines) <= {line for text in runs for line in text.splitlines()}
    assert "friction of joint 2, +0.03" in printed["monitor broken.parquet --model arm"]
    (live,) = (text for name, text in printed.items() if name.startswith("identify live"))
    assert [float(value) for value in re.findall(r"D2 \W+(0\.\d+) ", live)] == [pytest.approx(0.08, rel=0.02)]
    assert re.search(r"joint 2 +nominal", printed["monitor acknowledge D2"])
