"""What a cell has to bear: the table of troubles, what is done in each, and what must hold afterwards."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from dtwin.signals import MONITOR, BoxCounts, Event, EventKind
from evidence.soak.cell import TroubledCell
from evidence.soak.disk import fill_the_disk
from evidence.soak.hostile import answer_first, ask_for_everything, cry_wolf
from evidence.soak.lasting import settled, stopped

HELD: Final = 0.025
"""s for which a process is held up, once a second"""
HOLD_UPS: Final = 20
"""times that a process is held up"""
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
    def findings(self) -> tuple[str, ...]:
        """What was said to be wrong with the arm meanwhile, and of its stops."""
        return tuple(e.text for e in self.events if e.kind in (f"{MONITOR}failed", EventKind.STOP))

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
        action: makes it happen, and ends what does not end by itself; returns what it saw broken meanwhile, in a
            few words, or "".
        promises: what must hold afterwards.
    """

    name: str
    action: Callable[[TroubledCell], str]
    promises: tuple[Promise, ...]


def recovered(cell: TroubledCell, seen: Aftermath) -> bool:
    """The cell works as before."""
    return seen.recovered


def count_kept(cell: TroubledCell, seen: Aftermath) -> bool:
    """The count of boxes goes on, and every box that was picked is delivered, misplaced or held."""
    before, after = seen.before, seen.after
    known = after.delivered + after.misplaced + after.held
    return after.arrived >= before.arrived and after.delivered >= before.delivered and after.picked == known


def no_finding(cell: TroubledCell, seen: Aftermath) -> bool:
    """The monitor has found nothing wrong with the arm, and nobody has stopped it."""
    return not seen.findings


def end(number: signal.Signals, service: str, cell: TroubledCell) -> str:
    """Ends a service by a signal."""
    os.kill(cell.services()[service], number)
    return ""


def freeze(service: str, cell: TroubledCell) -> str:
    """Stops a service for a while."""
    pid = cell.services()[service]
    os.kill(pid, signal.SIGSTOP)
    time.sleep(FROZEN)
    os.kill(pid, signal.SIGCONT)
    return ""


def hold_up(service: str, cell: TroubledCell) -> str:
    """Holds a service for some ticks once a second, over and over."""
    pid = cell.services()[service]
    for _ in range(HOLD_UPS):
        os.kill(pid, signal.SIGSTOP)
        time.sleep(HELD)
        os.kill(pid, signal.SIGCONT)
        time.sleep(1.0 - HELD)
    return ""


def cut_bridge(cell: TroubledCell) -> str:
    """Cuts the network of the bridge for a while."""
    cell.proxy.cut.set()
    time.sleep(CUT)
    cell.proxy.cut.clear()
    return ""


def restart_router(cell: TroubledCell) -> str:
    """Kills the router and starts another one."""
    cell.restart_router(ABSENT)
    return ""


WORKS_ON: Final = (Promise("recovered", recovered), Promise("count_kept", count_kept))
"""what must hold after every trouble that ends"""
UNSUSPECTED: Final = (*WORKS_ON, Promise("no_finding", no_finding))
"""what must hold after trouble that is none of the arm's"""
_KILL: Final = partial(end, signal.SIGKILL)
_TERM: Final = partial(end, signal.SIGTERM)

TROUBLES: Final = (
    Trouble("kill controller", partial(_KILL, "controller"), WORKS_ON),
    Trouble("freeze controller for 2 s", partial(freeze, "controller"), WORKS_ON),
    Trouble("kill bridge", partial(_KILL, "bridge"), WORKS_ON),
    Trouble("freeze bridge for 2 s", partial(freeze, "bridge"), WORKS_ON),
    Trouble("kill emulator", partial(_KILL, "emulator"), WORKS_ON),
    Trouble("ask emulator to end", partial(_TERM, "emulator"), WORKS_ON),
    Trouble("freeze emulator for 2 s", partial(freeze, "emulator"), WORKS_ON),
    Trouble("kill recorder", partial(_KILL, "recorder"), WORKS_ON),
    Trouble("freeze recorder for 2 s", partial(freeze, "recorder"), WORKS_ON),
    Trouble("cut the bridge's network for 5 s", cut_bridge, WORKS_ON),
    Trouble("restart the router", restart_router, WORKS_ON),
    Trouble("kill monitoring", partial(_KILL, "monitoring"), WORKS_ON),
    Trouble("kill simulation", partial(_KILL, "simulation"), WORKS_ON),
    Trouble("hold the bridge for 25 ms once a second", partial(hold_up, "bridge"), UNSUSPECTED),
    Trouble("stop, then kill controller", partial(stopped, ("controller",)), WORKS_ON),
    Trouble("stop, then kill bridge and controller", partial(stopped, ("bridge", "controller")), WORKS_ON),
    Trouble("stop, then kill emulator", partial(stopped, ("emulator",)), WORKS_ON),
    Trouble("confirm settings, then kill controller", partial(settled, ("controller",)), WORKS_ON),
    Trouble(
        "confirm settings, then kill bridge and controller", partial(settled, ("bridge", "controller")), WORKS_ON
    ),
    Trouble("ask for everything with a wildcard", ask_for_everything, UNSUSPECTED),
    Trouble("answer before the bridge", answer_first, UNSUSPECTED),
    Trouble("say that the arm is safe", cry_wolf, UNSUSPECTED),
    Trouble("fill the recorder's disk", fill_the_disk, UNSUSPECTED),
)
"""all troubles, in the order in which a cell bears them"""
