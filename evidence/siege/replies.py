"""What somebody answers who is not asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dtwin.bus.codec import encode
from dtwin.bus.messages import StopState

MANY: Final = 2000
"""Number of answers to one query."""
Reply = Callable[[Any], object]
"""Answers a query of Zenoh."""


def say(payload: bytes, attachment: bytes | None, query: Any) -> None:
    with query:
        query.reply(str(query.key_expr), payload, attachment=attachment)


def refuse(query: Any) -> None:
    with query:
        query.reply_err("not today")


def answer_often(query: Any) -> None:
    with query:
        for _ in range(MANY):
            query.reply(str(query.key_expr), encode(StopState(0.0, "standstill")))


def echo(query: Any) -> None:
    with query:
        query.reply(str(query.key_expr), query.payload or b"", attachment=query.attachment)
