"""What a cell has to bear: the table of troubles, what is done in each, and what must hold afterwards."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from dtwin.experiments.soak.cell import TroubledCell
from dtwin.signals import BoxCounts, Event, EventKind

FROZEN: Final = 2.0
"""s for which a process is stopped"""
CUT: Final = 5.0
"""s for which a network is cut"""
ABSENT: Final = 1.0
"""s between the end of a router and the start of the next"""


@dataclass(frozen=True, slots=True)
class Aftermath:
    """What was seen of a cell around a trouble.

    Attributes:
        before: the count of boxes before the trouble.
        after: the count of boxes once the cell worked as before, and somewhat later.
        events: what the bus told meanwhile.
        recovered: whether the cell worked as before within the time it was given.
        seconds: from the beginning of the trouble until the cell worked as before, s of wall time.
    """

    before: BoxCounts
    after: BoxCounts
    events: tuple[Event, ...]
    recovered: bool
    seconds: float

    @property
    def made_safe(self) -> bool:
        """Whether the arm was made safe meanwhile."""
        return any(event.kind in (EventKind.SAFE, EventKind.RESUMED) for event in self.events)

    @property
    def misplaced(self) -> int:
        """Number of boxes misplaced meanwhile."""
        return self.after.misplaced - self.before.misplaced


class Promise(NamedTuple):
    """What must hold after a trouble: its name, and whether it does."""

    name: str
    kept: Callable[[TroubledCell, Aftermath], bool]


@dataclass(frozen=True, slots=True)
class Trouble:
    """An entry of the table.

    Attributes:
        name: what happens, in words.
        action: makes it happen, and ends what does not end by itself.
        promises: what must hold afterwards.
    """

    name: str
    action: Callable[[TroubledCell], None]
    promises: tuple[Promise, ...]


def recovered(cell: TroubledCell, seen: Aftermath) -> bool:
    """The cell works as before."""
    return seen.recovered


def count_kept(cell: TroubledCell, seen: Aftermath) -> bool:
    """The count of boxes goes on, and every box that was picked is delivered, misplaced or held."""
    before, after = seen.before, seen.after
    known = after.delivered + after.misplaced + after.held
    return after.arrived >= before.arrived and after.delivered >= before.delivered and after.picked == known


def kill(service: str, cell: TroubledCell) -> None:
    """Ends a service without a word."""
    os.kill(cell.services()[service], signal.SIGKILL)


def freeze(service: str, cell: TroubledCell) -> None:
    """Stops a service for a while."""
    pid = cell.services()[service]
    os.kill(pid, signal.SIGSTOP)
    time.sleep(FROZEN)
    os.kill(pid, signal.SIGCONT)


def cut_bridge(cell: TroubledCell) -> None:
    """Cuts the network of the bridge for a while."""
    cell.proxy.cut.set()
    time.sleep(CUT)
    cell.proxy.cut.clear()


def restart_router(cell: TroubledCell) -> None:
    """Kills the router and starts another one."""
    cell.restart_router(ABSENT)


WORKS_ON: Final = (Promise("recovered", recovered), Promise("count_kept", count_kept))
"""what must hold after every trouble that ends"""

TROUBLES: Final = (
    Trouble("kill controller", partial(kill, "controller"), WORKS_ON),
    Trouble("freeze controller for 2 s", partial(freeze, "controller"), WORKS_ON),
    Trouble("kill bridge", partial(kill, "bridge"), WORKS_ON),
    Trouble("freeze bridge for 2 s", partial(freeze, "bridge"), WORKS_ON),
    Trouble("kill emulator", partial(kill, "emulator"), WORKS_ON),
    Trouble("freeze emulator for 2 s", partial(freeze, "emulator"), WORKS_ON),
    Trouble("kill recorder", partial(kill, "recorder"), WORKS_ON),
    Trouble("freeze recorder for 2 s", partial(freeze, "recorder"), WORKS_ON),
    Trouble("cut the bridge's network for 5 s", cut_bridge, WORKS_ON),
    Trouble("restart the router", restart_router, WORKS_ON),
)
"""all troubles, in the order in which a cell bears them"""
