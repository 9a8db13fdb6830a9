"""Every call noted, in a file whose lines are chained by hashes: who asked what, and what was answered."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec
from mcp.server.mcpserver.exceptions import ToolError

from dtwin.ai.profiles import Profile, Rate, role_of
from dtwin.console.people.audit import Audit, AuditEntry
from dtwin.errors import DtwinError, RecordingError
from dtwin.terminal import printable

AUDIT: Final = Path("ai-audit.jsonl")
"""Default file, in the working directory."""
LONGEST: Final = 2000
"""Greatest length of an answer in the audit, characters."""
Tool = Callable[..., Any]


class Noting:
    """Notes calls, bounds how many come, and makes errors of the project errors of the protocol.

    Args:
        audit: file of the calls.
        who: name of the AI.
        profile: what it may do.
        session: name of this run of the server.
        address: where the client is: stdio, or the address of the server.
        rate: bound of the calls.
        now: gives the time of the clock since 1970 and the plant time, s.
    """

    def __init__(
        self,
        audit: Audit,
        who: str,
        profile: Profile,
        session: str,
        address: str,
        rate: Rate,
        now: Callable[[], tuple[float, float]],
    ) -> None:
        self._audit = audit
        self._who = who
        self._profile = profile
        self._session = session
        self._address = address
        self._rate = rate
        self._now = now

    def noted(self, name: str, tool: Tool, *, changes: bool = False, always: bool = False) -> Tool:
        """A tool whose calls are noted.

        Args:
            name: name of the tool.
            tool: what it does.
            changes: whether it changes something: then the call is noted before, and not made if it cannot be.
            always: whether it is made all the same, and however many calls came before: a stop.
        """

        @functools.wraps(tool)
        def call(**arguments: Any) -> Any:
            try:
                if not always:
                    self._rate.count()
                if changes:
                    self._given(name, arguments, always)
                answer = tool(**arguments)
            except DtwinError as error:
                said = printable(str(error))[:LONGEST]
                self._note(name, arguments, False, said)
                raise ToolError(said) from None
            self._note(name, arguments, True, _text(answer))
            return answer

        return call

    def refused(self, name: str, arguments: dict[str, Any], why: str) -> None:
        """Notes a call that came to no tool: of no tool, or with arguments that do not fit."""
        self._note(name[:LONGEST], arguments, False, printable(why)[:LONGEST])

    def _given(self, name: str, arguments: dict[str, Any], always: bool) -> None:
        try:
            self._append(f"{name}, given", arguments, False, "")
        except RecordingError:
            if not always:
                raise

    def _note(self, name: str, arguments: dict[str, Any], done: bool, answer: str) -> None:
        """Notes what came of a call, which that there is no room for the note does not change."""
        try:
            self._append(name, arguments, done, answer)
        except RecordingError as error:
            if done:
                raise ToolError(f"done, but not noted: {error}") from None

    def _append(self, name: str, arguments: dict[str, Any], done: bool, answer: str) -> None:
        wall, plant = self._now()
        role = role_of(self._profile)
        self._audit.append(
            AuditEntry(
                round(wall, 3),
                plant,
                self._who,
                role,
                self._session,
                self._address,
                name,
                _bounded(arguments),
                done,
                answer,
            )
        )


def _bounded(arguments: dict[str, Any]) -> Any:
    """Arguments as they are noted: as they came, or as JSON that is cut where they are long."""
    text = msgspec.json.encode(arguments, enc_hook=str)
    return arguments if len(text) <= LONGEST else text[:LONGEST].decode(errors="replace")


def _text(answer: Any) -> str:
    """An answer as it is noted: as JSON, cut; a picture by its size alone."""
    if isinstance(answer, dict | list):
        return msgspec.json.encode(answer).decode()[:LONGEST]
    data = getattr(answer, "data", b"") or b""
    return f"a picture of {len(data)} bytes"
