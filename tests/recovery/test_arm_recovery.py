"""Recovery of any arm: what is done about every cause, and whole runs in which a fault is found and answered."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.poses import Poses, drawn_poses
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import KINDS, Kind, parse_chain_fault
from dtwin.equations.rigid import usual_inertia
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import passed
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.recovery.chain.answers import MEASURES, ORDERS, answer_to
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run
from dtwin.services.chain.recovery import finding_of
from evidence.arm_sorting import drawn_task, sorting
from evidence.recovery.arms import arm_recovery_report, recovery_case

ARM = arm_of("planar-2r")
NONE = Adjustment.none(2)


def test_every_kind_of_fault_has_an_answer_and_an_order() -> None:
    assert set(MEASURES) == set(ORDERS) == set(KINDS) - {"scale"}  # which the blocks alone know of


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


def test_who_hears_a_verdict_answers_it_as_who_has_made_it() -> None:
    """An encoder that has stopped may look like a joint that does not move."""
    settings = ArmCell(arm="planar-2r", machine="2302").settings(36.0, 2302)
    ran = run(replace(settings, faults=(parse_chain_fault("freeze1@32", 2),)))
    monitor = ArmMonitor(ARM, 30.0)
    monitor.follow(ran.t, ran.q, ran.target, ran.effort)
    (unit,) = monitor.verdict().findings
    assert monitor.finding is not None
    assert monitor.finding.others
    assert finding_of(unit) == monitor.finding


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (replace(NONE, strength=(0.0, 1.0)), "strength of joint 1: expected 0.4 to 2.5, got 0"),
        (replace(NONE, strength=(1.0, math.nan)), "strength of joint 2: expected 0.4 to 2.5, got nan"),
        (replace(NONE, friction=(1.0, -0.1)), "friction of joint 2: expected 0 to 5, got -0.1"),
        (replace(NONE, offset=(math.inf, 0.0)), "offset of joint 1: expected -0.2 to 0.2, got inf"),
        (replace(NONE, offset=(0.0,)), "offset: expected 2 values, one of each joint, got 1"),
        (replace(NONE, load=-9.0), "load: expected at most "),
    ],
)
def test_blocks_must_not_count_on_what_is_out_of_bounds(wrong: Adjustment, said: str) -> None:
    assert wrong.problem(ARM).startswith(said)
    assert not NONE.problem(ARM)


def test_the_blocks_themselves_keep_to_the_bounds() -> None:
    poses = Poses(drawn_poses(ARM, 2, np.random.default_rng(5)).positions, 0.1, True)
    told = Adjustment((5.0, -5.0), (0.0, 1e9), (-1.0, 1e9)), Adjustment((0.2, -0.2), (0.4, 2.5), (0.0, 5.0))
    commands = []
    for adjustment in told:
        controller = ChainController(2, inputs(ARM, usual_inertia(ARM), Control(), poses))
        controller.step(poses.positions[0].tolist())
        controller.adjust(adjustment)
        commands.append([controller.step(poses.positions[0].tolist()) for _ in range(300)])
    assert commands[0] == commands[1]
    assert np.isfinite(commands[0]).all()


def test_a_push_changes_nothing() -> None:
    assert answer_to(ChainFinding(1.0, "push1", 3.0), ARM, NONE).adjustment is None


@pytest.mark.parametrize(
    ("arm", "kind", "machine"),
    [
        ("planar-2r", "K", 3900),
        ("planar-2r", "bias", 3900),
        ("planar-2r", "lock", 3900),
        ("planar-2r", "lock", 3901),
        ("planar-2r", "lock", 3907),
        ("servo-2r", "friction", 3900),
    ],
)
def test_a_fault_of_a_drawn_machine_is_found_and_answered(arm: str, kind: Kind, machine: int) -> None:
    case = recovery_case(arm, machine, np.random.default_rng([machine, 5]), kind)
    assert case.right
    assert not case.early
    assert case.steps[0].answer.measure == MEASURES[kind]
    assert case.stopped == (kind == "lock")
    assert not case.consequences
    assert "1 of 1 right" in str(arm_recovery_report(arm, (case,)).parts[1])


def test_an_arm_that_counts_on_a_further_load_is_not_suspected_of_anything_else() -> None:
    """Its links and gears carry more now, which the healthy arm has not shown."""
    case = recovery_case("six-axis", 5002, np.random.default_rng([5002, 9]), "load", after=20.0)
    assert [step.answer.measure for step in case.steps] == ["load"]
    assert not case.consequences


def test_more_friction_is_told_in_parts_of_what_the_blocks_have() -> None:
    """A machine with twice the data sheet's friction, which then doubles, has four times the data sheet's."""
    settings = ArmCell(arm="planar-2r", machine="nominal").settings(75.0, 3)
    lossy = replace(
        settings.machine.arm,
        joints=tuple(
            replace(
                joint,
                friction=replace(
                    joint.friction, viscous=2.0 * joint.friction.viscous, coulomb=2.0 * joint.friction.coulomb
                ),
            )
            for joint in settings.machine.arm.joints
        ),
    )
    machine = replace(settings.machine, arm=lossy)
    ran = run(replace(settings, machine=machine, faults=(parse_chain_fault("friction1*=2@64", 2),)))
    monitor = ArmMonitor(ARM, 60.0)
    monitor.follow(ran.t, ran.q, ran.target, ran.effort)
    (found,) = monitor.history
    assert found.cause == "friction1"
    assert found.size == pytest.approx(2.0, rel=0.2)
    answer = answer_to(found, ARM, NONE)
    assert answer.adjustment is not None
    assert answer.adjustment.friction == pytest.approx((3.0, 1.0), rel=0.15)
    monitor.adjust(answer.adjustment)
    later = run(replace(settings, machine=machine, duration=30.0, faults=(parse_chain_fault("friction1*=2@0", 2),)))
    monitor.follow(later.t + ran.t[-1], later.q, later.target, later.effort)
    assert monitor.finding is None


def test_an_arm_that_sorts_is_known_by_what_it_does_without_a_box() -> None:
    """Nobody has weighed a box: who took its mass for known would tell another load."""
    cell = ArmCell(arm="planar-2r", machine="7001").settings(160.0, 7001)
    ran = run(sorting(cell, drawn_task(cell.arm, 7001)))
    assert ran.boxes is not None
    assert ran.boxes.delivered > 10
    found = [passed(cell.arm, samples) for samples in (ran.samples._replace(effort=ran.effort), ran.samples)]
    assert [each.watch is not None and each.watch.finding is None for each in found] == [False, True]


def test_boxes_are_counted_while_a_fault_is_answered() -> None:
    case = recovery_case("planar-2r", 3120, np.random.default_rng([3120, 5]), "K", sorts=True)
    assert case.right
    assert case.boxes > 5
    assert case.lost == 0
    assert replace(case, lost=1).right is False
