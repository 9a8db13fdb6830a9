"""What the loop of an emulated machine needs of it, and of the messages of a tick."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from dtwin.services.parts.latch import Latch
from dtwin.signals import Event


class Timed(Protocol):
    """A message of a tick: its number, and its plant time, s."""

    @property
    def sequence(self) -> int: ...
    @property
    def time(self) -> float: ...


Read = TypeVar("Read", bound=Timed, covariant=True)
C = TypeVar("C", bound=Timed)


class Machine(Protocol[Read, C]):
    """What runs: a cell or an arm, with the stop that is kept for it."""

    @property
    def latch(self) -> Latch: ...
    @property
    def seed(self) -> int: ...
    @property
    def without_command(self) -> str: ...
    @property
    def command(self) -> C:
        """The command that it obeys."""
        ...

    def read(self) -> Read:
        """The sample of this tick."""
        ...

    def obey(self, command: C) -> None:
        """Sets the command until the next one."""
        ...

    def hold_off(self, command: C) -> None:
        """Takes the torque off where a command came that may not pass."""
        ...

    def stop(self) -> None:
        """Takes the torque off until the next command."""
        ...

    def advance(self) -> None:
        """Goes on by a tick. Raises DivergenceError when the motion is not finite any more."""
        ...

    def drain_events(self) -> Sequence[Event]:
        """What happened since the last call."""
        ...

    def drain_news(self) -> Sequence[str]:
        """What happened to files since the last call, in words."""
        ...

    def inject(self, faults: Sequence[str]) -> list[str]:
        """Adds faults; returns them with the times they really have. Raises DtwinError if one cannot be."""
        ...

    def restart(self, seed: int) -> None:
        """Starts anew at time 0."""
        ...
