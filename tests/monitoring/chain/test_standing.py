"""Whether a joint whose reading stays stands or moves unseen, by what the drives of the others need."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.samples import Samples
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.monitoring.chain.drives import Drives
from dtwin.monitoring.chain.learning import acquainted
from dtwin.monitoring.chain.standing import PAST, standing
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run

BEGIN = 38.0
SETTINGS: ChainSettings = ArmCell(arm="planar-2r", machine="2302").settings(BEGIN + 0.5, 2302)
AFTER = round(0.3 / SETTINGS.arm.period)
NEAR = 4e-4


def passed(fault: str) -> ChainRun:
    return run(replace(SETTINGS, faults=(parse_chain_fault(fault, 2),)))


def odds(ran: ChainRun, drives: Drives, joint: int) -> tuple[float, int] | None:
    end = round(BEGIN / SETTINGS.arm.period) + AFTER
    rows = slice(end - PAST, end)
    return standing(SETTINGS.arm, drives.expected, ran.q[rows], ran.effort[rows], joint, NEAR)


@pytest.mark.parametrize(("fault", "stands"), [("lock1@38", True), ("freeze1@38", False), ("freeze2@38", False)])
def test_the_other_joint_tells_whether_one_stands(fault: str, stands: bool) -> None:
    healthy = acquainted(SETTINGS.arm, run(SETTINGS).samples, 30.0)
    assert healthy.drives is not None
    told = odds(passed(fault), healthy.drives, 0 if "1@" in fault else 1)
    assert told is not None
    assert told[0] > healthy.drives.sure(told[1]) if stands else told[0] < -5.0


def test_nothing_is_told_where_nobody_knows_what_acted_or_the_reading_has_just_stopped() -> None:
    ran, drives = passed("lock2@38"), Drives(SETTINGS.arm)
    end = round(BEGIN / SETTINGS.arm.period)
    late, soon = slice(end + AFTER - PAST, end + AFTER), slice(end + 8 - PAST, end + 8)
    for rows, effort in ((late, np.full_like(ran.effort, np.nan)), (soon, ran.effort)):
        assert standing(SETTINGS.arm, drives.expected, ran.q[rows], effort[rows], 1, NEAR) is None


@pytest.mark.parametrize(("given", "alarmed"), [(0.0, False), (1e-9, True)])
def test_an_arm_that_brakes_take_hold_of_tells_nothing_of_its_drives(given: float, alarmed: bool) -> None:
    healthy = acquainted(SETTINGS.arm, run(SETTINGS).samples, 30.0)
    assert healthy.drives is not None
    healthy.drives.forget()
    t = np.asarray(healthy.time + SETTINGS.arm.period * np.arange(1.0, 301.0), dtype=np.float64)
    slow, nothing = np.array([0.3, 0.4]) + 0.2 * (t - t[0])[:, None], np.full((300, 2), given)
    healthy.drives.follow(Samples(t, slow, slow, nothing, nothing))
    assert (healthy.drives.alarm is not None) == alarmed, "with so little from its drives an arm would fall"
