"""mujoco.sysid beside the identification: fitted where it is installed, and told where it is not."""

from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Array
from dtwin.emulation import peer
from dtwin.errors import DtwinError, ParameterError
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify, unexplained
from dtwin.measurements.measurement import Measurement
from evidence.identification import arms
from evidence.logs import real
from evidence.logs.sysid import ABSENT, Sysid
from tests.support.chains import drawn_arm, measured

needs_peer = pytest.mark.skipif(not peer.is_installed(), reason="pip install 'mujoco[sysid]' to run this")


def found_of(folder: Path) -> Identification:
    arm = drawn_arm(folder, 2, 11)
    return identify(arm, [Sample(measured(arm, 12.0, 1))], Settings(groups=()))


@needs_peer
def test_it_explains_what_it_has_words_for(tmp_path: Path) -> None:
    found, arm = found_of(tmp_path), drawn_arm(tmp_path, 2, 11)
    peer_of = Sysid(arm, [measured(arm, 12.0, 1)], np.ones(2), found.design.scales, found.design.filtering)
    assert peer_of.seconds > 0.0
    assert (unexplained(*peer_of.predicted(measured(arm, 12.0, 7))) < 0.7).all()


def test_a_benchmark_without_it_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("evidence.logs.real.is_installed", lambda: False)
    found = found_of(tmp_path)
    assert real._sysid(found.arm, [], found) == (None, ABSENT)
    assert "pip install 'mujoco[sysid]'" in ABSENT


def test_what_ends_with_an_error_is_told_and_ends_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*words: object) -> None:
        raise DtwinError("mujoco.sysid: it ended")

    monkeypatch.setattr("evidence.logs.real.is_installed", lambda: True)
    monkeypatch.setattr("evidence.logs.sysid.fit_chain", broken)
    found = found_of(tmp_path)
    assert real._sysid(found.arm, [measured(found.arm, 12.0, 1)], found) == (None, "mujoco.sysid: it ended")


@needs_peer
def test_an_error_of_its_search_is_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mujoco import sysid

    def broken(*words: object, **options: object) -> None:
        raise ValueError("no step was found\nand more")

    monkeypatch.setattr(sysid, "optimize", broken)
    found = found_of(tmp_path)
    with pytest.raises(DtwinError, match=r"^mujoco\.sysid ended with an error: no step was found$"):
        Sysid(found.arm, [measured(found.arm, 12.0, 1)], np.ones(2), found.design.scales, found.design.filtering)


def test_shares_of_all_four_stand_side_by_side() -> None:
    tested = real.Tested("a", (0.1,), (0.2,), (), (0.4,))
    assert tested.joints() == [(0.1, 0.2, 0.4)]
    result = real.Benchmark("", "", (tested,), (), (), (1.0, 1.0), "no figaroh", "mujoco.sysid, which took 3.0 s")
    text = real.real_report(result).text
    assert "Against mujoco.sysid, which took 3.0 s the ratio is 0.25" in text
    assert "no figaroh." in text


class _Twice:
    """Explains half of what the identification does, in no time."""

    def __init__(self, *words: object) -> None:
        self.seconds = 0.0

    def predicted(self, measurement: Measurement) -> tuple[Array, Array]:
        effort = np.asarray(measurement.effort)
        return effort, 0.5 * (effort + effort.mean(axis=0))


def test_drawn_machines_of_an_arm_are_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arms, "is_installed", lambda: True)
    monkeypatch.setattr(arms, "Sysid", _Twice)
    result = arms.arms_experiment("planar-2r", 2, 20.0, 5, lambda done, all: None, peers=1)
    (peer_of,) = [one.peer for one in result.machines if one.peer is not None]
    assert peer_of.left == pytest.approx(0.5 / (1.0 - result.fit[0]))
    assert arms.arms_figures(result)["sysid_left"] == [peer_of.left.tolist()]
    assert "geometric means" in arms.arms_report(result).text
    monkeypatch.setattr(arms, "is_installed", lambda: False)
    with pytest.raises(ParameterError, match=r"expected mujoco\.sysid"):
        arms.arms_experiment("planar-2r", 1, 20.0, 5, lambda done, all: None, peers=1)
