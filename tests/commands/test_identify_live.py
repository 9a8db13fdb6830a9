"""`dtwin identify live` where nobody can be asked whether to keep the model."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from dtwin.bus.messages import DECIDE
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import IdentificationDecision, IdentificationState
from dtwin.cli import main
from dtwin.commands.identification import live


class _Service:
    """An identification service that has found a model at once, and keeps what is accepted."""

    def __init__(self) -> None:
        self.decided: list[bool] = []

    def ask(self, topic: Topic, request: Any, reply: type) -> IdentificationState:
        if topic != DECIDE:
            return IdentificationState("proposed", "All free parameters are determined.")
        assert isinstance(request, IdentificationDecision)
        self.decided.append(request.accept)
        return IdentificationState("accepted" if request.accept else "rejected", "")


@pytest.mark.parametrize(("options", "kept"), [([], False), (["--accept"], True)])
def test_a_model_that_nobody_is_asked_about_is_kept_by_an_option_only_and_the_command_says_so(
    options: list[str], kept: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = _Service()

    @contextlib.contextmanager
    def join(*where: object) -> Iterator[_Service]:
        yield service

    monkeypatch.setattr(live, "join", join)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    assert main(["identify", "live", *options]) == (0 if kept else 1)
    assert service.decided == [kept]
    assert ("--accept keeps it" in capsys.readouterr().out) is not kept
