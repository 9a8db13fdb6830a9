"""`dtwin stop` and `dtwin release`: an operator's word to the function blocks that stop the arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.api.live import connect
from dtwin.bus.messages import StopState
from dtwin.signals import Stop

MEANING: Final[dict[Stop, str]] = {
    "none": "the arm moves",
    "braking": "the arm comes to rest",
    "standstill": "the arm is held where it is; `dtwin release` lets it move again",
    "torque off": "the motors of the arm have no voltage; `dtwin release` lets it move again",
}


@dataclass(frozen=True, kw_only=True)
class _Word:
    """Who wants it, and where."""

    why: str = "by hand"
    """Reason, for the events."""
    who: str = ""
    """Name, for the events; the login name if not given."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""


@dataclass(frozen=True, kw_only=True)
class StopCommand(_Word):
    """Stop the arm: it brakes and is held until `dtwin release`. Not an emergency stop: see docs/monitoring.md.

    The exit status is 1 when the function blocks do not stop it.
    """

    def execute(self) -> int:
        with connect(self.cell, zenoh=self.zenoh) as cell:
            answer = cell.stop(self.why, who=self.who or None)
        _print(answer)
        return int(answer.stop == "none")


@dataclass(frozen=True, kw_only=True)
class ReleaseCommand(_Word):
    """Let a stopped arm move again, from where it is to where it was going.

    The exit status is 1 when it stays stopped: while it brakes it cannot be released.
    """

    def execute(self) -> int:
        with connect(self.cell, zenoh=self.zenoh) as cell:
            answer = cell.release(self.why, who=self.who or None)
        _print(answer)
        return int(answer.stop != "none")


def _print(answer: StopState) -> None:
    print(f"{answer.stop}: {MEANING[answer.stop]}")
