"""Drawn arms of six and seven joints whose numbers are known."""

import numpy as np
import pytest

from dtwin.campaign.spread import Workforce
from dtwin.errors import ParameterError
from evidence.synthetic.check import Known, Task, ahead, covered, faster, kept, meet, synthetic_experiment
from evidence.synthetic.machines import drawn_machine, log_of
from evidence.synthetic.report import synthetic_figures, synthetic_report


def known(away: dict[str, float], ours: float = 0.01, peer: float = 0.2, peer_seconds: float = 100.0) -> Known:
    shares = (ours, ours), (0.1, 0.1), (5.0, 0.5), (peer, peer), (ours, ours)
    return Known(1, 2, ("rotor",), away, *shares, peer_seconds, 5.0, (0.3, 0.1))


@pytest.mark.parametrize("joints", [6, 7])
def test_a_machine_is_the_same_everywhere_and_its_log_has_all_columns(joints: int) -> None:
    machine = drawn_machine(3, joints)
    log, again = log_of(machine, 3.0, 1, 2.0), log_of(drawn_machine(3, joints), 3.0, 1, 2.0)
    assert log.effort is not None
    assert log.temperature is not None
    other = log_of(machine, 3.0, 1, 0.0)
    assert again.effort is not None
    assert other.effort is not None
    assert np.array_equal(log.effort, again.effort)
    assert log.q.shape == log.effort.shape == log.temperature.shape == (375, joints)
    assert not np.array_equal(log.effort, other.effort)


def test_what_is_promised_is_counted() -> None:
    """19 of 20 intervals hold the truth; on one machine of two mujoco.sysid predicts better."""
    good = known({f"link{k} mcx": 0.9 for k in range(19)} | {"joint1 rotor": 1.1})
    assert covered([good]) == pytest.approx(0.95)
    assert covered([good], "rotor") == 0.0
    assert ahead([good]) == 1.0
    assert faster([good]) == pytest.approx(20.0)
    assert kept([good])
    assert not kept([known(good.away, ours=0.3)])
    assert not kept([known(good.away, peer_seconds=40.0)])
    assert not kept([known({"load unknown m": 0.1})])
    worse = known(good.away, peer=0.005)
    assert ahead([good, worse]) == 0.5
    assert "95.0% of the 95 % intervals" in synthetic_report([good], 50.0).text
    assert synthetic_figures([good])["covered_by_kind"] == {"mcx": 1.0, "rotor": 0.0}


def test_mujoco_sysid_is_asked_for_only_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evidence.synthetic.check.is_installed", lambda: False)
    with pytest.raises(ParameterError, match="--peers: expected mujoco"):
        synthetic_experiment(1, 0, 20.0, 1, Workforce(1), lambda done, of: None)


@pytest.mark.thorough
def test_intervals_of_drawn_arms_hold_the_truth() -> None:
    """Slow friction was outside in a fifth of all cases, and the nearest possible bodies were not found."""
    found = [meet(Task(number, joints, 50.0)) for number, joints in ((1004, 6), (1007, 7))]
    assert covered(found) >= 0.9
    assert all(one.ratio < 0.3 for one in found)
