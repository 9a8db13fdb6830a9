"""Ticks that are told together once they have passed."""

from dtwin.bus.following import AHEAD, following_ticks
from dtwin.bus.messages import TOGETHER, PassedTicks
from dtwin.bus.passed import Passed, Prompt
from dtwin.bus.ticks import Tick
from dtwin.signals import Sensors, Voltages


def tick(number: int) -> tuple[Sensors, Voltages]:
    time = 0.01 * number
    return Sensors(number, time, (0.1, 0.2, 0.3), 0.9, False, ""), Voltages(number, time, (1.0, 2.0, 3.0, 4.0), True)


def test_every_tick_is_told_once_with_what_acted_up_to_a_multiple() -> None:
    told: list[PassedTicks] = []
    passed = Passed(told.append)
    for number in range(3, 2 * TOGETHER + 4):
        passed.add(*tick(number))
    assert [[each.sensors.sequence for each in message.ticks] for message in told] == [
        [*range(3, TOGETHER + 1)],
        [*range(TOGETHER + 1, 2 * TOGETHER + 1)],
    ]
    passed.tell()
    passed.tell()
    assert [each.sensors.sequence for each in told[-1].ticks] == [2 * TOGETHER + k for k in (1, 2, 3)]
    assert len(told) == 3
    for each in (each for message in told for each in message.ticks):
        sensors, command = tick(each.sensors.sequence)
        assert each.sensors == sensors
        assert (each.acted.volts, each.acted.box_gripped) == (command.volts, command.box_gripped)


def test_ticks_whose_numbers_cannot_follow_are_refused() -> None:
    told: list[PassedTicks] = []
    passed = Passed(told.append)
    for number in (4, 5, AHEAD + 6, 2 * TOGETHER):
        passed.add(*tick(number))
    passed.tell()
    taken: list[Tick] = []
    refused: list[str] = []
    receive = following_ticks(taken.extend, lambda reason, detail: refused.append(reason))
    for message in told:
        receive(message)
    assert [sensors.sequence for sensors, _ in taken] == [4, 5, 2 * TOGETHER]
    assert refused == ["far ahead"]


def test_one_who_may_have_to_know_at_once_gets_every_tick_once_and_none_waits_for_more_than_the_size() -> None:
    for size, expected in ((1, [[number] for number in range(1, 12)]), (5, [[1, 2, 3, 4, 5], [6, 7, 8, 9, 10]])):
        taken: list[list[Tick]] = []
        prompt = Prompt(taken.append)
        prompt.size = size
        for number in range(1, 13):
            sensors, command = tick(number)
            prompt.put(sensors)
            prompt.put(command)
        assert [[sensors.sequence for sensors, _ in together] for together in taken] == expected
    assert all(command.volts == (1.0, 2.0, 3.0, 4.0) for together in taken for _, command in together)
