"""Drawn machines of any arm at work, in circumstances that their blocks do not know of."""

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from dtwin.arm.sorting import Sorting
from dtwin.campaign.spread import Workforce
from dtwin.emulation.chain.arms import arm_of
from dtwin.run.chain import sorting_poses
from evidence.arm_sorting import (
    ELASTIC,
    LATE,
    STIFF,
    USUAL,
    WORN,
    ArmAtWork,
    ArmWork,
    arm_sorting_report,
    at_work,
    circumstances,
    drawn_task,
    settings_of,
    settled,
)

ARM = arm_of("planar-2r")
GOOD = ArmAtWork(1, USUAL, 100, 99, 1, 99, 0, 1.0, 0.05, 0.0, 0)


@pytest.fixture(scope="module")
def task() -> Sorting:
    return drawn_task(ARM, 3)


def test_the_tool_reaches_whatever_is_drawn(task: Sorting) -> None:
    other = drawn_task(ARM, 4)
    assert not np.allclose(other.pick, task.pick)
    assert np.array_equal(drawn_task(ARM, 3).pick, task.pick)
    assert len(sorting_poses(ARM, other).positions) == 9
    assert 0.0 < other.mass[0] < other.mass[1] < ARM.most_load


def test_every_motor_is_weak_once_and_strong_once() -> None:
    assert circumstances(ARM) == (
        USUAL,
        LATE,
        STIFF,
        ELASTIC,
        WORN,
        "K1*=0.8@0",
        "K1*=1.2@0",
        "K2*=0.8@0",
        "K2*=1.2@0",
    )


def test_what_is_otherwise_is_so_in_the_plant_alone(task: Sorting) -> None:
    usual, late, stiff, weak = (
        settings_of(ArmWork("planar-2r", task, 5, under, 1.0)) for under in (USUAL, LATE, STIFF, "K2*=0.8@0")
    )
    assert (usual.late, late.late, late.control.delay) == (0, 1, ARM.period)
    assert [str(fault) for fault in weak.faults] == ["K2*=0.8@0"]
    for joint, sheet in zip(stiff.machine.arm.joints, ARM.joints, strict=True):
        assert joint.friction.coulomb == pytest.approx(np.exp(0.6) * sheet.friction.coulomb)
    for given in (late, stiff, weak):
        kept = [(joint.friction, joint.actuator) for joint in given.arm.joints]
        assert kept == [(joint.friction, joint.actuator) for joint in usual.arm.joints]
    assert stiff.machine.arm.joints[0].actuator == usual.machine.arm.joints[0].actuator


def test_gears_yield_where_the_blocks_know_nothing_of_it(task: Sorting) -> None:
    usual, elastic, worn = (
        settings_of(ArmWork("planar-2r", task, 5, under, 1.0)) for under in (USUAL, ELASTIC, WORN)
    )
    for number, drawn in enumerate(elastic.machine.arm.joints):
        gear, more = drawn.transmission, worn.machine.arm.joints[number].transmission
        assert gear is not None
        assert more is not None
        assert 1e-3 < drawn.largest / gear.stiffness < 4e-3
        assert (more.stiffness, more.backlash) == (gear.stiffness, pytest.approx(3.0 * gear.backlash))
        assert drawn.friction == usual.machine.arm.joints[number].friction
        assert worn.machine.arm.joints[number].friction.coulomb > usual.arm.joints[number].friction.coulomb
    assert (elastic.machine.arm.parameters == usual.machine.arm.parameters).all()


def test_drawn_machines_deliver_boxes_whatever_is_otherwise(task: Sorting) -> None:
    items = [ArmWork("planar-2r", task, 5, under, 25.0) for under in (USUAL, LATE, STIFF, WORN, "K1*=0.8@0")]
    found = at_work(items, Workforce(1), lambda done, of: None)
    assert all(one.exact == one.delivered >= 2 for one in found)
    assert settled(found)
    page = arm_sorting_report("planar-2r", found, 25.0).text
    assert "All was as asked." in page
    assert all(f"| {under} |" in page for under in (USUAL, LATE, STIFF, WORN))


@dataclass(frozen=True)
class Flaw:
    name: str
    value: float


@pytest.mark.parametrize(
    "flaw",
    [
        Flaw("exact", 98),
        Flaw("missed", 1),
        Flaw("saturated", 0.06),
        Flaw("beyond", 1e-3),
        Flaw("stop", 2),
        Flaw("picked", 1),
    ],
    ids=lambda flaw: flaw.name,
)
def test_each_flaw_counts_in_each_circumstance(flaw: Flaw) -> None:
    late = msgspec.structs.replace(GOOD, under=LATE)
    assert settled([GOOD, late])
    exact = {"exact": 0} if flaw.name == "picked" else {}
    spoilt = {flaw.name: flaw.value, **exact}
    assert not settled([GOOD, msgspec.structs.replace(late, **spoilt)])
