"""The event-driven timers: when Q changes after what they are told, and that they tell it."""

from __future__ import annotations

import pytest

from tests.support.iec61499.networks import Bench

STEPS = 12
"""Steps of 1 ms."""


def course(kind: str, told: dict[int, bool | str], **times: str) -> list[int]:
    """The steps after which Q is true; told are an input with a request, or the event of that name, before a step."""
    bench, seen, before = Bench(kind, parameters=times), [], False
    for step in range(STEPS):
        event = told.get(step)
        events = []
        if isinstance(event, str):
            events = bench.fire(event)
        elif event is not None:
            events = bench.fire("REQ", IN=event)
        events += bench.advance(1)
        assert events == ["CNF"] * (bench["Q"] != before)
        before = bool(bench["Q"])
        if before:
            seen.append(step)
    return seen


def span(first: int, end: int) -> list[int]:
    return list(range(first, end))


@pytest.mark.parametrize(
    ("kind", "told", "times", "expected"),
    [
        ("E_PULSE", {1: "REQ"}, {"PT": "T#4ms"}, span(1, 4)),
        ("E_PULSE", {1: "REQ", 3: "REQ"}, {"PT": "T#4ms"}, span(1, 4)),
        ("E_PULSE", {1: "REQ", 3: "R"}, {"PT": "T#9ms"}, span(1, 3)),
        ("E_TP", {1: True, 2: False}, {"PT": "T#4ms"}, span(1, 4)),
        ("E_TP", {1: False}, {"PT": "T#4ms"}, []),
        ("E_TP", {1: True, 3: "R"}, {"PT": "T#9ms"}, span(1, 3)),
        ("E_TON", {1: True, 8: False}, {"PT": "T#4ms"}, span(4, 8)),
        ("E_TON", {1: True, 3: False}, {"PT": "T#4ms"}, []),
        ("E_TOF", {1: True, 3: False}, {"PT": "T#4ms"}, span(1, 6)),
        ("E_TOF", {1: True, 3: False, 4: True}, {"PT": "T#4ms"}, span(1, STEPS)),
        ("E_TOF", {1: True, 3: False, 4: "R"}, {"PT": "T#4ms"}, span(1, 4)),
        ("E_TONOF", {1: True, 6: False}, {"PT_ON": "T#3ms", "PT_OFF": "T#4ms"}, span(3, 9)),
        ("E_TONOF", {1: True, 2: False, 3: True}, {"PT_ON": "T#3ms", "PT_OFF": "T#4ms"}, span(5, STEPS)),
        ("E_TONOF", {1: True, 6: "R"}, {"PT_ON": "T#3ms", "PT_OFF": "T#4ms"}, span(3, 6)),
    ],
)
def test_q_follows_what_the_timer_is_told(
    kind: str, told: dict[int, bool | str], times: dict[str, str], expected: list[int]
) -> None:
    assert course(kind, told, **times) == expected
