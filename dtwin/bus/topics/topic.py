"""A topic of the bus: what is said or asked there, and by whom."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple


class Topic(NamedTuple):
    """One line of the table: `message` is published, or sent with a query and answered by `reply`.

    What is urgent belongs to one tick: it goes out before all else, message by message, and is worth nothing later.
    Who asks waits at most `patience` seconds for the answer.
    """

    name: str
    kind: Literal["publication", "query", "token"]
    message: type | None
    reply: type | None
    sender: str
    urgent: bool = False
    patience: float = 5.0


CHECKED: Final = 60.0
"""Patience for an answer that needs a check on the twin, s."""
