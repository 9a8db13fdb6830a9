"""Which commands the arm obeys."""

import itertools
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import ParameterError
from dtwin.services.parts.gate import RIVAL_COMMANDS, RIVAL_GAP, STALE, Gate
from dtwin.signals import Voltages


def command(sequence: int) -> Voltages:
    return Voltages(sequence, 0.01 * sequence, (0.0, 0.0, 0.0, 0.0), False)


class Guarded:
    """A gate and what it refused."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.gate = Gate(lambda reason, detail: self.refused.update([reason]))

    def answered(self) -> bool:
        return self.gate.answered

    def admit(self, sequence: int, now: float = 0.0) -> bool:
        return self.gate.admit(command(sequence), now, now)


def test_the_answer_to_the_expected_sample_counts_once() -> None:
    guarded = Guarded()
    guarded.gate.expected = 5
    assert not guarded.answered()
    assert guarded.admit(5)
    assert guarded.answered()
    assert not guarded.admit(5)
    assert guarded.refused == {"duplicate": 1}


def test_a_sample_that_was_published_again_may_be_answered_again() -> None:
    guarded = Guarded()
    for sequence in range(2 * RIVAL_COMMANDS):
        guarded.gate.expected = sequence
        guarded.gate.repeated = sequence
        assert guarded.admit(sequence)
        assert not guarded.admit(sequence)
    assert not guarded.refused
    assert not guarded.gate.rivals
    for sequence in range(2 * RIVAL_COMMANDS, 3 * RIVAL_COMMANDS):
        guarded.gate.expected = sequence
        assert guarded.admit(sequence)
        assert not guarded.admit(sequence)
    assert guarded.gate.rivals


def test_a_late_answer_still_counts_while_no_newer_one_has_come() -> None:
    guarded = Guarded()
    guarded.gate.expected = 5
    assert guarded.admit(3)
    assert not guarded.answered()
    assert not guarded.admit(2)
    assert guarded.refused == {"out of sequence": 1}


def test_an_answer_to_a_sample_that_is_too_old_does_not_count() -> None:
    guarded = Guarded()
    guarded.gate.expected = 9
    assert guarded.gate.admit(command(3), 1.0, 1.0 - 0.9 * STALE)
    assert not guarded.gate.admit(command(4), 1.0, 1.0 - 1.1 * STALE)
    assert guarded.refused == {"late": 1}
    assert guarded.gate.is_stale(1.0 + 1.1 * STALE), "what does not count is no sign of life"
    assert guarded.gate.admit(command(9), 9.0, 1.0), "the sample that waits for its answer is not too old"


def test_answers_to_samples_not_yet_sent_are_refused() -> None:
    guarded = Guarded()
    guarded.gate.expected = 5
    assert not guarded.admit(6)
    assert guarded.refused == {"from the future": 1}
    assert guarded.admit(5)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(-3, 8)), max_size=40))
def test_taken_commands_increase_and_never_lead(steps: list[tuple[int, int]]) -> None:
    guarded = Guarded()
    taken = []
    for advance, offset in steps:
        guarded.gate.expected += advance
        sequence = guarded.gate.expected + offset
        if sequence >= 0 and guarded.admit(sequence):
            taken.append(sequence)
            assert sequence <= guarded.gate.expected
    assert all(a < b for a, b in itertools.pairwise(taken))


def test_commands_grow_stale_only_after_the_first() -> None:
    guarded = Guarded()
    assert not guarded.gate.is_stale(1e9)
    guarded.admit(0, now=10.0)
    assert not guarded.gate.is_stale(10.0 + 0.99 * STALE)
    assert guarded.gate.is_stale(10.0 + 1.01 * STALE)
    guarded.gate.restart(0)
    assert not guarded.gate.is_stale(1e9)


def test_repeated_duplicates_prove_a_second_publisher() -> None:
    guarded = Guarded()
    for k in range(RIVAL_COMMANDS):
        assert not guarded.gate.rivals
        guarded.gate.expected = k
        assert guarded.admit(k)
        assert not guarded.admit(k)
    assert guarded.gate.rivals


def test_rare_duplicates_prove_nothing() -> None:
    guarded = Guarded()
    for k in range(0, 10 * (RIVAL_GAP + 1), RIVAL_GAP + 1):
        guarded.gate.expected = k
        guarded.admit(k)
        guarded.admit(k)
    assert not guarded.gate.rivals


def test_a_gate_needs_a_time() -> None:
    with pytest.raises(ParameterError, match="above 0"):
        Gate(lambda reason, detail: None, 0.0)
