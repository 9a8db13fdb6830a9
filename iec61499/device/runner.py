"""Runs a resource in real time: on a reactor's sockets and the monotonic clock.

Resources take turns. In one turn of the reactor a resource delivers events for `TURN`, then the others have theirs,
and who is due goes before who has more to do; one algorithm may compute for `COMPUTING_TIME`. What comes from outside
waits until the event chain before it has ended, as in 4diac FORTE.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.net.address import StreamAddress
from iec61499.net.reactor import Reactor, Timer
from iec61499.net.transport import NetworkTransport, Surroundings
from iec61499.runtime.blocks import UNCHANGED
from iec61499.runtime.checks import Checks, EndOfTest
from iec61499.runtime.resource import Resource
from iec61499.st.semantics import COMPUTING_TIME
from iec61499.types import DataType

if TYPE_CHECKING:
    from iec61499.native.hosted import HostedResource

log = logging.getLogger(__name__)

TURN: Final = 0.005
"""Time for which a resource delivers events in one turn of the reactor, s."""
EVENTS: Final = 16
"""Events that are delivered between two looks at the clock."""
CHAIN_TIME: Final = 1.0
"""Longest time that an event chain may take of the processor, s."""
WAITING: Final = 10_000
"""Most things from outside that wait for a resource."""
LATEST: Final = 1_000_000_000
"""Longest time that a resource may be late, ns; what it is later is left out."""
AT_ONCE: Final = -1
"""What a resource that has more to do in the next turn is due at, instead of a time in ns."""
_ROUND: Final = 0.0005
"""Time after which a loop looks at the clock, s of the processor."""


class Runner:
    """A resource on a reactor. An error inside a block ends it and is one line in the log, never an exception.

    Args:
        name: the resource's name in the log.
        reactor: the event loop that serves its sockets and timers.
        network: what runs.
        library: finds the block types that the network uses.
        surroundings: what the device's resources share to reach others.
        ended: called when an error, or the end of a test, has ended it.
        checks: where the checks of the program are counted.
        native: whether machine code executes it, which cannot be changed while it runs.

    Raises:
        FunctionBlockError: the network or one of its types is wrong, or needs what machine code cannot do.
        NativeError: machine code cannot be made here.
    """

    def __init__(
        self,
        name: str,
        reactor: Reactor,
        network: model.FBNetwork,
        library: Library,
        surroundings: Surroundings,
        ended: Callable[[Exception], None],
        checks: Checks,
        native: bool = False,
    ) -> None:
        self._name = name
        self._reactor = reactor
        self._ended = ended
        self._paused = False
        self._busy = False
        self._waiting: deque[Callable[[], None]] = deque()
        self._allowance = Allowance()
        self._change: Callable[[Resource], None] | None = None
        self._alarm = Alarm(reactor, self._run)
        self._transport = NetworkTransport(reactor, surroundings, self.perform, self.receive)
        iterations = chain.from_iterable(self._allowance.rounds())
        self._resource: Resource | HostedResource
        if native:
            from iec61499.native.hosted import HostedResource  # with it comes NumPy, which others do without

            self._resource = HostedResource(network, library, self._transport)
        else:
            self._resource = Resource(network, library, self._transport, lambda: iterations)
        self._resource.checks = checks

    @property
    def addresses(self) -> dict[str, StreamAddress]:
        """Where the open SERVER and SUBSCRIBE blocks listen, by the block's dotted name."""
        return self._transport.addresses

    def start(self) -> None:
        self._alarm.origin = time.monotonic_ns()
        self.perform(self._resource.issue_start)

    def pause(self) -> None:
        """Issues the STOP event, for one turn; what arrives until `resume` is lost, as in a stopped FORTE."""
        self._waiting.clear()
        self._allowance.renew()
        self.perform(self._resource.issue_stop)
        self._paused = True
        self._waiting.clear()
        self._alarm.clear()
        self._resource.halt()

    def resume(self) -> None:
        """Issues the WARM event. The time it was stopped has not passed for the resource."""
        self._paused = False
        self._alarm.origin = time.monotonic_ns() - self._resource.time
        self.perform(self._resource.issue_start)

    def close(self) -> None:
        """Closes all channels and forgets all timers."""
        self._paused = True
        self._waiting.clear()
        self._alarm.clear()
        self._resource.reset()

    def change_soon(self, change: Callable[[Resource], None]) -> None:
        """Changes the resource before its next event. A change that fails is an error in the log, and is left out."""
        self._change = change

    @property
    def is_idle(self) -> bool:
        """Whether no event chain runs."""
        return self._resource.is_idle

    def change_now(self) -> None:
        """Carries out the change that waits, unless an event chain runs. Raises FunctionBlockError when it fails."""
        if self._change is not None and self._resource.is_idle:
            change, self._change = self._change, None
            if not isinstance(self._resource, Resource):
                raise FunctionBlockError(UNCHANGED)
            change(self._resource)

    def trigger(self, event: str) -> None:
        """Lets an event happen, `BLOCK.EVENT`."""
        self.perform(partial(self._resource.trigger, event))

    def halt_block(self, name: str) -> None:
        self._resource.halt_block(name)

    def reset_block(self, name: str) -> None:
        self._resource.reset_block(name)

    def enter_state(self, name: str, state: str) -> None:
        self._resource.enter_state(name, state)

    def read(self, name: str) -> Any:
        return self._resource.read(name)

    def write(self, name: str, value: Any) -> None:
        self._resource.write(name, value)

    def type_of(self, name: str) -> DataType:
        return self._resource.variable_type(name)

    def perform(self, action: Callable[[], None]) -> None:
        """Does something to the resource as soon as it is idle, with its clock at the present."""
        if self._paused:
            return
        if len(self._waiting) >= WAITING:
            log.warning("resource %s: %d messages wait already; one is lost", self._name, WAITING)
            return
        self._waiting.append(action)
        if not self._busy and self._alarm.due != AT_ONCE:
            self._run()

    def receive(self, action: Callable[[], None]) -> None:
        """Does something to the resource for a block of the device: at once for a block of its own, else in turn."""
        if self._busy:
            action()
        elif not self._paused and len(self._waiting) < WAITING:
            self._waiting.append(action)
            self._alarm.arm(AT_ONCE)

    def _run(self) -> None:
        """Delivers events until none is left or the turn is over. Here every error of a block ends."""
        self._busy = True
        began = self._allowance.begin()
        try:
            idle, ended = self._deliver()
            self._account(ended, time.thread_time() - began)
        except Exception as error:
            test = isinstance(error, EndOfTest)
            checks = self._resource.checks
            level = logging.WARNING if test and not checks.failed else logging.ERROR
            log.log(level, "resource %s ended: %s", self._name, checks if test else _text(error))
            self.close()
            self._ended(error)
            return
        finally:
            self._busy = False
        self._alarm.arm(self._resource.next_timer() if idle else AT_ONCE)

    def _deliver(self) -> tuple[bool, bool]:
        """Returns whether nothing is left to do, and whether an event chain has come to its end."""
        resource, waiting, alarm = self._resource, self._waiting, self._alarm
        turn_ends = self._allowance.end_of_turn(self._reactor.turn)
        ended = False
        while time.monotonic() < turn_ends:
            if self._change is not None:
                self._change_before_event()
            if resource.run_batch(EVENTS):
                continue
            ended = True
            if not resource.ring(time.monotonic_ns() - alarm.origin):
                if not waiting:
                    return True, ended
                waiting.popleft()()
        return False, ended

    def _change_before_event(self) -> None:
        try:
            self.change_now()
        except FunctionBlockError as error:
            log.error("resource %s keeps the network that it had: %s", self._name, error)

    def _account(self, ended: bool, computed: float) -> None:
        """Bounds how long an event chain computes over several turns, and how late the resource may be."""
        if self._allowance.is_exceeded(ended, computed):
            self._resource.end_chain(f"events that follow from one took more than {CHAIN_TIME:g} s")
        late = time.monotonic_ns() - self._alarm.origin - self._resource.time
        if late > LATEST:
            log.warning("resource %s: %.1f s late; this time is left out", self._name, late / 1e9)
            self._alarm.origin += late


class Allowance:
    """How long a resource may compute: in a turn of the reactor, in an algorithm, and in an event chain."""

    def __init__(self) -> None:
        self._turn = -1
        self._turn_ends = 0.0
        self._chain = 0.0
        self._computing_ends = 0.0

    def renew(self) -> None:
        """Has a turn of its own for what comes next, whatever the turn is."""
        self._turn = -1

    def begin(self) -> float:
        """The time of the processor, s, at which it begins to compute."""
        began = time.thread_time()
        self._computing_ends = began + COMPUTING_TIME
        return began

    def end_of_turn(self, turn: int) -> float:
        """When its share of a turn of the reactor ends, s of the monotonic clock."""
        if turn != self._turn:
            self._turn = turn
            self._turn_ends = time.monotonic() + TURN
        return self._turn_ends

    def is_exceeded(self, ended: bool, computed: float) -> bool:
        """Whether an event chain has taken more than CHAIN_TIME; the next one begins anew then.

        Args:
            ended: whether it has come to its end.
            computed: what it has taken of the processor since the last call, s.
        """
        self._chain = 0.0 if ended else self._chain + computed
        if self._chain <= CHAIN_TIME:
            return False
        self._chain = 0.0
        return True

    def rounds(self) -> Iterator[range]:
        """Iterations for loops, a round at a time, until the time to compute is over."""
        size = 1
        now = time.thread_time()
        while now < self._computing_ends:
            yield range(size)
            before, now = now, time.thread_time()
            size = min(2 * size, 64) if now - before < _ROUND else max(1, size // 2)


class Alarm:
    """Wakes a resource when it has something to do.

    Args:
        reactor: the event loop that has the timers.
        ring: called then.

    Attributes:
        origin: time of the monotonic clock at which the resource's clock is 0, ns.
        due: what it is set to, ns on the resource's clock; AT_ONCE for the next turn, None for nothing.
    """

    def __init__(self, reactor: Reactor, ring: Callable[[], None]) -> None:
        self.origin = 0
        self.due: int | None = None
        self._reactor = reactor
        self._wake = ring
        self._timer: Timer | None = None

    def arm(self, due: int | None) -> None:
        """Sets the timer to when there is something to do."""
        if due == self.due:
            return
        self.clear()
        self.due = due
        if due == AT_ONCE:
            self._timer = self._reactor.call_soon(self._ring)
        elif due is not None:
            self._timer = self._reactor.call_at((self.origin + due) / 1e9, self._ring)

    def clear(self) -> None:
        """Wakes it no more."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self.due = None

    def _ring(self) -> None:
        self._timer = self.due = None
        self._wake()


def _text(error: Exception) -> str:
    return str(error) if isinstance(error, FunctionBlockError) else f"{type(error).__name__}: {error}"
