"""How far a vehicle that others have made has taken and carried out the order that it was sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from dtwin.line.fleet.orders import Orders

_RESENT: Final = 1.0
"""Time after which an order that it has not taken is sent again, s."""


class Dispatch:
    """Sends orders, one update after the other.

    Args:
        orders: the orders of the vehicle.
        send: sends it an order.

    Attributes:
        reached: number of the last node of the order that it has reached.
        taken: number of the last update that it has taken; -1 for none of this order.
    """

    def __init__(self, orders: Orders, send: Callable[[msgspec.Struct], None]) -> None:
        self.reached, self.taken = 0, -1
        self._orders = orders
        self._send = send
        self._order = ""
        self._first = 0
        self._sent_at: float | None = None

    def look(self) -> None:
        """Whether another order has begun, of which it has taken nothing yet."""
        if self._orders.order_id != self._order:
            self._order, self.reached, self.taken = self._orders.order_id, 0, -1

    def progressed(self, reached: int, update: int | None) -> None:
        """It has reached a node, and has taken an update of this order; None if it has told of another one."""
        self.reached = reached
        if update is not None:
            self.taken = max(self.taken, update)

    def send_due(self, now: float, interval: float) -> None:
        """Sends what is new, when it has taken what came before, or again what it has not taken.

        Args:
            now: time, s.
            interval: least time between two orders, s.
        """
        orders = self._orders
        since = interval if self._sent_at is None else now - self._sent_at
        if since < interval:
            return
        if orders.order_id and self.taken < orders.update:
            if since >= _RESENT or self._sent_at is None:
                self._send(orders.message(self._first, now))
                self._sent_at = now
        elif orders.has_new:
            self._first = max(orders.sent - 1, 0)
            self._send(orders.next(now))
            self._sent_at = now
