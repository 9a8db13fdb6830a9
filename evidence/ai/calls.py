"""Random calls in the profile that observes: what they change of a cell, and whether they slow it."""

from __future__ import annotations

import os
import random
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import anyio
from mcp import Client, StdioServerParameters, stdio_client

from dtwin.bus.messages import DESK, SETTINGS, STOP, SUMMARY, SettingsInForce, StopState, Summary
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DeskState
from dtwin.campaign.spread import Progress
from dtwin.services.launch import CellOptions, launched

TOGETHER: Final = 40
"""Number of calls a second, below what the server answers."""
SELDOM: Final = 500
"""Number of calls to which one of a tool comes that computes for seconds."""
SLOW: Final = ("optimise", "margins", "recording_picture")
_WORDS: Final = (
    "stop",
    "K2",
    "payload",
    "",
    "x" * 300,
    "approve 1",
    "../../etc",
    "red",
    "observe",
    "\x00",
    "settings",
)


@dataclass(frozen=True)
class Calls:
    """What came of random calls.

    Attributes:
        calls: number of calls.
        errors: number of those that were answered by an error.
        changed: what differs afterwards; nothing if all is well.
        p99_without: latency from sample to command of a cell without an AI, 99 %, ms.
        p99_with: the same of a cell while the calls were made, ms.
    """

    calls: int
    errors: int
    changed: tuple[str, ...]
    p99_without: float
    p99_with: float


def random_calls(options: CellOptions, count: int, folder: Path, progress: Progress) -> Calls:
    """Runs two cells for equally long, the second one with calls.

    Args:
        options: what the cells are run with; its seed draws the calls, too.
        count: number of calls.
        folder: folder for the histories.
        progress: told how many calls are made.

    Raises:
        CommunicationError: a cell does not come up.
    """
    complete = replace(options, monitoring=True, simulation=True, pace="realtime", history=folder / "history.jsonl")
    with launched(complete) as cell:
        cell.await_ready()
        before = _state(cell.bus)
        errors = anyio.run(_call, complete, count, progress)
        changed = tuple(name for name, value in _state(cell.bus).items() if value != before[name])
        with_calls = cell.bus.ask(SUMMARY, None, Summary)
    ticks = with_calls.ticks
    with launched(complete) as cell:
        cell.await_ready()
        while (without := cell.bus.ask(SUMMARY, None, Summary)).ticks < ticks:
            time.sleep(0.5)
    assert without.latency_ms is not None
    assert with_calls.latency_ms is not None
    return Calls(count, errors, changed, without.latency_ms.p99, with_calls.latency_ms.p99)


def _state(bus: Bus) -> dict[str, Any]:
    """What an AI that observes must not change."""
    return {
        "settings": bus.ask(SETTINGS, None, SettingsInForce),
        "stop": bus.ask(STOP, None, StopState).stop,
        "desk": bus.ask(DESK, None, DeskState).session,
    }


async def _call(options: CellOptions, count: int, progress: Progress) -> int:
    """Makes calls, some of no tool and with arguments of no kind; the number of errors."""
    drawn = random.Random(options.seed)
    words = ["-m", "dtwin", "mcp", "--cell", options.cell, "--audit", str(options.history.parent / "audit.jsonl")]
    server = StdioServerParameters(command=sys.executable, args=words, env=dict(os.environ))
    errors = 0
    async with Client(stdio_client(server)) as client:
        tools = {tool.name: tool.input_schema for tool in (await client.list_tools()).tools}
        names = [name for name in tools if name not in SLOW]
        others = [
            "stop",
            "change_settings",
            "propose_settings",
            "release",
            "approve",
            "propose_stop",
            "answer_findings",
        ]
        began = time.monotonic()
        for number in range(count):
            name = drawn.choice([*names, *others])
            if number % SELDOM == 0:
                name = drawn.choice(SLOW)
            properties = tools.get(name, {}).get("properties", {})
            arguments = {each: _drawn(drawn) for each in properties if drawn.random() < 0.7}
            if name == "optimise":
                arguments = {"candidates": 80}
            errors += (await client.call_tool(name, arguments)).is_error
            progress(number + 1, count)
            await anyio.sleep(max(0.0, began + (number + 1) / TOGETHER - time.monotonic()))
    return errors


def _drawn(drawn: random.Random) -> Any:
    """A value of any kind."""
    return drawn.choice(
        [
            drawn.uniform(-10.0, 1e4),
            drawn.randint(-5, 60),
            drawn.choice(_WORDS),
            [drawn.uniform(0.0, 1000.0) for _ in range(3)],
            None,
            {"a": drawn.choice(_WORDS)},
            True,
        ]
    )
