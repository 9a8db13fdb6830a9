"""The orders of a vehicle in the form of VDA 5050: what the blocks give it, node by node and action by action.

The base of an order only grows (6.1.2): every update begins with the last node of the one before it. What is done at
a node where the vehicle stands already is released by a node of the same name behind it. The blocks give nodes only
when they are free, so that there is no horizon.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Set
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from dtwin.bus.vda5050.messages import (
    DROP,
    PICK,
    Action,
    ActionParameter,
    Edge,
    InstantActions,
    Node,
    NodePosition,
    Order,
)
from dtwin.line.track import Track
from dtwin.line.vehicle import LOAD, UNLOAD

ACTIONS: Final = {LOAD: PICK, UNLOAD: DROP}
"""Predefined types of actions (6.2.3.1), by the number that the blocks know them by."""
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class Stamp:
    """Who sends, and when.

    Attributes:
        manufacturer, vehicle: of the vehicle.
        epoch: time at which plant time began, s from 1970 on.
    """

    manufacturer: str
    vehicle: str
    epoch: float = 0.0

    def text(self, time: float) -> str:
        """A plant time, s, as ISO 8601 in UTC."""
        at = _EPOCH + timedelta(seconds=round(self.epoch + time, 3))
        return f"{at:%Y-%m-%dT%H:%M:%S}.{at.microsecond // 1000:03d}Z"


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where a vehicle is one of a line.

    Attributes:
        track: where it drives.
        zone: name of its zone, which is its map.
        place: tells the name of what has a slot of the zone.
        held: tells the nodes that other vehicles hold.
        epoch: time at which plant time began, s from 1970 on.
        life: what tells the orders of this process from those of an earlier one.
    """

    track: Track
    zone: str
    place: Callable[[int], str]
    held: Callable[[], Set[str]] = frozenset
    epoch: float = 0.0
    life: str = ""


@dataclass(frozen=True, slots=True)
class Stop:
    """A node of an order.

    Attributes:
        node: its name.
        sequence: its number in the order.
        action: what is done there, None for nothing.
        new: whether the vehicle drives there, and does not stand there already.
    """

    node: str
    sequence: int
    action: Action | None = None
    new: bool = True


class Orders:
    """The orders of one vehicle, one after the other.

    Args:
        stamp: who sends.
        around: where the vehicle is one of a line.

    Attributes:
        order_id: the order in force, "" before the first one.
        update: number of its last update that was made a message of.
        stops: its nodes so far.
        sent: number of these that are in messages.
        action: the action that was released last, None for none since it was finished or withdrawn.
    """

    def __init__(self, stamp: Stamp, around: Surroundings) -> None:
        self._stamp, self._around, self._life = stamp, around, around.life
        self._orders = self._actions = self._instants = 0
        self._headers = {"order": 0, "instantActions": 0}
        self._over = True
        self.order_id, self.update = "", 0
        self.stops: list[Stop] = []
        self.sent = 0
        self.action: Action | None = None

    def begin(self, at: str) -> None:
        """The next order begins with its first node, where the vehicle stands."""
        self._orders += 1
        middle = f"-{self._life}" if self._life else ""
        self.order_id, self.update = f"{self._stamp.vehicle}{middle}-{self._orders}", -1
        self.stops, self.sent, self._over = [Stop(at, 0)], 0, False
        self.action = None

    def drive(self, at: str, node: str) -> None:
        """A node is given to the vehicle.

        Args:
            at: where it stands if this is the first one of an order.
            node: the node.
        """
        if self._over:
            self.begin(at)
        self._add(node, None, True)

    def act(self, at: str, kind: int, place: str, box: int) -> None:
        """Something is to be done where the vehicle stands.

        Args:
            at: where it stands.
            kind: LOAD or UNLOAD.
            place: the station, or the end of the zone, at which it is done.
            box: number of the box, 0 if it is not known yet.
        """
        if self._over:
            self.begin(at)
        self._actions += 1
        words = [ActionParameter("stationName", place)]
        words += [ActionParameter("loadId", str(box))] if box else []
        name = f"{self.order_id}-{ACTIONS[kind]}-{self._actions}"
        self.action = Action(ACTIONS[kind], name, "HARD", tuple(words))
        self._add(at, self.action, False)

    def done(self, last: bool) -> None:
        """The action is finished; `last` says that the order ends with it."""
        self.action = None
        self._over = self._over or last

    def end(self) -> None:
        """Nothing more comes of the order: it is withdrawn, or the vehicle has lost it."""
        self.action, self._over = None, True

    @property
    def has_new(self) -> bool:
        """Whether something was added that is in no message yet."""
        return self.sent < len(self.stops)

    def next(self, time: float) -> Order:
        """The message that releases what is new, at a plant time, s; the order itself or an update of it."""
        self.update += 1
        first = max(self.sent - 1, 0)
        self.sent = len(self.stops)
        return self.message(first, time)

    def message(self, first: int, time: float) -> Order:
        """The message with the stops from a number on, which is that of the last update as long as this is it."""
        stops = self.stops[first : self.sent]
        nodes = tuple(
            Node(
                stop.node,
                stop.sequence,
                True,
                NodePosition(*self._around.track.nodes[stop.node], self._around.zone),
                () if stop.action is None else (stop.action,),
            )
            for stop in stops
        )
        edges = tuple(
            Edge(f"{one.node}>{other.node}", one.sequence + 1, True) for one, other in itertools.pairwise(stops)
        )
        return Order(
            headerId=self._header("order"),
            timestamp=self._stamp.text(time),
            manufacturer=self._stamp.manufacturer,
            serialNumber=self._stamp.vehicle,
            orderId=self.order_id,
            orderUpdateId=self.update,
            nodes=nodes,
            edges=edges,
        )

    def instant(self, kind: str, time: float, **parameters: str) -> InstantActions:
        """A message that has the vehicle do something at once (6.2.1), such as cancelOrder, at a plant time, s."""
        self._instants += 1
        life = f"-{self._life}" if self._life else ""
        name = f"{self._stamp.vehicle}{life}-{kind}-{self._instants}"
        words = tuple(ActionParameter(key, value) for key, value in parameters.items())
        return InstantActions(
            headerId=self._header("instantActions"),
            timestamp=self._stamp.text(time),
            manufacturer=self._stamp.manufacturer,
            serialNumber=self._stamp.vehicle,
            actions=(Action(kind, name, "NONE", words),),
        )

    def _add(self, node: str, action: Action | None, new: bool) -> None:
        self.stops.append(Stop(node, self.stops[-1].sequence + 2, action, new))

    def _header(self, topic: str) -> int:
        number = self._headers[topic]
        self._headers[topic] = (number + 1) % 2**32
        return number
