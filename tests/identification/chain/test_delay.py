"""The delay between a logged command and its action, of drawn arms whose efforts were shifted by a known time."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.identification.chain.delay import delays, said_of
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify
from tests.support.chains import drawn_arm, measured


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 11)


def shifted(arm: Arm, late: list[float]) -> Identification:
    """The arm identified from a motion whose commands act so much later, s, joint by joint."""
    log = measured(arm, 25.0, 1, noise=0.01)
    assert log.effort is not None
    early = [np.interp(log.t + time, log.t, column) for time, column in zip(late, log.effort.T, strict=True)]
    return identify(arm, [Sample(replace(log, effort=np.stack(early, axis=1)))], Settings(groups=("rotor", "curve")))


def test_delays_are_found_joint_by_joint(arm: Arm) -> None:
    late = [0.012, 0.0, -0.02]
    found = delays(shifted(arm, late))
    assert [number.name for number in found] == ["joint_1 delay", "joint_2 delay", "joint_3 delay"]
    for number, truth in zip(found, late, strict=True):
        assert abs(number.value - truth) < 1.5 * number.half + 5e-4
        assert number.half < 0.004
    assert [number.told for number in found] == [True, False, True]
    words = said_of(found)
    assert "joint_1 12" in words or "joint_1 11" in words
    assert "joint_2" not in words


def test_nothing_is_said_of_commands_that_act_at_once(arm: Arm) -> None:
    found = delays(shifted(arm, [0.0, 0.0, 0.0]))
    assert all(abs(number.value) < 1.5 * number.half + 2e-4 for number in found)
    assert said_of(found) == ""
