"""Preparation in a process of its own: it is told, it ends with the service, and its failure does not end it."""

import logging
from pathlib import Path
from typing import Any

import pytest

from dtwin.services.parts.readiness.aside import prepare_aside
from dtwin.services.supervisor import PREPARED


class Frame:
    """A service's frame as far as a preparation needs it.

    Args:
        patience: number of looks after which it is asked to end.
    """

    def __init__(self, patience: float = float("inf")) -> None:
        self.doing = ""
        self.told: list[str] = []
        self._patience = patience

    @property
    def stopping(self) -> bool:
        return len(self.told) >= self._patience

    def pause(self) -> None:
        self.told.append(self.doing)


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Writes the module `work` and returns its name."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def written(text: str) -> str:
        (tmp_path / "work.py").write_text(text)
        return "work"

    return written


def test_what_is_compiled_is_counted_while_it_goes_on(module: Any, tmp_path: Path) -> None:
    go = tmp_path / "go"
    work = module(f"import os\nprint('first', flush=True)\nwhile not os.path.exists({str(go)!r}): pass\n")

    class Waiting(Frame):
        def pause(self) -> None:
            super().pause()
            if self.doing.endswith(": 1"):
                go.touch()

    frame: Any = Waiting()
    prepare_aside(frame, "the fits", work)
    assert "prepares the fits; kernels compiled: 1" in frame.told
    assert frame.doing == ""


def test_a_failure_is_told_with_its_last_line(module: Any, caplog: pytest.LogCaptureFixture) -> None:
    frame: Any = Frame()
    with caplog.at_level(logging.WARNING):
        prepare_aside(frame, "the fits", module("raise MemoryError('no memory left')"))
    assert "the fits could not be prepared" in caplog.text
    assert "no memory left" in caplog.text


def test_a_service_that_is_asked_to_end_does_not_wait(module: Any, caplog: pytest.LogCaptureFixture) -> None:
    frame: Any = Frame(patience=3)
    prepare_aside(frame, "the fits", module("while True: pass"))
    assert len(frame.told) == 3
    assert not caplog.text


def test_a_service_that_starts_again_need_not_prepare(module: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PREPARED, "1")
    frame: Any = Frame()
    prepare_aside(frame, "the fits", module("raise SystemExit(1)"))
    assert not frame.told


def test_what_an_earlier_process_has_prepared_is_prepared_again_only_for_other_code(
    module: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "__pycache__").mkdir()
    count = f"with open({str(tmp_path / 'times')!r}, 'a') as times: times.write('.')\n"

    def times(text: str) -> int:
        frame: Any = Frame()
        prepare_aside(frame, "the fits", module(text))
        return len((tmp_path / "times").read_text())

    assert times(f"{count}raise SystemExit(1)") == 1
    assert times(count) == 2, "what has failed is not prepared"
    assert times(count.replace("'.'", "'.' ")) == 3, "another module"
    frame: Any = Frame()
    prepare_aside(frame, "the fits", "work")
    assert len((tmp_path / "times").read_text()) == 3
    assert not frame.told
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    prepare_aside(frame, "the fits", "work")
    assert len((tmp_path / "times").read_text()) == 4, "kernels are kept elsewhere"
