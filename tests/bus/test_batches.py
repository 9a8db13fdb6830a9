"""Messages that wait for each other before they wake the main thread."""

from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.batches import Batches
from dtwin.signals import Sensors, Voltages


def sample(number: int) -> Sensors:
    return Sensors(number, 0.01 * number, (0.0, 0.0, 0.0), 0.9, False, "")


def command(number: int) -> Voltages:
    return Voltages(number, 0.01 * number, (1.0, 0.0, 0.0, 0.0), False)


class Woken:
    """A main thread that takes what waits whenever it is woken."""

    def __init__(self, size: int) -> None:
        self.came: list[list[object]] = []
        self.batches = Batches(lambda: self.came.append(self.batches.take()))
        self.batches.size = size


@given(st.integers(1, 8), st.lists(st.booleans(), max_size=60))
def test_what_is_put_comes_once_in_order_and_no_sample_waits_for_more_than_the_size(
    size: int, lost: list[bool]
) -> None:
    woken, put = Woken(size), []
    for number in range(1, len(lost) + 1):
        for message in [command(number - 1)] + [sample(number)] * (not lost[number - 1]):
            put.append(message)
            woken.batches.put(message)
        waiting = [m for m in put[sum(map(len, woken.came)) :] if isinstance(m, Sensors)]
        assert len(waiting) < size
    assert [message for batch in [*woken.came, woken.batches.take()] for message in batch] == put
    assert woken.batches.take() == []


def test_a_batch_is_complete_with_the_first_sample_after_a_multiple_of_the_size() -> None:
    woken = Woken(5)
    for number in range(13):
        woken.batches.put(sample(number))
        woken.batches.put(command(number))
    last = [[m.sequence for m in batch if isinstance(m, Sensors)][-1] for batch in woken.came]
    assert last == [1, 6, 11]


def test_every_sample_wakes_where_none_may_wait() -> None:
    woken = Woken(1)
    for number in (4, 5, 7, 0, 1):
        woken.batches.put(sample(number))
    assert [len(batch) for batch in woken.came] == [1] * 5
