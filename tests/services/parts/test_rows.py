"""Rows of the log from streams that come in any order between each other."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.messages import Acted, Path
from dtwin.services.parts.rows import EARLY_LIMIT, LOSSLESS_PATIENCE, PATIENCE, Rows
from dtwin.signals import UNKNOWN, Sensors, StepRecord, Truth, Voltages

COUNT = 12


def sample(k: int) -> Sensors:
    return Sensors(k, 0.01 * k, (float(k), 0.0, 0.0), 0.9, False, "")


def truth(k: int) -> Truth:
    return Truth(0.01 * k, (float(k), 0.0, 0.0), (0.0, 0.0, 0.0), 0.9, 0.0)


def command(k: int, volt: float = 1.0) -> Voltages:
    return Voltages(k, 0.01 * k, (volt, 0.0, 0.0, 0.0), False)


def path(k: int) -> Path:
    return Path(k, 0.01 * k, (float(k), 0.0, 0.0))


class Collected:
    """Rows, what they emitted, and how often a run began anew."""

    def __init__(self, paths: bool = True, runs: int = 1, patience: float = PATIENCE) -> None:
        self.runs = runs
        self.records: list[StepRecord] = []
        self.restarts = 0
        self.rows = Rows(self.records.append, self._restarted, paths, patience)

    def _restarted(self) -> bool:
        self.restarts += 1
        return self.restarts <= self.runs

    def tick(self, k: int, now: float = 0.0) -> None:
        self.rows.sensors(sample(k), now)
        self.rows.truth(truth(k), now)


def test_an_arm_of_which_nobody_knows_the_truth_has_rows_as_well() -> None:
    collected = Collected()
    for k in range(3):
        collected.rows.sensors(sample(k), 0.0)
        collected.rows.answer(command(k), 0.0)
        collected.rows.answer(path(k), 0.0)
    collected.rows.flush()
    assert [record.sensors.sequence for record in collected.records] == [0, 1, 2]
    assert all(record.truth is UNKNOWN for record in collected.records)
    assert collected.rows.late == 0


@given(st.permutations(sorted(["emulator", "command", "path"] * COUNT)))
def test_any_interleaving_of_the_senders_gives_the_same_rows(order: list[str]) -> None:
    collected = Collected()
    done = dict.fromkeys(order, 0)
    for sender in order:
        k = done[sender]
        done[sender] += 1
        if sender == "emulator":
            collected.tick(k)
        else:
            collected.rows.answer(command(k) if sender == "command" else path(k), 0.0)
    collected.rows.flush()
    assert collected.records == [StepRecord(truth(k), sample(k), path(k).theta, command(k)) for k in range(COUNT)]
    assert collected.rows.late == 0


@pytest.mark.parametrize("patience", [PATIENCE, LOSSLESS_PATIENCE])
def test_a_row_waits_only_so_long_and_then_shows_what_held(patience: float) -> None:
    collected = Collected(patience=patience)
    collected.tick(0)
    for answer in (command(0), path(0)):
        collected.rows.answer(answer, 0.0)
    collected.tick(1, 1.0)
    collected.tick(2, 0.9 + patience)
    assert len(collected.records) == 1
    collected.tick(3, 1.1 + patience)
    late = collected.records[1]
    assert late.voltages.volts == command(0).volts
    assert all(map(math.isnan, late.target))
    assert collected.rows.late == 1


def test_a_row_shows_what_acted_and_not_the_command_that_came_too_late() -> None:
    collected = Collected(paths=False)
    collected.tick(0)
    collected.rows.answer(command(0, 1.0), 0.0)
    collected.tick(1)
    collected.rows.answer(command(1, 2.0), 0.0)
    collected.rows.acted(Acted(1, 0.01, (1.0, 0.0, 0.0, 0.0), False), 0.0)
    collected.tick(2)
    collected.rows.acted(Acted(2, 0.02, (0.0, 0.0, 0.0, 0.0), False), 0.0)
    collected.tick(3)
    collected.rows.flush()
    assert [record.voltages.volts[0] for record in collected.records] == [1.0, 1.0, 0.0, 0.0]
    assert [record.voltages.sequence for record in collected.records] == [0, 1, 2, 3]
    assert collected.rows.late == 1, "of the last nobody has told anything"


def test_a_repeated_sample_counts_once_and_the_first_command_too() -> None:
    collected = Collected(paths=False)
    for _ in range(3):
        collected.tick(0)
    collected.rows.answer(command(0, 1.0), 0.0)
    collected.rows.answer(command(0, 2.0), 0.0)
    collected.rows.flush()
    assert [record.voltages.volts[0] for record in collected.records] == [1.0]


def test_numbers_that_go_back_are_another_run() -> None:
    collected = Collected(paths=False)
    for k in (0, 1, 0, 1):
        collected.tick(k)
        collected.rows.answer(command(k), 0.0)
    collected.rows.flush()
    assert collected.restarts == 1
    assert [record.sensors.sequence for record in collected.records] == [0, 1, 0, 1]


def test_hostile_answers_take_no_memory() -> None:
    collected = Collected(paths=False)
    for k in range(3 * EARLY_LIMIT):
        collected.rows.answer(command(k), 0.0)
        collected.rows.answer(command(0), 0.0)
    assert len(collected.rows._early) == EARLY_LIMIT
    assert all(len(early) == 1 for early in collected.rows._early.values())


def test_answers_to_samples_that_never_come_do_not_keep_out_those_that_do() -> None:
    collected = Collected(paths=False)
    for k in range(EARLY_LIMIT):
        collected.rows.answer(command(10_000 + k), 0.0)
    collected.tick(0)
    collected.rows.answer(command(1), 0.0)
    collected.tick(1)
    collected.rows.flush()
    assert collected.records[1].voltages == command(1)
    assert collected.rows.late == 1


def test_after_the_last_run_that_counts_nothing_is_taken_for_part_of_it() -> None:
    collected = Collected(paths=False, runs=1)
    for k in (0, 1, 2, 0, 1, 2, 0, 1, 2, 3, 4):
        collected.tick(k)
        collected.rows.answer(command(k), 0.0)
    collected.rows.flush()
    assert [record.sensors.sequence for record in collected.records] == [0, 1, 2, 0, 1, 2]
