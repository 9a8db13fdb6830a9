"""What a managed resource asks of the network that it has made run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from iec61499 import model
from iec61499.net.address import StreamAddress
from iec61499.runtime.resource import Resource
from iec61499.types import DataType


class Running(Protocol):
    """A network made to run."""

    @property
    def addresses(self) -> dict[str, StreamAddress]:
        """Where the open SERVER and SUBSCRIBE blocks listen, by the block's dotted name."""

    def start(self) -> None:
        """Issues the COLD event of E_RESTART."""

    def pause(self) -> None:
        """Stops after the STOP event of E_RESTART."""

    def resume(self) -> None:
        """Starts again with the WARM event of E_RESTART."""

    def close(self) -> None:
        """Ends it and lets go of its sockets and timers."""

    def change_soon(self, change: Callable[[Resource], None]) -> None:
        """Changes the network before the next event."""

    @property
    def is_idle(self) -> bool:
        """Whether no event chain runs."""

    def change_now(self) -> None:
        """Carries out the change that waits. Raises FunctionBlockError when it fails."""

    def trigger(self, event: str) -> None:
        """Lets an event happen, `BLOCK.EVENT`."""

    def halt_block(self, name: str) -> None:
        """Cancels the timers of a block and closes its channels."""

    def reset_block(self, name: str) -> None:
        """Gives a block its initial values."""

    def enter_state(self, name: str, state: str) -> None:
        """Lets the chart of a block be in a state. Raises FunctionBlockError when it has none of that name."""

    def read(self, name: str) -> Any: ...
    def write(self, name: str, value: Any) -> None: ...
    def type_of(self, name: str) -> DataType: ...


Launcher = Callable[[model.FBNetwork, Callable[[], None]], Running]
"""Makes a network run; calls the function given with it when an error has ended it."""
