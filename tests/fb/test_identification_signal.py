"""SYS_IDENT_3211SIG, DATA_SELECTOR and EVENT_COUNTER."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.driven import Array, Driven

IDLE, RUNNING = ["CNF"], ["CNF", "SAMPLED"]


def levels(length: int, unit: int, delay: int, amplitude: float) -> Array:
    """The signal: zeros, then +++--+- over and over, each sign for one unit of samples."""
    pattern = np.repeat([1, 1, 1, -1, -1, 1, -1], unit)
    signal = np.concatenate([np.zeros(delay), np.tile(pattern, length // pattern.size + 1)])
    return amplitude * signal[:length]


def run(block: Driven, ticks: int) -> list[list[float]]:
    volts = []
    for _ in range(ticks):
        assert block.fire("REQ") == RUNNING
        assert block["OVERRIDE"]
        volts.append(block.triple("V").tolist())
    return volts


def test_no_signal_without_request() -> None:
    block = Driven("SYS_IDENT_3211SIG")
    for _ in range(5):
        assert block.fire("REQ") == IDLE
        assert not block["OVERRIDE"]


def test_default_signal() -> None:
    block = Driven("SYS_IDENT_3211SIG")
    assert block.fire("SWITCH", REQUEST=True) == []
    expected = np.transpose([levels(350, 5, 0, amplitude) for amplitude in (6.0, 4.0, 3.0)])
    np.testing.assert_array_equal(run(block, 350), expected)
    assert block.fire("REQ") == IDLE
    assert not block["OVERRIDE"]
    assert block.triple("V").tolist() == [0, 0, 0]


@given(
    length=st.integers(1, 60),
    unit=st.integers(1, 9),
    delays=st.lists(st.integers(0, 20), min_size=3, max_size=3),
    amplitudes=st.lists(st.floats(0, 8), min_size=3, max_size=3),
)
def test_any_signal(length: int, unit: int, delays: list[int], amplitudes: list[float]) -> None:
    block = Driven("SYS_IDENT_3211SIG")
    joints: dict[str, Any] = {f"DELAY{j}": delay for j, delay in enumerate(delays, 1)}
    joints |= {f"AMPLITUDE{j}": amplitude for j, amplitude in enumerate(amplitudes, 1)}
    block.fire("SWITCH", REQUEST=True, UNIT=unit, LENGTH=length, **joints)
    expected = [levels(length, unit, delay, amplitude) for delay, amplitude in zip(delays, amplitudes, strict=True)]
    np.testing.assert_array_equal(run(block, length), np.transpose(expected))
    assert block.fire("REQ") == IDLE


@pytest.mark.parametrize("unit", [0, -3])
def test_a_unit_below_one_sample_is_one_sample(unit: int) -> None:
    block = Driven("SYS_IDENT_3211SIG")
    block.fire("SWITCH", REQUEST=True, UNIT=unit)
    np.testing.assert_array_equal(np.array(run(block, 14))[:, 0], levels(14, 1, 0, 6.0))


def test_signal_can_be_ended_and_starts_anew() -> None:
    block = Driven("SYS_IDENT_3211SIG")
    block.fire("SWITCH", REQUEST=True)
    run(block, 40)
    block.fire("SWITCH", REQUEST=False)
    assert block.fire("REQ") == IDLE
    assert not block["OVERRIDE"]
    block.fire("SWITCH", REQUEST=True)
    run(block, 10)
    block.fire("SWITCH", REQUEST=True)
    np.testing.assert_array_equal(np.array(run(block, 350))[:, 1], levels(350, 5, 0, 4.0))
    assert block.fire("REQ") == IDLE


def test_request_taken_back_before_the_first_sample() -> None:
    block = Driven("SYS_IDENT_3211SIG")
    block.fire("SWITCH", REQUEST=True)
    block.fire("SWITCH", REQUEST=False)
    assert block.fire("REQ") == IDLE
    assert not block["OVERRIDE"]


def test_selector_switches_with_its_input_at_once() -> None:
    block = Driven("DATA_SELECTOR")
    volts = {f"V_CONTROL{j}": float(j) for j in (1, 2, 3)} | {f"V_SIGNAL{j}": -float(j) for j in (1, 2, 3)}
    for override in (False, True, True, False, True, False, False):
        assert block.fire("REQ", OVERRIDE=override, **volts) == ["CNF"]
        assert block.triple("V").tolist() == ([-1, -2, -3] if override else [1, 2, 3])


@pytest.mark.parametrize(("limit", "every"), [(1, 1), (2, 2), (7, 7), (0, 1), (-5, 1)])
def test_counter_lets_every_nth_event_through(limit: int, every: int) -> None:
    block = Driven("EVENT_COUNTER")
    passed = [bool(block.fire("REQ", COUNT_LIMIT=limit)) for _ in range(30)]
    assert passed == [n % every == 0 for n in range(1, 31)]
