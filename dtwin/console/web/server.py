"""The web server of a console: pages, files, log-in, commands, and the stream of frames."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, RedirectResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from dtwin.console.console import Answer, Console
from dtwin.console.people.sessions import LIFETIME, Session
from dtwin.console.web.gatekeeper import Gatekeeper
from dtwin.console.web.inquiries import Inquiries
from dtwin.console.web.jobs import Jobs
from dtwin.console.web.replies import address_of, as_json, body
from dtwin.console.web.stream import Stream
from dtwin.errors import DtwinError, RecordingError

STATIC: Final = Path(__file__).resolve().parents[1] / "static"
HASHING: Final = 2
"""Number of passwords that are checked at one time; each takes 32 MB."""


@dataclass(frozen=True)
class Place:
    """Where a server is.

    Attributes:
        names: host names with ports that requests may name; none for all.
        secure: whether it speaks TLS.
        viewer: address of the 3D viewer that is shown in a frame, "" for none.
    """

    names: frozenset[str] = frozenset()
    secure: bool = False
    viewer: str = ""

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers take one with the prefix over TLS alone, and for this host alone."""
        return "__Host-dtwin" if self.secure else "dtwin"


class Credentials(msgspec.Struct, frozen=True):
    """What somebody logs in with."""

    name: str
    password: str


class Server:
    """The addresses of a console.

    Args:
        console: console that is served.
        place: where the server is.
    """

    def __init__(self, console: Console, place: Place) -> None:
        self.console = console
        self._place = place
        self._stream = Stream(console)
        self._inquiries = Inquiries(console)
        self._jobs = Jobs(self._inquiries.prepare)
        self._hashing = asyncio.Semaphore(HASHING)

    def app(self) -> ASGIApp:
        """The application, behind its gatekeeper."""
        post = ["POST"]
        routes = [
            Route("/", self._page),
            Route("/login", self._login_page),
            Route("/api/login", said(self._login), methods=post),
            Route("/api/logout", self._known(self._logout), methods=post),
            Route("/api/session", self._known(self._session)),
            Route("/api/desk/{action}", self._known(self._desk), methods=post),
            Route("/api/command/{name}", self._known(self._command), methods=post),
            *self._inquiries.routes(self._known),
            *self._jobs.routes(self._known),
            WebSocketRoute("/api/stream", self._follow),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        framed = "/".join(self._place.viewer.split("/")[:3])
        inner = Starlette(routes=routes, lifespan=self._lifespan)
        return Gatekeeper(inner, self._place.names, self._place.secure, framed)

    def close(self) -> None:
        """Ends the connections of all pages; may be called from another thread."""
        self._stream.close()

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        feeding = asyncio.create_task(self._stream.run())
        try:
            yield
        finally:
            feeding.cancel()
            self._jobs.close()

    def _find(self, connection: Request | WebSocket) -> Session | None:
        return self.console.session(connection.cookies.get(self._place.cookie))

    def _known(
        self, handle: Callable[[Request, Session], Awaitable[Response]]
    ) -> Callable[[Request], Awaitable[Response]]:
        """Handles requests of sessions alone; what changes something needs the session's token, too."""

        async def checked(request: Request) -> Response:
            session = self._find(request)
            if session is None:
                return as_json({"text": "log in first"}, 401)
            if request.method == "POST" and request.headers.get("x-csrf-token") != session.token:
                return as_json({"text": "the token of this session is missing: load the page again"}, 403)
            return await said(lambda asked: handle(asked, session))(request)

        return checked

    async def _page(self, request: Request) -> Response:
        session = self._find(request)
        if session is not None:
            return FileResponse(STATIC / "index.html")
        if self.console.users is not None:
            return RedirectResponse("/login", 303)
        return self._enter(self.console.sessions.visit(self.console.user), FileResponse(STATIC / "index.html"))

    async def _login_page(self, request: Request) -> Response:
        return FileResponse(STATIC / "login.html")

    async def _login(self, request: Request) -> Response:
        console = self.console
        if console.users is None:
            return as_json({"text": "nobody need log in here"}, 400)
        try:
            given = msgspec.json.decode(await body(request), type=Credentials)
        except (msgspec.MsgspecError, DtwinError):
            return as_json({"text": "expected a name and a password"}, 400)
        address, name = address_of(request), given.name[:100]
        now, before = console.clocks.steady(), self._find(request)
        wait = console.attempts.wait(address, name, now)
        if wait and (before is None or before.user != name):
            return as_json({"text": f"too many attempts: wait {math.ceil(wait)} s"}, 429)
        # It counts as failed until it is known to be right, also while others try.
        console.attempts.fail(address, name, now)
        async with self._hashing:
            user = await run_in_threadpool(console.users.verified, given.name, given.password)
        await run_in_threadpool(console.note_login, name, address, None if user is None else user.role)
        if user is None:
            return as_json({"text": "the name or the password is wrong"}, 401)
        console.attempts.clear(address, name)
        session = console.sessions.open(name, user.role, user.scrypt, console.clocks.steady())
        return self._enter(session, as_json({"text": "welcome"}))

    def _enter(self, session: Session, response: Response) -> Response:
        """Gives the browser the cookie of a session."""
        response.set_cookie(
            self._place.cookie,
            session.key,
            max_age=round(LIFETIME),
            path="/",
            secure=self._place.secure,
            httponly=True,
            samesite="strict",
        )
        return response

    async def _logout(self, request: Request, session: Session) -> Response:
        await run_in_threadpool(self.console.desk.ask, "leave", session)
        self.console.sessions.end(session.key)
        return as_json({"text": "logged out"})

    async def _session(self, request: Request, session: Session) -> Response:
        return as_json(
            {
                "token": session.token,
                "user": session.user,
                "role": session.role,
                "login": self.console.users is not None,
                "viewer": self._place.viewer,
            }
        )

    async def _desk(self, request: Request, session: Session) -> Response:
        zone = request.query_params.get("zone", "")
        done, text = await run_in_threadpool(
            self.console.change_desk, request.path_params["action"], session, address_of(request), zone
        )
        return as_json(Answer(done, text), 200 if done else 409)

    async def _command(self, request: Request, session: Session) -> Response:
        name = request.path_params["name"]
        if name not in self.console.hub.commands:
            return as_json(Answer(False, f"no command {name[:50]!r}"), 404)
        content = await body(request)
        answer = await run_in_threadpool(self.console.command, name, content, session, address_of(request))
        return as_json(answer, 200 if answer.done else 409)

    async def _follow(self, socket: WebSocket) -> None:
        session = self._find(socket)
        if session is None:
            await socket.close(1008, "log in first")
            return
        await self._stream.serve(socket, session)


def said(handle: Callable[[Request], Awaitable[Response]]) -> Callable[[Request], Awaitable[Response]]:
    """Says in words what went wrong."""

    async def answered(request: Request) -> Response:
        try:
            return await handle(request)
        except RecordingError as error:
            return as_json(Answer(False, str(error)), 503)
        except DtwinError as error:
            return as_json(Answer(False, str(error)), 400)

    return answered
