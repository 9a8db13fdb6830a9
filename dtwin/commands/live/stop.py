"""`dtwin stop` and `dtwin release`: an operator's word to the function blocks that stop the arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.api.live import connect
from dtwin.bus.messages import StopState
from dtwin.errors import CommunicationError
from dtwin.signals import Stop
from dtwin.terminal import alarm

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

    It is reported once what the cell publishes shows it. When the function blocks cannot be asked, the emulator is
    told to take the torque off, and the exit status is 1; it is 2 when the arm may not be stopped.
    """

    def execute(self) -> int:
        try:
            with connect(self.cell, zenoh=self.zenoh) as cell:
                stopped = cell.stop_by_any_way(self.why, who=self.who or None)
        except CommunicationError as error:
            alarm(f"NOT STOPPED: {error}")
            return 2
        _print(stopped.state)
        if stopped.trouble:
            alarm(f"the torque was taken off at the emulator, because {stopped.trouble}")
        return int(bool(stopped.trouble))


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
