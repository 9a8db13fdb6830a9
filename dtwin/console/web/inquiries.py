"""What a page asks for beside the stream: the last hour, the history of the settings, models, calculations."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, Final

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from dtwin.console.alarms.export import COLUMNS as COLUMNS_OF_ALARMS
from dtwin.console.annunciator import Treatment
from dtwin.console.calculations.logs import logs_in
from dtwin.console.calculations.tasks import Compare, Task, Work
from dtwin.console.console import Console
from dtwin.console.people.sessions import Session
from dtwin.console.web.replies import address_of, as_json, body, number_in
from dtwin.errors import ParameterError
from dtwin.identification.store import ModelStore
from dtwin.simulation.history import Entry, History

WINDOW: Final = 60.0
"""Time before a moment of which frames are told, s."""
ENTRIES: Final = 200
"""Number of the last entries of the history that are told."""
Handle = Callable[[Request, Session], Awaitable[Response]]


class Inquiries:
    """The addresses under which a console is asked.

    Args:
        console: console that is asked.
    """

    def __init__(self, console: Console) -> None:
        self._console = console

    def routes(self, known: Callable[[Handle], Callable[[Request], Awaitable[Response]]]) -> list[Route]:
        """The addresses; `known` lets sessions alone in."""
        return [
            Route("/api/past", known(self._past)),
            Route("/api/history", known(self._history)),
            Route("/api/models", known(self._models)),
            Route("/api/logs", known(self._logs)),
            Route("/api/alarms", known(self._alarms)),
            Route("/api/alarms.csv", known(self._csv)),
            Route("/api/alarm/{action}", known(self._treat), methods=["POST"]),
        ]

    def prepare(self, kind: str, content: bytes) -> bytes:
        """The work that a form of a page stands for.

        Raises:
            ParameterError: the form has no task, or not the one of its address.
        """
        try:
            task = msgspec.json.decode(content, type=Task)
        except msgspec.MsgspecError as error:
            raise ParameterError(f"{kind}: {error}") from None
        files, settings = self._console.files, self._console.hub.state().settings
        work = Work(
            task,
            str(files.store),
            "" if files.recordings is None else str(files.recordings),
            excited=self._console.hub.excited.last if isinstance(task, Compare) else None,
            box=self._console.hub.task.boxes.middle,
            cell=self._console.hub.task,
        )
        if settings is not None:
            work = msgspec.structs.replace(work, law=settings.law, model=settings.model, box=settings.payload)
        return msgspec.json.encode(work)

    async def _past(self, request: Request, session: Session) -> Response:
        ring = self._console.ring
        span = ring.span
        if span is None:
            return as_json({"span": None})
        at = number_in(request, "at", span[1])
        state = ring.state(at)
        return as_json(
            {
                "span": span,
                "columns": ring.columns,
                "colours": ("", *ring.colours),
                "rows": ring.rows(at - WINDOW, at),
                "state": None if state is None else msgspec.Raw(state),
            }
        )

    async def _history(self, request: Request, session: Session) -> Response:
        entries = await run_in_threadpool(History(self._console.files.history).entries)
        return as_json({"entries": _with_differences(entries)[-ENTRIES:]})

    async def _models(self, request: Request, session: Session) -> Response:
        store = ModelStore(self._console.files.store)
        found = await run_in_threadpool(lambda: [entry for name in store.names() for entry in store.history(name)])
        return as_json({"models": [str(entry) for entry in found]})

    async def _logs(self, request: Request, session: Session) -> Response:
        return as_json({"logs": logs_in(self._console.files.recordings)})

    async def _alarms(self, request: Request, session: Session) -> Response:
        words = request.query_params.get("words", "")[:200]
        return as_json({"columns": COLUMNS_OF_ALARMS, "rows": self._console.annunciator.history(words)})

    async def _csv(self, request: Request, session: Session) -> Response:
        text = self._console.annunciator.csv(request.query_params.get("words", "")[:200])
        headers = {"Content-Disposition": 'attachment; filename="alarms.csv"'}
        return Response(text, media_type="text/csv", headers=headers)

    async def _treat(self, request: Request, session: Session) -> Response:
        content = await body(request)
        try:
            treatment = msgspec.json.decode(content, type=Treatment)
        except msgspec.MsgspecError as error:
            raise ParameterError(f"alarm: {error}") from None
        await run_in_threadpool(self._console.desk.ask, "keep", session)
        # On the loop's own thread, as everything that the list of alarms is told.
        answer = self._console.treat(request.path_params["action"], treatment, session, address_of(request))
        return as_json(answer, 200 if answer.done else 409)


def _with_differences(entries: list[Entry]) -> list[dict[str, Any]]:
    """Entries with what they changed: name, value before and value after."""
    found = []
    before: dict[str, Any] = {}
    for entry in entries:
        now = _flat(msgspec.to_builtins(entry.settings))
        changed = [(name, before[name], value) for name, value in now.items() if before and before.get(name) != value]
        before = now
        words = msgspec.to_builtins(entry)
        words.pop("settings")
        found.append({**words, "changed": changed})
    return found


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name} ")
        elif isinstance(value, list | tuple):
            found |= {f"{prefix}{name}{joint}": part for joint, part in enumerate(value, 1)}
        else:
            found[f"{prefix}{name}"] = value
    return found
