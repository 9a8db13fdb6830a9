"""What the monitor makes of kinds of lies that it once named wrong, in sizes that are not in the table."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.monitoring.estimation.belief import Unmodelled
from tests.outside import drives, readings, watched
from tests.outside.effect import Effect
from tests.outside.table import FAULTS, NAMES
from tests.outside.watched import Work, data_sheet, watch_fault, work
from tests.outside.watched_report import surely, verdict, wrong

KINDS: dict[str, tuple[Effect, tuple[str, ...]]] = {
    "a large jump": (readings.jump(-1.1, joints=(2,)), ("bias2",)),
    "half the scale": (readings.scale(0.5, joints=(1,)), ("scale1", "bias1")),
    "a disk that slips": (readings.slip(-0.08, joints=(2,)), ("scale2",)),
    "pieces of 120 ms": (readings.freeze(every=0.31, length=0.12, joints=(2,)), ("freeze2",)),
    "a long push": (drives.shove(-0.35, length=0.6, start=6.0, joints=(2,)), ("push2",)),
}
"""Faults and what they may be called."""
LACKING = replace(data_sheet(), sheet=False, error=Unmodelled(slow=(0.003, 0.002, 0.002)))
"""What is believed of an arm whose model lacks small torques, as of one that was commissioned."""
NO_LAW: dict[str, Effect] = {
    "a softer cable": drives.spring(0.15, start=5.0, joints=(1,)),
    "other cogs": drives.cogging(0.012, 61),
}
"""What no cause of the monitor's list explains, though each looks like one for a while."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.thorough if name == "a disk that slips" else ()) for name in KINDS]
)
def test_a_kind_is_named_right(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    effect, names = KINDS[name]
    monkeypatch.setitem(watched.KINDS, name, effect)
    found = watch_fault((Work(name, 12, 12), data_sheet()))
    assert found.early == 0
    assert found.findings[0].parameter in names


@pytest.mark.parametrize("name", ["a softer cable", pytest.param("other cogs", marks=pytest.mark.thorough)])
def test_what_follows_no_law_is_unknown(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(watched.KINDS, name, NO_LAW[name])
    found = watch_fault((Work(name, 12, 12), data_sheet()))
    assert found.early == 0
    assert {each.fault.kind for each in found.findings[:1]} <= {"unknown"}
    assert not surely([each for each in found.findings if each.fault.kind != "unknown"])


def test_what_only_takes_energy_from_a_joint_may_be_friction_at_one_angle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(watched.KINDS, "tight", drives.tight_spot(1.1, 1.0))
    found = watch_fault((Work("tight", 5, 5), LACKING)).findings[0]
    assert (found.parameter, found.others[0]) == ("push1", "mu1")
    assert found.confidence == pytest.approx(0.5, abs=0.01)


def test_an_arm_that_rests_after_a_jump_does_not_tell_it_from_another_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(watched.KINDS, "jump", readings.jump(1.4, start=6.2, joints=(2,)))
    found = watch_fault((Work("jump", 23, 23), LACKING)).findings[0]
    assert {found.parameter, *found.others} == {"bias2", "scale2"}
    assert not surely([found])


def test_every_fault_of_the_table_has_its_names() -> None:
    assert NAMES.keys() == FAULTS.keys()


def test_an_effect_changes_nothing_before_it_begins() -> None:
    alone, later = (work(Work(what, 3, 3), 12.0, 2.0) for what in ("nothing", "cogging, 15 mN m, 73 a turn"))
    assert alone.began == np.inf
    assert later.began == pytest.approx(7.0, abs=0.011)
    before = later.log.columns["t"] < later.began
    assert np.array_equal(alone.log.stack("measured")[before], later.log.stack("measured")[before])


def test_a_verdict_on_a_name_is_that_of_the_table() -> None:
    found = watch_fault((Work("motor 2 at 60 %", 4, 4), data_sheet()))
    assert verdict(found.name, found.findings[0]) == "right"
    assert verdict("encoder 1 reads 80 %", found.findings[0]) == "wrong"
    assert surely(wrong("encoder 1 reads 80 %", found.findings[:1])) == found.findings[:1]
    assert verdict("motor 2 at 60 %", None) == "nothing"
