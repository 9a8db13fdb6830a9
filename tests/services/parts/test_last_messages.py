"""What is on its way when a recorder is asked to end."""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, cast

import pytest

from dtwin.bus.messages import State, Status
from dtwin.services.parts.missed.last_messages import LastMessages
from dtwin.services.service import Service


class Scripted:
    """A service into whose inbox comes what a script says; None is a time of silence.

    Attributes:
        bus: its bus, which is the script, too.
        told: receives the emulator's status, if anybody wants to know it.
    """

    def __init__(self, *script: object) -> None:
        self.bus = self
        self.told: Callable[[Status], None] | None = None
        self._script = deque(script)

    def subscribe(self, topic: object, message: type[Status], receive: Callable[[Status], None], part: str) -> None:
        assert part == "emulator"
        self.told = receive

    def next(self, timeout: float) -> Any:
        assert timeout > 0
        item = self._script.popleft()
        if isinstance(item, Status):
            assert self.told is not None
            self.told(item)
            return None
        return item


def state(name: State) -> Status:
    return Status("emulator", name, 1, 1, 0.0, 0)


def taken(lossless: bool, *script: object, before: Sequence[Status] = ()) -> list[object]:
    service = Scripted(*script)
    last = LastMessages(cast(Service, service), lossless)
    for status in before:
        assert service.told is not None
        service.told(status)
    return list(last)


def test_silence_is_the_end_where_messages_may_be_lost() -> None:
    assert taken(False, "one", "two", None, "too late") == ["one", "two"]


@pytest.mark.parametrize("before", [[], [state("running")], [state("stopping"), state("running")]])
def test_where_none_is_lost_the_last_word_of_the_emulator_is_waited_for(before: list[Status]) -> None:
    assert taken(True, None, None, "late", state("stopping"), "its last", None, before=before) == ["late", "its last"]
