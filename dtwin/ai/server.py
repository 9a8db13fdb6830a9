"""The server of the Model Context Protocol: which tools a profile has, and how they are served."""

from __future__ import annotations

import hmac
from collections.abc import Callable
from typing import Any, Final

from anyio import to_thread
from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.prompts import Prompt
from mcp.types import ToolAnnotations
from pydantic import ValidationError

from dtwin.ai.audit import Noting
from dtwin.ai.profiles import Profile, may
from dtwin.ai.prompts import RULES, TASKS, Task
from dtwin.ai.station import Station
from dtwin.ai.tools.act import Acting
from dtwin.ai.tools.ask import Asking
from dtwin.ai.tools.look import Looking
from dtwin.ai.tools.picture import Pictures
from dtwin.ai.tools.propose import Proposing
from dtwin.errors import choices

NAME: Final = "dtwin"
STOP: Final = "stop"
SAYS: Final[dict[Profile, str]] = {
    "observe": "You may look and ask. You cannot change anything.",
    "propose": "You may look, ask and propose. Nothing moves until a person approves a proposal.",
    "act": "You may look, ask, propose and act within limits. Every change is checked and on trial.",
}


class NotedServer(MCPServer[Any]):
    """A server that notes the calls that reach no tool, too, and takes no argument that a tool does not have.

    Args:
        noting: notes the calls.
        instructions: what a client is told first.
    """

    def __init__(self, noting: Noting, instructions: str) -> None:
        super().__init__(NAME, instructions=instructions, log_level="ERROR")
        self._noting = noting

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Any = None) -> Any:
        schema = self._tool_input_schema(name) or {}
        known = schema.get("properties", {})
        try:
            for each in arguments if schema else ():
                if each not in known:
                    raise ToolError(f"{name}: argument {each[:50]!r}: expected {choices(known) if known else 'none'}")
            return await super().call_tool(name, arguments, context)
        except ToolError as error:
            if isinstance(error.__cause__, ValidationError):
                said = ToolError(f"{name}: {_words(error.__cause__)}")
                await to_thread.run_sync(self._noting.refused, name, arguments, str(said))
                raise said from None
            if not isinstance(error.__cause__, ToolError):
                await to_thread.run_sync(self._noting.refused, name, arguments, str(error))
            raise


def _words(error: ValidationError) -> str:
    """What is wrong with arguments, in one line."""
    found = error.errors(include_url=False, include_input=False)
    return "; ".join(f"argument {'.'.join(map(str, each['loc']))}: {each['msg']}" for each in found[:3])


def make_server(station: Station, profile: Profile, noting: Noting, acting: Acting | None) -> NotedServer:
    """A server with the tools and prompts of a profile, and no others.

    Args:
        station: where the AI stands.
        profile: what it may do.
        noting: notes the calls.
        acting: the tools that act, for that profile alone.
    """
    server = NotedServer(noting, rules_of(profile))
    looking, asking = Looking(station), Asking(station)
    look = (
        *(looking.status, looking.findings, looking.events, looking.trends, looking.settings, looking.proposals),
        *(looking.alarms, looking.history, looking.models, looking.model, looking.documentation, looking.recordings),
        *(asking.what_if, asking.margins, asking.can_hold, asking.recovery_answer, asking.optimise),
    )
    offer(server, noting, look)
    pictures = Pictures(station)
    offer(server, noting, (pictures.recording_picture,))
    if may(profile, "propose"):
        made = Proposing(station)
        propose = (
            *(made.propose_settings, made.propose_answer, made.propose_acknowledgement),
            *(made.propose_stop, made.propose_diagnosis),
        )
        offer(server, noting, propose, changes=True)
    if may(profile, "act"):
        assert acting is not None
        act = (acting.change_settings, acting.roll_back, acting.answer_findings, acting.acknowledge, acting.stop)
        offer(server, noting, act, changes=True, destructive=True)
        offer(server, noting, (acting.answers,))
    offer_prompts(server, TASKS)
    return server


def rules_of(profile: Profile) -> str:
    """What a client is told first."""
    return f"{SAYS[profile]} {RULES}"


def offer_prompts(server: NotedServer, tasks: tuple[Task, ...]) -> None:
    """Gives a server prompts."""
    for task in tasks:
        server.add_prompt(
            Prompt.from_function(_asked(task), name=task.name, title=task.title, description=task.title)
        )


def offer(
    server: NotedServer,
    noting: Noting,
    tools: tuple[Callable[..., Any], ...],
    *,
    changes: bool = False,
    destructive: bool = False,
) -> None:
    """Gives a server tools whose calls are noted.

    Args:
        server: the server.
        noting: notes the calls.
        tools: the tools.
        changes: whether they change something.
        destructive: whether they may do so without a person.
    """
    hints = ToolAnnotations(read_only_hint=not changes, destructive_hint=destructive, open_world_hint=False)
    for tool in tools:
        name = tool.__name__
        noted = noting.noted(name, tool, changes=changes, always=name == STOP)
        server.add_tool(noted, name=name, annotations=hints)


def _asked(task: Task) -> Callable[[str], str]:
    def asked(about: str) -> str:
        return f"{RULES}\n\n{task.text.format(about=about[:200])}"

    return asked


class Bearer:
    """Lets requests in that carry a token, and no others (RFC 6750, section 2.1).

    Args:
        app: application behind it.
        token: the token.
    """

    def __init__(self, app: Any, token: str) -> None:
        self._app = app
        self._expected = f"Bearer {token}".encode()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            given = dict(scope["headers"]).get(b"authorization", b"")
            if not hmac.compare_digest(given, self._expected):
                headers = [(b"www-authenticate", b"Bearer"), (b"content-length", b"0")]
                await send({"type": "http.response.start", "status": 401, "headers": headers})
                await send({"type": "http.response.body", "body": b""})
                return
        await self._app(scope, receive, send)
