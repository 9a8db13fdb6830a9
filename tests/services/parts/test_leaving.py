"""The end of a run: the emulator waits for its recorder, which takes what is still on its way."""

from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, cast

import pytest

from dtwin.bus.messages import State, Status
from dtwin.services.parts.missed.leaving import LastMessages, Recorded
from dtwin.services.service import Service


class Frame:
    """A service without a bus.

    Attributes:
        bus: its bus, which is itself.
        inbox: its inbox.
        told: receives the status that is asked for.
        watch: receives whether the watched service is there.
    """

    def __init__(self) -> None:
        self.bus = self
        self.inbox: SimpleQueue[Any] = SimpleQueue()
        self.stopping = False
        self.parts: list[str] = []

    def subscribe(self, topic: object, message: type[Status], receive: Callable[[Status], None], part: str) -> None:
        self.told = receive
        self.parts.append(part)

    def watch_alive(self, receive: Callable[[str, bool], None], service: str) -> None:
        self.watch = receive
        self.parts.append(service)

    def next(self, timeout: float) -> Any:
        try:
            return self.inbox.get(timeout=timeout)
        except Empty:
            return None


@pytest.fixture
def frame() -> Frame:
    return Frame()


def status(name: str, state: State, time: float = 0.0) -> Status:
    return Status(name, state, 1, 1, 0.0, 0, time=time)


def test_an_emulator_without_a_recorder_leaves_at_once(frame: Frame) -> None:
    recorded = Recorded(cast(Service, frame))
    assert frame.parts == ["recorder", "recorder"]
    assert recorded.wait(1.0, lambda: pytest.fail("waits"))


def test_an_emulator_waits_until_its_recorder_has_the_run(frame: Frame) -> None:
    recorded = Recorded(cast(Service, frame))
    frame.watch("recorder", True)
    frame.watch("recorder", False)  # killed; it will be back
    times = iter([0.5, 0.9, 1.0])
    assert recorded.wait(1.0, lambda: frame.told(status("recorder", "running", next(times))))
    assert not list(times)


def test_an_emulator_that_shall_end_waits_no_more(frame: Frame) -> None:
    recorded = Recorded(cast(Service, frame))
    frame.watch("recorder", True)

    def end() -> None:
        frame.stopping = True

    assert not recorded.wait(1.0, end)
    frame.stopping = False
    assert not recorded.wait(1.0, lambda: None, longest=0.0)


def test_a_recorder_takes_what_is_on_its_way_whatever_asks_it_to_end(frame: Frame) -> None:
    last = LastMessages(cast(Service, frame), "mark")
    assert frame.parts == ["emulator"]
    frame.told(status("emulator", "running"))
    for item in (None, "one", None, "two"):
        frame.inbox.put(item)
    frame.told(status("emulator", "stopping"))
    assert list(last) == ["one", "two", "mark"]
