"""The two halves of a tick, which come from different senders, are put together."""

from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.pairs import WAITING, Pairs
from dtwin.signals import Sensors, Voltages


def sample(number: int) -> Sensors:
    return Sensors(number, 0.01 * number, (0.0, 0.0, 0.0), 0.9, False, "none")


def command(number: int) -> Voltages:
    return Voltages(number, 0.01 * number, (0.0, 0.0, 0.0, 0.0), False)


@given(st.permutations([(number, half) for number in range(8) for half in (0, 1)]))
def test_every_tick_comes_once_in_whatever_order(order: list[tuple[int, int]]) -> None:
    pairs: Pairs[Sensors, Voltages] = Pairs()
    found = [pairs.second(command(number)) if half else pairs.first(sample(number)) for number, half in order]
    complete = [pair for pair in found if pair is not None]
    assert sorted(s.sequence for s, _ in complete) == list(range(8))
    assert all(s.sequence == c.sequence for s, c in complete)


def test_what_waits_is_bounded_and_can_be_forgotten() -> None:
    pairs: Pairs[Sensors, Voltages] = Pairs()
    for number in range(WAITING + 10):
        assert pairs.first(sample(number)) is None
    assert pairs.second(command(9)) is None
    assert pairs.second(command(10)) is not None
    pairs.clear()
    assert pairs.second(command(11)) is None
