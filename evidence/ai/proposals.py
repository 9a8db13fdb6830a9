"""Bad changes by an AI that acts: each is refused by a limit or a check, or taken back by its trial."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import anyio
from mcp import Client

from dtwin.ai.profiles import Limits
from dtwin.ai.serving import Place, served
from dtwin.bus.messages import SUMMARY, UPLOAD, Summary
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload
from dtwin.campaign.spread import Progress
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.services.launch import CellOptions, launched

FREELY: Final = Limits(hourly=10_000, pause=0.0, factor=1e9)
"""No limits: it is to be seen what the checks and the trial do."""
KINDS: Final = ("out of range", "without margins", "out of reach", "old version", "wrong mass")
LOOK: Final = 0.2


@dataclass(frozen=True)
class Bad:
    """A bad change and what became of it.

    Attributes:
        kind: what is bad about it.
        outcome: refused, taken back or confirmed.
        text: the reason.
    """

    kind: str
    outcome: str
    text: str


@dataclass(frozen=True)
class BadChanges:
    """What became of bad changes.

    Attributes:
        changes: each.
        misplaced: number of boxes that were lost.
    """

    changes: tuple[Bad, ...]
    misplaced: int


def bad_changes(options: CellOptions, count: int, folder: Path, clocks: Clocks, progress: Progress) -> BadChanges:
    """Runs a cell, and has an AI without limits change its settings badly.

    Args:
        options: what the cell is run with; its seed draws the changes, too.
        count: number of changes.
        folder: folder for the history.
        clocks: clocks of the server.
        progress: told how many are done.

    Raises:
        CommunicationError: the cell does not come up.
    """
    complete = replace(options, simulation=True, pace="lockstep", history=folder / "history.jsonl")
    drawn = random.Random(options.seed)
    with launched(complete) as cell:
        cell.await_ready()
        files = Files(folder / "store", complete.history)
        audit, alarms = folder / "audit.jsonl", folder / "alarms.jsonl"
        place = Place(options.cell, options.arm, "act", "ai", files, alarms, audit, FREELY)
        found: list[Bad] = []

        async def converse() -> None:
            async with Client(made.server) as client:
                for number in range(count):
                    found.append(await _change(client, cell.bus, drawn, KINDS[number % len(KINDS)]))
                    progress(number + 1, count)

        with served(cell.bus, place, clocks) as made:
            anyio.run(converse)
        boxes = cell.bus.ask(SUMMARY, None, Summary).boxes
    return BadChanges(tuple(found), 0 if boxes is None else boxes.misplaced)


async def _change(client: Client, bus: Bus, drawn: random.Random, kind: str) -> Bad:
    while (now := bus.ask(UPLOAD, None, Upload)).on_trial:
        await anyio.sleep(LOOK)
    result = await client.call_tool("change_settings", _arguments(now, drawn, kind))
    if result.is_error:
        return Bad(kind, "refused", getattr(result.content[0], "text", ""))
    while (after := bus.ask(UPLOAD, None, Upload)).on_trial:
        await anyio.sleep(LOOK)
    return Bad(kind, "taken back" if after.action == "roll back" else "confirmed", after.text)


def _arguments(now: Upload, drawn: random.Random, kind: str) -> dict[str, Any]:
    change: dict[str, Any] = {"why": f"to try what is {kind}", "based_on": now.version}
    if kind == "out of range":
        return {**change, "kp": [drawn.uniform(1e5, 1e9)] * 3, "target_time": drawn.uniform(-5.0, 0.1)}
    if kind == "without margins":
        return {**change, "kp": [drawn.uniform(5.0, 50.0) * value for value in now.gains.kp]}
    if kind == "out of reach":
        return {**change, "target_time": drawn.uniform(0.1, 0.7)}
    if kind == "wrong mass":
        return {**change, "assumed_box": drawn.uniform(0.7, 1.0)}
    return {**change, "based_on": max(0, now.version - drawn.randint(1, 5)), "target_time": 3.0}
