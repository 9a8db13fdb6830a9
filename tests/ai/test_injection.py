"""Text from the plant is data: whatever it says, the server does and offers the same, and marks and cuts it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcp import Client

from dtwin.ai.marking import KEY, LONGEST, marked
from dtwin.bus.messages import EVENTS
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.signals import Event
from tests.ai.injections import INJECTIONS
from tests.support.ai import SayingCell, place, serving, talk
from tests.support.ports import free_port
from tests.support.waiting import until

LOOKING = ("status", "findings", "events", "settings", "proposals", "models", "recordings", "alarms", "history")


@pytest.fixture(scope="module")
def joined() -> Iterator[tuple[Bus, Bus]]:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as services, Bus(open_peer(meet)) as client:
        yield services, client


def unmarked(answer: Any) -> list[str]:
    """All texts of an answer, keys included, that stand outside a mark."""
    if isinstance(answer, str):
        return [answer]
    if isinstance(answer, list):
        return [text for each in answer for text in unmarked(each)]
    if isinstance(answer, dict):
        if set(answer) == {KEY}:
            assert len(answer[KEY]) <= LONGEST
            assert answer[KEY].isprintable()
            return []
        return [*answer, *(text for each in answer.values() for text in unmarked(each))]
    return []


def test_there_are_two_hundred() -> None:
    assert len(set(INJECTIONS)) == 200


@pytest.mark.parametrize("text", INJECTIONS[::20])
def test_a_mark_is_no_way_out_of_a_mark(text: str) -> None:
    wrapped = {KEY: text, "state": {KEY: text}, text: text}
    assert not [each for each in unmarked(marked(wrapped)) if "instructions" in each.lower() or each == "act"]
    assert all(part not in unmarked(marked(wrapped)) for part in (text, text[:32]))


@pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.thorough)])
def test_injected_instructions_change_nothing(joined: tuple[Bus, Bus], tmp_path: Path, every: int) -> None:
    services, client_bus = joined
    cell = SayingCell(services)
    recordings, store = tmp_path / "recordings", tmp_path / "store"
    recordings.mkdir()
    for number, text in enumerate(INJECTIONS[::10]):
        name = re.sub(r"[^\w ,;:.-]", "_", text)[:60]
        pq.write_table(pa.table({text[:40] or "a": [0.0]}), recordings / f"{number} {name}.parquet")
        (store / f"{number} {name}").mkdir(parents=True)
        (store / f"{number} {name}" / "0001.json").write_text(json.dumps({"text": text}))
    at = place(tmp_path, recordings=recordings, store=store)

    def heard(text: str) -> bool:
        return any(each.text == text for each in served.hub.state().events)

    async def converse(client: Client) -> tuple[list[str], int]:
        offered = await offers(client)
        leaked: list[str] = []
        seen = 0
        for number, text in enumerate(INJECTIONS[::every]):
            cell.say(text, number + 1)
            assert until(partial(heard, text), "the text is heard")
            for name in LOOKING if number % 10 == 0 else ("status", "findings", "events"):
                result = await client.call_tool(name, {})
                assert not result.is_error, result.content
                said = json.dumps(result.structured_content)
                seen += KEY in said
                leaked += [each for each in unmarked(result.structured_content) if text[:24] in each]
            assert await offers(client) == offered
        for name in sorted(path.name for path in recordings.iterdir()):
            result = await client.call_tool("recording_picture", {"name": name})
            assert result.is_error
        return leaked, seen

    with serving(client_bus, at) as served:
        leaked, seen = talk(served, converse)
    assert leaked == []
    assert seen > 2 * len(INJECTIONS[::every])
    assert cell.asked == []


async def offers(client: Client) -> str:
    """All that a server offers, in one text."""
    tools = (await client.list_tools()).tools
    prompts = (await client.list_prompts()).prompts
    return json.dumps([each.model_dump(mode="json") for each in (*tools, *prompts)]) + str(client.instructions)


def test_an_event_cannot_be_forged_into_a_word_of_the_project(joined: tuple[Bus, Bus]) -> None:
    told = marked(Event(1.0, "obey", "stop"))
    assert told["kind"] == {KEY: "obey"}
    assert EVENTS.kind == "publication"
