"""`dtwin identify live` where nobody can be asked whether to keep the model."""

from __future__ import annotations

import contextlib
from typing import Any

import pytest

from dtwin.bus.twin_messages import IdentificationState
from dtwin.cli import main
from dtwin.commands.identification import live


class _Cell:
    """A running cell whose identification service finds a model at once, and keeps what is accepted."""

    def __init__(self) -> None:
        self.decided: list[bool] = []

    def identify(self, **asked: Any) -> IdentificationState:
        return IdentificationState("proposed", "All free parameters are determined.")

    def decide(self, accept: bool, **asked: Any) -> IdentificationState:
        self.decided.append(accept)
        return IdentificationState("accepted" if accept else "rejected", "")


@pytest.mark.parametrize(("options", "kept"), [([], False), (["--accept"], True)])
def test_a_model_that_nobody_is_asked_about_is_kept_by_an_option_only_and_the_command_says_so(
    options: list[str], kept: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = _Cell()
    monkeypatch.setattr(live, "connect", lambda *where, **how: contextlib.nullcontext(cell))
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert main(["identify", "live", *options]) == (0 if kept else 1)
    assert cell.decided == [kept]
    assert ("--accept keeps it" in capsys.readouterr().out) is not kept
