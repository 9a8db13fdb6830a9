"""What every request passes first: it must come from the page's own origin, and every answer carries its headers.

The Content-Security-Policy (W3C, CSP Level 3) lets the page load scripts and styles from this server alone, none of
them inline. Requests of foreign origins get nothing (RFC 6454), and a loopback server answers to its own names only,
so that no foreign name can be pointed at it (DNS rebinding).
"""

from __future__ import annotations

from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS: Final = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=(), payment=(), usb=()",
    "Cache-Control": "no-store",
}
HSTS: Final = "max-age=31536000"


class Gatekeeper:
    """Passes on what may come in, and adds headers to what goes out.

    Args:
        app: the application behind it.
        names: host names with ports that requests may name; none for all, which TLS certificates then prove.
        secure: whether the server speaks TLS.
        framed: origin of the 3D viewer that the page may show in a frame, "" for none.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str], secure: bool, framed: str) -> None:
        self._app = app
        self._names = names
        self._scheme = "https" if secure else "http"
        self._headers = {**HEADERS, "Content-Security-Policy": policy(framed)}
        if secure:
            self._headers["Strict-Transport-Security"] = HSTS

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handles one connection (ASGI 3)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(Headers(scope=scope), scope["type"] == "websocket")
        if not refusal:
            await self._app(scope, receive, self._with_headers(send))
        elif scope["type"] == "http":
            response = PlainTextResponse(f"{refusal}\n", 403)
            await response(scope, receive, self._with_headers(send))
        else:
            await send({"type": "websocket.close", "code": 1008, "reason": refusal})

    def _refusal(self, headers: Headers, websocket: bool) -> str:
        host, origin = headers.get("host", ""), headers.get("origin")
        if self._names and host not in self._names:
            return "this server has another name"
        if origin is None and websocket:
            return "expected an origin"
        if origin is not None and origin != f"{self._scheme}://{host}":
            return "a foreign origin gets nothing"
        if headers.get("sec-fetch-site", "") in ("cross-site", "same-site") and (
            headers.get("sec-fetch-mode") != "navigate"
        ):
            return "a foreign site gets nothing"
        return ""

    def _with_headers(self, send: Send) -> Send:
        async def send_with(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in self._headers.items():
                    headers[name] = value
            await send(message)

        return send_with


def policy(framed: str) -> str:
    """The Content-Security-Policy of the page, which may show one foreign origin in a frame."""
    return "; ".join(
        [
            "default-src 'none'",
            "script-src 'self'",
            "style-src 'self'",
            "img-src 'self'",
            "connect-src 'self'",
            f"frame-src {framed or chr(39) + 'none' + chr(39)}",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
            "require-trusted-types-for 'script'",
            "trusted-types 'none'",
        ]
    )
