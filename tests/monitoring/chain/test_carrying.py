"""Pushes on an arm that holds what nobody has weighed: seen beside any load, and nothing else is taken for one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import passed
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run
from evidence.arm_sorting import drawn_task, sorting


@cache
def settings() -> ChainSettings:
    cell = ArmCell(arm="planar-2r", machine="7001").settings(90.0, 7001)
    return sorting(cell, drawn_task(cell.arm, 7001))


@pytest.fixture(scope="module")
def healthy() -> ChainRun:
    return run(settings())


def carried(ran: ChainRun) -> float:
    """A time late in the run at which the elbow is fast and carries, s."""
    laden = np.isnan(ran.unladen[:, 0]) & (ran.t > 70.0) & (ran.t < 84.0)
    speed = np.abs(np.gradient(ran.q[:, 1], settings().arm.period))
    return float(ran.t[np.argmax(np.where(laden, speed, 0.0))])


def found(fault: str) -> ChainFinding | None:
    ran = run(replace(settings(), faults=(parse_chain_fault(fault, 2),)))
    watch = passed(settings().arm, ran.samples, 30.0).watch
    assert watch is not None
    return watch.finding


def test_a_push_is_seen_while_a_box_is_held(healthy: ChainRun) -> None:
    watch = passed(settings().arm, healthy.samples, 30.0).watch
    assert watch is not None
    assert watch.finding is None
    begin = carried(healthy)
    told = found(f"push1+=4@{begin:.2f}-{begin + 0.5:.2f}")
    assert told is not None
    assert told.cause == "push1"
    assert told.size == pytest.approx(4.0, rel=0.1)
    assert 0.0 <= told.time - begin <= 2.0


def test_a_drive_that_grows_weak_while_a_box_is_held_is_no_push(healthy: ChainRun) -> None:
    told = found(f"K2*=0.7@{carried(healthy):.2f}")
    assert told is None or told.cause == "K2"
