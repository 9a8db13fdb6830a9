"""Recovery of any arm: what is done about every cause, and whole runs in which a fault is found and answered."""

import numpy as np
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import KINDS, Kind
from dtwin.experiments.recovery.arms import arm_recovery_report, recovery_case
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.recovery.chain.answers import MEASURES, ORDERS, answer_to

ARM = arm_of("planar-2r")
NONE = Adjustment.none(2)


def test_every_kind_of_fault_has_an_answer_and_an_order() -> None:
    assert set(MEASURES) == set(ORDERS) == set(KINDS)


@pytest.mark.parametrize(
    ("found", "adjusted"),
    [
        (ChainFinding(1.0, "bias2", 0.01), Adjustment((0.0, 0.01), (1.0, 1.0), (1.0, 1.0))),
        (ChainFinding(1.0, "K1", 0.25), Adjustment((0.0, 0.0), (0.75, 1.0), (1.0, 1.0))),
        (ChainFinding(1.0, "friction2", 1.0), Adjustment((0.0, 0.0), (1.0, 1.0), (1.0, 2.0))),
        (ChainFinding(1.0, "load", 0.2), Adjustment((0.0, 0.0), (1.0, 1.0), (1.0, 1.0), 0.2)),
    ],
)
def test_the_blocks_count_on_what_can_be_compensated(found: ChainFinding, adjusted: Adjustment) -> None:
    assert answer_to(found, ARM, NONE).adjustment == adjusted


def test_a_further_finding_adds_to_what_the_blocks_count_on() -> None:
    first = answer_to(ChainFinding(1.0, "K1", 0.2), ARM, NONE).adjustment
    assert first is not None
    second = answer_to(ChainFinding(9.0, "K1", 0.1), ARM, first).adjustment
    assert second is not None
    assert second.strength == pytest.approx((0.72, 1.0))


@pytest.mark.parametrize(
    "found",
    [
        ChainFinding(1.0, "lock1", 0.0),
        ChainFinding(1.0, "freeze2", 0.0, ("lock2",)),
        ChainFinding(1.0, "K1", 0.65),
        ChainFinding(1.0, "K1", 0.5, ("lock1",)),
        ChainFinding(1.0, "bias1", 0.3),
        ChainFinding(1.0, "load", 0.6),
        ChainFinding(1.0, "friction1", 4.5),
    ],
)
def test_what_cannot_be_compensated_stops_the_arm_and_calls_a_person(found: ChainFinding) -> None:
    answer = answer_to(found, ARM, NONE)
    assert (answer.measure, answer.adjustment) == ("stop", None)
    assert answer.text.endswith("then `dtwin release`")


def test_a_push_changes_nothing() -> None:
    assert answer_to(ChainFinding(1.0, "push1", 3.0), ARM, NONE).adjustment is None


@pytest.mark.parametrize("kind", ["K", "bias", "lock"])
def test_a_fault_of_a_drawn_machine_is_found_and_answered(kind: Kind) -> None:
    case = recovery_case("planar-2r", 3900, np.random.default_rng([3900, 5]), kind)
    assert case.right
    assert not case.early
    assert case.steps[0].answer.measure == MEASURES[kind]
    assert case.stopped == (kind == "lock")
    assert "1 of 1 right" in str(arm_recovery_report("planar-2r", (case,)).parts[1])
