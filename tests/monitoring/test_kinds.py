"""The table of fault kinds, and what a kind that nobody has classified does."""

from dataclasses import replace

import pytest

from dtwin.emulation.faults import TARGETS
from dtwin.errors import ParameterError
from dtwin.monitoring import kinds
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.kinds import JUMPS, KINDS, LIMITS, FaultId, Kind, arm_state, faults, parse_fault_id
from dtwin.monitoring.verdict import finding
from dtwin.parameters import PARAMETER_NAMES, ROOT, symbol_of


def test_a_fault_is_written_as_it_is_read() -> None:
    for kind in KINDS:
        for fault in faults(kind):
            assert parse_fault_id(str(fault)) == fault
    assert parse_fault_id("mu3") == FaultId("mu", 3)
    assert parse_fault_id("payload") == FaultId("payload")
    for target in TARGETS:
        assert str(parse_fault_id(target)) == target
    for text in ("", "2", "K4", "K22", "K 2", "freeze-1"):
        with pytest.raises(ParameterError, match="expected a kind and a joint"):
            parse_fault_id(text)


def test_states_of_the_kinds_are_states_of_the_estimator() -> None:
    for kind in KINDS:
        for fault in faults(kind):
            assert set(fault.states) <= set(INDEX)
    assert set(LIMITS) < set(JUMPS) < set(INDEX)


def test_only_encoders_that_stop_or_drift_hide_the_angles() -> None:
    hiding = {kind for kind in KINDS if arm_state(FaultId(kind)) == "angles unknown"}
    assert hiding == {"freeze", "drift"}


def test_a_kind_that_nobody_has_classified_stops_the_arm_in_the_strongest_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert arm_state(parse_fault_id("rust2")) == "angles unknown"
    monkeypatch.setitem(kinds.KINDS, "rust", Kind("rust in the gears", "torque"))
    found = finding(parse_fault_id("rust2"), since=1.0, detected=1.1)
    assert found.text() == "rust in the gears of joint 2, confidence 100 %, since 1.00 s"
    assert arm_state(found.fault) == "angles unknown"
    monkeypatch.setitem(kinds.KINDS, "rust", replace(KINDS["rust"], angles_known=True))
    assert arm_state(found.fault) == "failed"


def test_what_tells_of_the_same_matter() -> None:
    alike = [("K2", "cut2"), ("D1", "mu1"), ("friction3", "mu3"), ("payload", "slip"), ("lock1", "lock1")]
    other = [("K2", "K1"), ("K2", "D2"), ("bias1", "drift1"), ("freeze1", "lock1"), ("unknown1", "lock1")]
    for pairs, same in ((alike, True), (other, False)):
        for one, two in pairs:
            assert parse_fault_id(one).same_matter(parse_fault_id(two)) is same
            assert parse_fault_id(two).same_matter(parse_fault_id(one)) is same


def test_the_page_lists_the_causes() -> None:
    page = (ROOT / "docs" / "monitoring.md").read_text()
    for kind, row in KINDS.items():
        if kind not in ("friction", "free"):
            assert row.cause in page
            assert f"`{faults(kind)[0]}`" in page


def test_symbols_are_those_of_parameters_alone() -> None:
    assert {symbol_of(name) for name in PARAMETER_NAMES} == {"K", "m", "I", "l", "c", "D", "mu"}
    assert symbol_of("mu3") == "mu"
    with pytest.raises(ParameterError, match="'bias1'"):
        symbol_of("bias1")
