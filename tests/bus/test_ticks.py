"""What acted after each sample, from messages in any order that their senders can give them."""

from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.messages import Acted
from dtwin.bus.ticks import APART, Ticks
from dtwin.signals import Sensors, Voltages

COUNT = 10


def sample(number: int) -> Sensors:
    return Sensors(number, 0.01 * number, (0.0, 0.0, 0.0), 0.9, False, "")


def command(number: int) -> Voltages:
    return Voltages(number, 0.01 * number, (1.0, 0.0, 0.0, 0.0), False)


def acted(number: int) -> Acted:
    return Acted(number, 0.01 * number, (0.5, 0.0, 0.0, 0.0), False)


@given(st.sets(st.integers(0, COUNT - 1)), st.permutations(["emulator", "bridge"] * COUNT))
def test_every_tick_comes_once_in_order_with_what_acted(late: set[int], order: list[str]) -> None:
    """The emulator tells what acted before the next sample; commands come whenever they come."""
    ticks, done, sent = Ticks(), [], {"emulator": 0, "bridge": 0}
    for sender in order:
        number = sent[sender]
        sent[sender] += 1
        if sender == "bridge":
            done += ticks.add(command(number))
            continue
        done += ticks.add(sample(number))
        if number in late:
            done += ticks.add(acted(number))
    assert done == [(sample(k), acted(k) if k in late else command(k)) for k in range(COUNT - 1)]


def test_a_sample_whose_command_never_came_is_not_waited_for() -> None:
    ticks = Ticks()
    assert ticks.add(sample(0)) == []
    assert ticks.add(acted(0)) == []
    assert ticks.add(sample(1)) == [(sample(0), acted(0))]


def test_a_sample_of_which_nobody_tells_anything_is_left_out() -> None:
    ticks = Ticks()
    done = []
    for k in range(40):
        done += ticks.add(sample(k))
        if k != 3:
            done += ticks.add(command(k))
    assert [tick[0].sequence for tick in done] == [0, 1, 2, *range(4, 39)]


def test_commands_that_a_busy_machine_keeps_back_are_waited_for() -> None:
    ticks = Ticks()
    assert [tick for k in range(APART) for tick in ticks.add(sample(k))] == []
    done = [tick for k in range(APART - 1) for tick in ticks.add(command(k))]
    assert done == [(sample(k), command(k)) for k in range(APART - 1)]


def test_nothing_is_waited_for_for_ever() -> None:
    ticks = Ticks()
    for k in range(3 * APART):
        ticks.add(sample(k))
    assert len(ticks._samples) <= APART


def test_a_repeated_sample_is_one_and_numbers_that_go_back_are_another_run() -> None:
    ticks = Ticks()
    messages: list[Sensors | Voltages] = [
        sample(7),
        sample(7),
        command(7),
        sample(0),
        command(0),
        sample(1),
        command(1),
        sample(2),
    ]
    done = [tick for message in messages for tick in ticks.add(message)]
    assert done == [(sample(0), command(0)), (sample(1), command(1))]


def test_stray_commands_take_no_memory() -> None:
    ticks = Ticks()
    for number in range(3 * APART):
        ticks.add(command(number))
    ticks.add(sample(5))
    for number in range(3 * APART):
        ticks.add(command(number))
        ticks.add(acted(number))
    assert len(ticks._commands) <= 2 * APART
    assert len(ticks._acted) == 1
