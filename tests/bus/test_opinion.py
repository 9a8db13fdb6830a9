"""A verdict counts for a second, and only if it knows all samples that came before that second."""

import math

import msgspec

from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringVerdict
from dtwin.bus.verdicts.opinion import Opinion, is_known, unknown

NOMINAL = MonitoringVerdict(0.0, dict.fromkeys(UNITS, MonitoredUnit("nominal")), (), (), 0, 0)


def at(time: float) -> MonitoringVerdict:
    return msgspec.structs.replace(NOMINAL, time=time)


def running(until: float, opinion: Opinion) -> None:
    """A cell in real time whose monitor speaks twice a second of what came 40 ms before."""
    for tick in range(round(100 * until)):
        now = 0.01 * tick
        opinion.sample(now, now)
        if tick % 50 == 4:
            opinion.update(at(now - 0.04), now)


def test_nothing_is_known_before_the_first_verdict() -> None:
    opinion = Opinion()
    assert not is_known(opinion.current(0.0))
    assert opinion.age(0.0) == math.inf
    assert not is_known(unknown(0.0))


def test_a_monitor_that_speaks_is_believed() -> None:
    opinion = Opinion()
    running(5.0, opinion)
    assert opinion.current(5.0) == at(4.5)
    assert opinion.age(5.0) < 0.5


def test_a_frozen_monitor_is_unknown_after_a_second() -> None:
    opinion = Opinion()
    running(5.0, opinion)
    for tick in range(500, 700):
        opinion.sample(0.01 * tick, 0.01 * tick)
    assert not is_known(opinion.current(7.0))


def test_a_monitor_that_is_behind_is_unknown_although_it_speaks() -> None:
    opinion = Opinion()
    running(5.0, opinion)
    for tick in range(500, 700):
        opinion.sample(0.01 * tick, 0.01 * tick)
        opinion.update(at(4.5 + 0.001 * tick), 0.01 * tick)
    assert not is_known(opinion.current(7.0))
    opinion.update(at(6.9), 7.0)
    assert is_known(opinion.current(7.0))


def test_a_verdict_of_a_cell_that_waits_grows_old() -> None:
    opinion = Opinion()
    running(5.0, opinion)
    assert is_known(opinion.current(5.2))
    assert not is_known(opinion.current(5.6))


def test_a_verdict_of_another_run_says_nothing_of_this_one() -> None:
    opinion = Opinion()
    running(5.0, opinion)
    opinion.sample(0.0, 5.0)
    assert not is_known(opinion.current(5.0))
    opinion.update(at(4.9), 5.1)
    opinion.sample(0.2, 5.2)
    assert not is_known(opinion.current(6.3))


def test_a_verdict_may_come_before_its_sample() -> None:
    opinion = Opinion()
    opinion.sample(1.0, 1.0)
    opinion.update(at(1.02), 1.0)
    opinion.sample(1.02, 1.02)
    assert opinion.age(1.4) == 0.3999999999999999


def test_who_is_excused_is_not_late() -> None:
    opinion = Opinion(10.0, 0.0)
    running(5.0, opinion)
    opinion.sample(8.0, 8.0)
    opinion.excuse(9.0)
    assert opinion.age(9.5) == 0.5
