"""Samples count while their numbers can follow one another."""

from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.following import AHEAD, AWAY, Following
from dtwin.signals import LARGEST_COUNT, Sensors


class Listener:
    """What passed, and why the rest did not."""

    def __init__(self) -> None:
        self.passed: list[int] = []
        self.refused: Counter[str] = Counter()
        self._following = Following(
            lambda sample: self.passed.append(sample.sequence), lambda reason, detail: self.refused.update([reason])
        )

    def receive(self, *numbers: int) -> None:
        for number in numbers:
            self._following(Sensors(number, 0.01, (0.0, 0.0, 0.0), 0.9, False, ""))


def test_gaps_repetitions_and_new_runs_pass() -> None:
    listener = Listener()
    numbers = (0, 1, 1, 500, 500 + AHEAD, 3, 4, 0)
    listener.receive(*numbers)
    assert listener.passed == list(numbers)


@given(st.lists(st.integers(AHEAD + 1000, LARGEST_COUNT) | st.just(10**12), max_size=3), st.integers(1, 50))
def test_numbers_far_ahead_change_nothing_for_those_that_follow(strays: list[int], count: int) -> None:
    listener = Listener()
    for number in range(count):
        listener.receive(number, *strays)
    assert listener.passed == list(range(count))
    assert listener.refused == Counter({"far ahead": len(strays) * count} if strays else {})


def test_a_listener_that_was_away_hears_again() -> None:
    listener = Listener()
    late = 10 * AHEAD
    listener.receive(0, *range(late, late + AWAY + 10))
    assert listener.passed == [0, *range(late + AWAY - 1, late + AWAY + 10)]
    assert listener.refused == {"far ahead": AWAY - 1}
