"""What a vehicle that others have made tells: messages wait for the next cycle, and are read one after the other."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from dtwin.bus.codec import MessageError
from dtwin.bus.vda5050.messages import CONNECTION, FACTSHEET, STATE, Connection, Factsheet, State
from dtwin.bus.vda5050.reading import RobotReader

ONLINE: Final = "ONLINE"
_WAITING: Final = 100
"""Number of messages that may wait for the next cycle; of more the oldest are lost."""


class Inbox:
    """The messages of one vehicle.

    Args:
        manufacturer, vehicle: names that they must have in their headers.
        refuse: counts a message that was not believed, by its kind and the reason.
    """

    def __init__(self, manufacturer: str, vehicle: str, refuse: Callable[[str, str], None]) -> None:
        self._refuse = refuse
        self._vehicle = vehicle
        self._came: deque[tuple[str, bytes]] = deque(maxlen=_WAITING)
        self._states = RobotReader(State, manufacturer, vehicle)
        self._connections = RobotReader(Connection, manufacturer, vehicle)
        self._sheets = RobotReader(Factsheet, manufacturer, vehicle)

    def receive(self, topic: str, payload: bytes) -> None:
        """Takes a message, to be read in the next cycle; called by any thread."""
        self._came.append((topic, payload))

    def read(self, handle: Callable[[State | Connection | Factsheet], None]) -> None:
        """Reads all that has come, oldest first.

        Args:
            handle: takes a message, or raises MessageError if it cannot be believed.
        """
        while self._came:
            topic, payload = self._came.popleft()
            try:
                message = self._decoded(topic, payload)
                if message is not None:
                    handle(message)
            except MessageError as error:
                self._refuse(error.reason, f"{self._vehicle}: {topic}: {error}")

    def _decoded(self, topic: str, payload: bytes) -> State | Connection | Factsheet | None:
        if topic == STATE:
            return self._states(payload)
        if topic == FACTSHEET:
            return self._sheets(payload)
        if topic != CONNECTION:
            return None
        connection = self._connections(payload)
        if connection.connectionState == ONLINE:  # It has begun anew, and so have the numbers of its messages.
            self._states.forget()
            self._sheets.forget()
        return connection
