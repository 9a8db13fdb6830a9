"""Serves what has been: the last hour, which the console keeps."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from dtwin.console.commands import Files
from dtwin.console.ring import COLOURS, COLUMNS, Ring
from dtwin.console.sessions import Session
from dtwin.errors import ParameterError

WINDOW: Final = 60.0
"""Time before a moment of which frames are told, s."""
Handle = Callable[[Request, Session], Awaitable[Response]]


class Replay:
    """The addresses under which the past is told.

    Args:
        ring: frames and states of the last hour.
        files: folders that recordings lie in.
    """

    def __init__(self, ring: Ring, files: Files) -> None:
        self._ring = ring
        self._files = files

    def routes(self, known: Callable[[Handle], Callable[[Request], Awaitable[Response]]]) -> list[Route]:
        """The addresses; `known` lets sessions alone in."""
        return [Route("/api/past", known(self._past))]

    async def _past(self, request: Request, session: Session) -> Response:
        span = self._ring.span
        if span is None:
            return _told({"span": None})
        at = _number(request, "at", span[1])
        rows = self._ring.rows(at - WINDOW, at)
        state = self._ring.state(at)
        return _told(
            {
                "span": span,
                "columns": COLUMNS,
                "colours": COLOURS,
                "rows": rows,
                "state": None if state is None else msgspec.Raw(state),
            }
        )


def _number(request: Request, name: str, otherwise: float) -> float:
    text = request.query_params.get(name)
    try:
        return otherwise if text is None else float(text)
    except ValueError:
        raise ParameterError(f"{name}: expected a number, got {text!r}") from None


def _told(content: object) -> Response:
    return Response(msgspec.json.encode(content), media_type="application/json")
