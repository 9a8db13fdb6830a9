"""A log that is judged at once tells of an encoder that jumps what samples tell as they pass."""

from dataclasses import replace

import pytest

from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.monitoring.chain.learning import acquainted
from dtwin.monitoring.chain.sequential import FirstFault
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run

HEALTHY = 20.0


@pytest.mark.parametrize("text", ["bias2+=-0.01@26.88", "bias2+=0.01@22.28"])
def test_a_jump_that_drives_answer_is_found_in_a_log(text: str) -> None:
    settings = ArmCell(arm="planar-2r", machine="2140").settings(34.0, 2140)
    ran = run(replace(settings, faults=(parse_chain_fault(text, 2),)))
    watch = FirstFault(settings.arm, HEALTHY)
    for k in range(0, len(ran.t), 20):
        part = slice(k, k + 20)
        watch.follow(ran.t[part], ran.q[part], ran.target[part], ran.effort[part])
    found = acquainted(settings.arm, ran.samples, HEALTHY).finding
    assert watch.finding is not None
    assert found is not None
    assert (found.cause, found.size) == (watch.finding.cause, pytest.approx(watch.finding.size))
    assert found.cause == "bias2"
