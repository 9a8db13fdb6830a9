"""What was published lately, for a recorder that comes back: it asks for what passed while there was none."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

from dtwin.bus.messages import BACKLOG_PAGE, AnswerBacklog, BacklogRequest, SampleBacklog
from dtwin.bus.session import Publisher

KEPT: Final = 3000
"""Messages of a topic that are kept: those of 30 s in real time, longer than a recorder is away."""


class Kept:
    """A publisher that keeps its last messages, because somebody may ask for them later.

    Args:
        publisher: what publishes them.

    Attributes:
        messages: the last KEPT messages, oldest first.
        sender: name under which subscribers know the publisher.
        wanted: always: who is away now may want it when it is back.
    """

    def __init__(self, publisher: Publisher | Kept) -> None:
        self.messages: deque[Any] = deque(maxlen=KEPT)
        self.sender: bytes = publisher.sender
        self.wanted: bool = True
        self._publish = publisher

    def __call__(self, message: Any) -> None:
        self.messages.append(message)
        self._publish(message)

    def page(self, since: int) -> tuple[Any, ...]:
        """The messages of BACKLOG_PAGE ticks from a sequence number on."""
        return tuple(each for each in tuple(self.messages) if since <= each.sequence < since + BACKLOG_PAGE)


def samples(asked: BacklogRequest, sensors: Kept, truth: Kept, acted: Kept) -> SampleBacklog:
    """A page of what an emulator has published."""
    found = sensors.page(asked.since)
    times = {sample.time for sample in found}
    truths = tuple(each for each in tuple(truth.messages) if each.time in times)
    return SampleBacklog(found, truths, acted.page(asked.since))


def answers(asked: BacklogRequest, voltages: Kept, path: Kept) -> AnswerBacklog:
    """A page of what a bridge has published."""
    return AnswerBacklog(voltages.page(asked.since), path.page(asked.since))
