"""A stop that is demanded while a cell starts: the bridge may hear of the emulator only afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import pytest

from dtwin.bus.messages import LATCH, RELEASE, STOP, LatchRequest, LatchState, ReleaseRequest, StopRequest, StopState
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.controller.device import SafeStop
from dtwin.services.parts.latch import Latch, Latched
from dtwin.services.parts.stopping.stops import Stops
from dtwin.signals import ArmState, Stop
from tests.support.ports import free_port
from tests.support.waiting import connected, until

KEY = b"k" * 32
DEMAND = StopRequest("anna", "look at it", "failed")
JUDGED: dict[ArmState, Stop] = {"failed": "standstill", "angles unknown": "torque off"}


class Blocks:
    """Blocks that stand as soon as they are told to.

    Attributes:
        stop: stop in force in them.
    """

    def __init__(self) -> None:
        self.stop: Stop = "none"

    def now(self) -> Stop:
        return self.stop

    def judge(self, state: ArmState, confidence: float) -> Stop:
        assert confidence == 1.0
        self.stop = JUDGED[state]
        return self.stop

    def release(self) -> Stop:
        self.stop = "none"
        return self.stop


class Emulator:
    """The emulator's latch on the bus, and its liveliness token.

    Args:
        meet: where the peers of the cell meet.
        latched: what an earlier life has kept.
        announced: whether it has its token yet; others may ask it before.
    """

    def __init__(self, meet: str, latched: Latched, announced: bool = True) -> None:
        self.latch = Latch(latched, lambda changed: None)
        self.bus = Bus(open_peer(meet), key=KEY)
        self.bus.answer(LATCH, LatchRequest, self._latch, self._state)
        if announced:
            self.bus.announce("emulator")

    def _latch(self, request: LatchRequest) -> LatchState:
        if request.stop == "none":
            self.latch.release(request.number)
        else:
            self.latch.stop(request.stop, bytes.fromhex(request.holder), request.number)
        return self._state()

    def _state(self) -> LatchState:
        return LatchState(0.0, *self.latch.latched)


class Cell:
    """A bridge whose first word of a stop is a demand, which comes before any sample."""

    def __init__(self, meet: str, bridge: Bus, user: Bus) -> None:
        self.blocks = Blocks()
        self.meet = meet
        self.emulator = Emulator(meet, Latched())
        self.stops = Stops(bridge, b"\x01", lambda: cast(SafeStop, self.blocks), lambda: 0.0)
        self.user = user
        connected(lambda: bridge.ask(LATCH, None, LatchState))
        assert connected(lambda: user.ask(STOP, DEMAND, StopState)).stop == "standstill"

    def begin_anew(self, kept: Latched, announced: bool) -> None:
        """Another emulator takes the place of the one before."""
        self.emulator.bus.close()
        self.emulator = Emulator(self.meet, kept, announced)

    def stop(self) -> Stop:
        """The stop that is read."""
        return self.user.ask(STOP, None, StopState).stop

    def stops_in_force(self) -> tuple[Stop, Stop]:
        """The stops in the blocks and in the latch."""
        return self.blocks.stop, self.emulator.latch.latched.stop


@pytest.fixture
def cell() -> Iterator[Cell]:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet), key=KEY) as bridge, Bus(open_peer(meet), key=KEY) as user:
        cell = Cell(meet, bridge, user)
        yield cell
        until(lambda: cell.stops.remind(), "the emulator answers")
        assert user.ask(RELEASE, ReleaseRequest("anna", "done"), StopState).stop == "none"
        cell.emulator.bus.close()


def test_one_demanded_before_the_first_sample_stays_as_it_is(cell: Cell) -> None:
    assert cell.stops.remind()
    assert cell.stop() == "standstill"
    cell.stops.renewed()  # As when the emulator's liveliness token is late.
    assert cell.stops.remind()
    assert cell.stop() == "standstill"
    assert cell.emulator.latch.latched == (1, "standstill")


def test_blocks_that_have_forgotten_it_take_the_torque_off(cell: Cell) -> None:
    cell.blocks.stop = "none"
    cell.stops.renewed()
    assert cell.stops.remind()
    assert cell.stops_in_force() == ("torque off", "torque off")


@pytest.mark.parametrize("announced", [True, False], ids=["announced", "not yet"])
@pytest.mark.parametrize("kept", [Latched(1, "standstill"), Latched()], ids=["with its journal", "without"])
def test_an_emulator_that_begins_anew_takes_the_torque_off(cell: Cell, kept: Latched, announced: bool) -> None:
    cell.begin_anew(kept, announced)
    until(lambda: cell.stops_in_force() == ("torque off", "torque off"), "nobody knows any longer who holds the arm")
    assert cell.stop() == "torque off"
