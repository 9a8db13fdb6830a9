"""The controller behind a TCP port: lockstep, shadow, and what a late, lost or wrong answer says."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from dtwin.controller.ports import EMULATOR
from dtwin.controller.remote import RemoteController
from dtwin.errors import CommunicationError
from dtwin.parameters import JointVector
from dtwin.signals import Event, Sensors, Voltages
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.reactor import Reactor
from iec61499.net.stream import StreamServer
from iec61499.net.wire import Message

PATIENCE = 10.0


class Shadow:
    """Answers with volts that follow from the sample."""

    def __init__(self) -> None:
        self.steps = 0

    def step(self, sensors: Sensors) -> Voltages:
        self.steps += 1
        return Voltages(sensors.sequence, sensors.time, (*sensors.theta, -3.0), sensors.box_present)

    def target(self) -> JointVector:
        return (float(self.steps), 0.0, 0.0)

    def drain_events(self) -> list[Event]:
        return []


def sample(sequence: int) -> Sensors:
    return Sensors(sequence, 0.01 * sequence, (0.1 * sequence, -0.2, 0.3), 0.9, sequence % 2 == 0, "red")


@contextmanager
def remote(answer: Callable[[StreamServer, Message], None], timeout: float = PATIENCE) -> Iterator[RemoteController]:
    """A controller whose port is served by `answer` in another thread."""
    with Reactor() as reactor:
        server = StreamServer(
            reactor, Address(LOOPBACK, 0), EMULATOR.receives, EMULATOR.sends, lambda message: answer(server, message)
        )
        thread = threading.Thread(target=reactor.run)
        thread.start()
        try:
            with RemoteController(server.address, Shadow(), timeout) as controller:
                yield controller
        finally:
            reactor.stop()
            thread.join(PATIENCE)
            server.close()


def test_steps_answer_sample_by_sample_and_targets_come_from_the_shadow() -> None:
    def answer(server: StreamServer, message: Message) -> None:
        *theta, gripper, present, colour = message
        assert (gripper, colour) == (0.9, "red")
        server.send([*theta, -3.0, present])

    with remote(answer) as controller:
        for sequence in range(50):
            sensors = sample(sequence)
            voltages = controller.step(sensors)
            assert voltages == Voltages(sequence, sensors.time, (*sensors.theta, -3.0), sequence % 2 == 0)
            assert controller.target() == (sequence + 1.0, 0.0, 0.0)
        assert controller.largest_difference == 0.0


def test_the_largest_difference_to_the_shadow_is_kept() -> None:
    offsets = iter([0.0, 0.5, 0.25])

    def answer(server: StreamServer, message: Message) -> None:
        server.send([message[0], message[1] - next(offsets), message[2], -3.0, True])

    with remote(answer) as controller:
        for sequence in range(3):
            controller.step(sample(sequence))
        assert controller.largest_difference == pytest.approx(0.5, rel=1e-12)


def test_a_late_answer_names_peer_tick_and_timeout() -> None:
    with remote(lambda server, message: None, timeout=0.05) as controller, pytest.raises(CommunicationError) as late:
        controller.step(sample(7))
    assert str(late.value).startswith("tick 7 (t = 0.07 s): 127.0.0.1:")
    assert str(late.value).endswith("no answer within 0.05 s")


def test_a_lost_peer_is_named() -> None:
    with (
        remote(lambda server, message: server.close()) as controller,
        pytest.raises(CommunicationError, match=r"tick 0 .*127\.0\.0\.1:\d+: connection lost"),
    ):
        controller.step(sample(0))


def test_infinite_voltages_are_refused() -> None:
    with (
        remote(lambda server, message: server.send([0.0, math.nan, 0.0, 0.0, False])) as controller,
        pytest.raises(CommunicationError, match="expected finite volts, got"),
    ):
        controller.step(sample(0))


def test_nobody_there() -> None:
    with Reactor() as reactor:
        server = StreamServer(reactor, Address(LOOPBACK, 0), EMULATOR.receives, EMULATOR.sends, print)
        server.close()
        with pytest.raises(CommunicationError, match=rf"{server.address}: cannot connect"):
            RemoteController(server.address, Shadow())
