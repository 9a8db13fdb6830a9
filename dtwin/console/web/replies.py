"""Requests and answers in JSON."""

from __future__ import annotations

from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from dtwin.errors import ParameterError

LARGEST: Final = 65536
"""Length of the longest body of a request, bytes."""


def as_json(content: Any, status: int = 200) -> Response:
    """An answer in JSON."""
    return Response(msgspec.json.encode(content), status, media_type="application/json")


async def body(request: Request) -> bytes:
    """The body of a request.

    Raises:
        ParameterError: it is too long.
    """
    content = b""
    async for chunk in request.stream():
        content += chunk
        if len(content) > LARGEST:
            raise ParameterError(f"expected at most {LARGEST} bytes")
    return content


def number_in(request: Request, name: str, otherwise: float) -> float:
    """A number in the query of a request.

    Raises:
        ParameterError: it is no number.
    """
    text = request.query_params.get(name)
    try:
        return otherwise if text is None else float(text)
    except ValueError:
        raise ParameterError(f"{name}: expected a number, got {text!r}") from None


def address_of(request: Request) -> str:
    """The address that a request came from."""
    return request.client.host if request.client is not None else ""
