"""A latched stop only grows stronger until the right release."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import ParameterError
from dtwin.services.parts.journal import Journal, carry_over
from dtwin.services.parts.latch import Latch, Latched
from dtwin.signals import STOPS

BRIDGE, OTHER = b"bridge", b"another"
events = st.lists(
    st.one_of(
        st.tuples(st.just("stop"), st.sampled_from(STOPS[1:]), st.sampled_from([BRIDGE, OTHER])),
        st.tuples(st.just("release"), st.integers(0, 4)),
        st.tuples(st.just("command"), st.sampled_from([BRIDGE, OTHER])),
        st.tuples(st.just("harden")),
        st.tuples(st.just("restart")),
        st.tuples(st.just("reset")),
        st.tuples(st.just("carry over")),
    ),
    max_size=30,
)


@pytest.mark.parametrize(("kept", "stop"), [(0, "standstill"), (1, "torque off")], ids=["new", "another arm's"])
def test_a_stop_that_is_not_kept_here_takes_the_torque_off(kept: int, stop: str) -> None:
    latch = Latch(Latched(), lambda changed: None)
    assert latch.stop("standstill", BRIDGE, kept) == (1, stop)
    assert latch.stop("standstill", BRIDGE, 1) == (1, stop)
    latch.release(1)
    assert latch.stop("standstill", BRIDGE) == (2, "standstill")


@given(events)
def test_any_order_of_events_keeps_the_stop_until_the_right_release(
    tmp_path_factory: pytest.TempPathFactory, told: list[tuple[Any, ...]]
) -> None:
    path = tmp_path_factory.mktemp("journal") / "journal"
    journal = Journal(path, 1)
    latch = Latch(journal.latched, journal.latch)
    for what, *words in told:
        number, before = latch.latched
        if what == "stop":
            latch.stop(*words)
        elif what == "release":
            if before != "none" and words[0] != number:
                with pytest.raises(ParameterError, match=f"expected the number {number}"):
                    latch.release(words[0])
            else:
                latch.release(words[0])
                assert latch.latched == (number, "none")
                continue
        elif what == "command":
            passes = latch.passes(words[0])
            assert passes == (latch.latched.stop != "torque off")
        elif what == "harden":
            latch.harden()
        elif what == "reset":
            journal.restart(2)
        else:
            journal.close()
            if what == "carry over":
                carry_over(path, 3)
            journal = Journal(path, 1)
            latch = Latch(journal.latched, journal.latch)
            assert latch.latched.stop in ("none", "torque off")
        assert STOPS.index(latch.latched.stop) >= STOPS.index(before)
        fresh = what == "stop" and before == "none"
        if what != "carry over" or before != "none":
            assert latch.latched.number == number + fresh
        assert journal.latched == latch.latched
    journal.close()


def test_only_the_publisher_that_told_of_the_stop_holds_the_arm() -> None:
    noted: list[Latched] = []
    latch = Latch(Latched(), noted.append)
    assert latch.passes(OTHER)
    latch.stop("braking", BRIDGE)
    latch.stop("standstill", BRIDGE)
    assert latch.passes(BRIDGE)
    assert not latch.passes(OTHER)
    assert not latch.passes(BRIDGE), "nobody knows any longer how the arm is held"
    assert noted == [(1, "braking"), (1, "standstill"), (1, "torque off")]


def test_an_old_release_changes_nothing() -> None:
    latch = Latch(Latched(), lambda latched: None)
    latch.stop("braking", BRIDGE)
    latch.release(1)
    latch.release(1)
    latch.stop("braking", BRIDGE)
    with pytest.raises(ParameterError, match="expected the number 2 of the stop, got 1"):
        latch.release(1)
    assert latch.latched == (2, "braking")
