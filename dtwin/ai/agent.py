"""A session without any model: a script that finds faults with the tools alone, and answers or proposes the cure.

It knows what a careful reader of the tools' descriptions knows, and nothing of the cell but what they answer.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, Final

from mcp import Client

from dtwin.ai.answering import PASSES, STANDING, STOP
from dtwin.ai.marking import KEY
from dtwin.recovery.answers import MEASURES

SETTLING: Final = 1.0
"""Plant time in which a second finding may follow the first, s."""
LOST: Final = 0.1
"""Weight of a box that a slip has to have taken at least, kg, five standard deviations allowed."""
Call = Callable[..., Awaitable[dict[str, Any]]]


class Refused(Exception):
    """Reports that a tool has refused a call; the message is its reason."""


def caller(client: Client) -> Call:
    """What calls a tool by its name and gives its answer."""

    async def call(name: str, **arguments: Any) -> dict[str, Any]:
        result = await client.call_tool(name, arguments)
        if result.is_error:
            raise Refused(" ".join(getattr(part, "text", "") for part in result.content))
        return result.structured_content or {}

    return call


@dataclass
class Script:
    """A scripted agent.

    Attributes:
        call: calls a tool.
        pause: lets time pass between two looks.
        dealt: time of detection of what was answered, by what it names.
        again: what was answered a second time.
        told: what it did, in words.
        stopped: whether it has stopped the arm.
    """

    call: Call
    pause: Callable[[], Awaitable[None]]
    dealt: dict[str, float] = field(default_factory=dict)
    again: dict[str, float] = field(default_factory=dict)
    told: list[str] = field(default_factory=list)
    stopped: bool = False

    async def time(self) -> float:
        """The plant time, s."""
        return float((await self.call("status"))["plant_time_s"])

    async def new(self) -> list[dict[str, Any]]:
        """Settled findings that were not answered."""
        told = await self.call("findings")
        return [
            each
            for each in told["findings"]
            if each["settled"] and each["measure"] and self.dealt.get(each["parameter"]) != each["detected"]
        ]

    async def find(self, end: float) -> list[dict[str, Any]]:
        """What is found first, with what follows it within SETTLING; nothing when the plant time (s) is over."""
        while not (first := await self.new()):
            if await self.time() >= end:
                return []
            await self.pause()
        if any(each["measure"] == STOP for each in first):
            return first
        until = await self.time() + SETTLING
        while await self.time() < until:
            await self.pause()
        now = {each["parameter"]: each for each in await self.new()}
        lasting = {each["parameter"]: each for each in first if each["measure"] in (PASSES, "payload")}
        return list({**lasting, **now}.values())

    async def propose(self, end: float) -> list[dict[str, Any]]:
        """Finds a fault and proposes the cure, for a person to approve; the proposals."""
        found = await self.find(end)
        made = []
        for measure in sorted({each["measure"] for each in found}, key=_place):
            names = [each["parameter"] for each in found if each["measure"] == measure]
            answer = await self.call("recovery_answer", parameter=names[0])
            sure = min(each["confidence"] for each in found if each["measure"] == measure)
            why = f"{' and '.join(names)} found with a confidence of {sure:.3f}: {measure}, because {answer['why']}"
            made.append(await self.call("propose_answer", why=why, parameters=names))
            self.told.append(f"proposes {measure} for {' and '.join(names)}")
        return made

    async def act(self, end: float) -> None:
        """Answers what is found until the arm is stopped or the plant time (s) is over."""
        while not self.stopped:
            found = await self.find(end)
            if not found:
                return
            for each in [each for each in found if _kept(each)]:
                self.dealt[each["parameter"]] = each["detected"]
                found.remove(each)
            if not found:
                continue
            measures = {each["measure"] for each in found}
            measure = min(measures, key=_place)
            await self._answer(measure, [each for each in found if each["measure"] == measure])

    async def _answer(self, measure: str, found: list[dict[str, Any]]) -> None:
        names = [each["parameter"] for each in found]
        self.dealt |= {each["parameter"]: each["detected"] for each in found}
        if measure == STOP:
            order = (await self.call("recovery_answer", parameter=names[0]))["order"]
            await self._stop(f"{' and '.join(names)}: {order}")
            return
        try:
            await self.call("answer_findings", parameters=names)
        except Refused as refusal:  # It is over, or a limit holds: another look tells.
            self.told.append(str(refusal))
            for name in names:
                del self.dealt[name]
            await self.pause()
            return
        while (told := await self.call("answers"))["busy"]:
            await self.pause()
        came = told["answers"][-1]
        self.told.append(f"{measure} for {' and '.join(names)}: {came['outcome']}")
        if came["outcome"] in STANDING:
            await self._stop(f"{' and '.join(names)}: {came['outcome']}")
        elif came["outcome"] in ("taken back", "failed"):
            again = {each["parameter"]: each["detected"] for each in found}
            if not again.items() <= self.again.items():
                self.again |= again
                for name in names:
                    del self.dealt[name]

    async def _stop(self, why: str) -> None:
        await self.call("stop", why=why[:500])
        self.stopped = True
        self.told.append(f"stops the arm: {why}")


async def reconfigure(call: Call, pause: Callable[[], Awaitable[None]], end: float) -> dict[str, Any] | None:
    """Waits at a line until an arm can no longer do its work, and proposes the best set-up for a person to approve.

    Args:
        call: calls a tool of a server at a line.
        pause: lets time pass between two looks.
        end: plant time until which it waits, s.

    Returns:
        the proposal; None when all arms can do their work until then.
    """
    while True:
        now = await call("status")
        weak = [each for each in (await call("stations"))["stations"] if each["ability"] != "all"]
        if weak:
            break
        if now["time"] >= end:
            return None
        await pause()
    best = await call("best_set_up")
    before, after = _pairs(now["set_up"]), _pairs(best["set_up"])
    changes = {operation: station for operation, station in after.items() if before[operation] != station}
    names = " and ".join(f"{plain(each['name'])} can do {plain(each['ability'])}" for each in weak)
    why = f"{names}; {best['rate']:.1f} boxes/h are expected instead of {best['rate_now']:.1f}"
    return await call("propose_set_up", why=why, based_on=now["version"], set_up=changes)


def plain(text: str | dict[str, str]) -> str:
    """A text of an answer, whether or not it is marked as one of the plant."""
    return text if isinstance(text, str) else text[KEY]


def _pairs(entries: list[dict[str, Any]] | dict[str, Any]) -> dict[str, str]:
    """An object of an answer whose keys may be marked."""
    if isinstance(entries, dict):
        return {name: plain(value) for name, value in entries.items()}
    return {plain(each["name"]): plain(each["value"]) for each in entries}


def _place(measure: str) -> int:
    """Where a measure stands in the order in which they are taken: a stop first, then what changes nothing."""
    first = (STOP, PASSES)
    return first.index(measure) if measure in first else len(first) + MEASURES.index(measure)


def _kept(found: dict[str, Any]) -> bool:
    """Whether a box that is said to have slipped weighs nearly what it did."""
    return bool(found["parameter"] == "slip" and abs(found["size"]) + 5.0 * found["deviation"] < LOST)
