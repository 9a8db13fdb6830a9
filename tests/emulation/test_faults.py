"""The grammar of faults and how they compose."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import GREATEST, MOST_FAULTS, TARGETS, Condition, Fault, parse_fault, schedule
from dtwin.errors import FaultError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters

ARM = ArmParameters()
SCALED = (*PARAMETER_NAMES, "payload", "pads", "supply")
ADDED = tuple(f"{kind}{joint}" for kind in ("bias", "drift", "push") for joint in (1, 2, 3))
FACTORS = tuple(f"scale{joint}" for joint in (1, 2, 3))
times = st.floats(0.0, 1e6)
numbers = st.floats(-GREATEST, GREATEST)


@st.composite
def faults(draw: st.DrawFn) -> Fault:
    target = draw(st.sampled_from(TARGETS))
    one = "+=" if target in ADDED else "*=" if target in FACTORS else ""
    operation = draw(st.sampled_from(("*=", "+=", "=") if target in SCALED else (one,)))
    value = draw(numbers) if operation else 0.0
    if target in FACTORS:
        value = max(abs(value), 1e-6)
    start = draw(times)
    endless = target == "slip" or draw(st.booleans())
    end = math.inf if endless else draw(st.floats(math.nextafter(start, math.inf), 2e6))
    return Fault(target, operation, value, start, end)


@given(faults())
def test_text_and_fault_are_inverse(fault: Fault) -> None:
    assert parse_fault(str(fault)) == fault


@given(faults())
def test_spaces_do_not_matter(fault: Fault) -> None:
    spaced = str(fault).replace("@", " @ ").replace("*=", " *= ").replace("+=", " += ")
    assert parse_fault(f" {spaced} ") == fault


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("K2*=0.1@45", Fault("K2", "*=", 0.1, 45.0)),
        ("D1+=0.05@30-60", Fault("D1", "+=", 0.05, 30.0, 60.0)),
        ("mu1=.02@5", Fault("mu1", "=", 0.02, 5.0)),
        ("payload+=-5e-2@2e1", Fault("payload", "+=", -0.05, 20.0)),
        ("drift3+=0.001@30", Fault("drift3", "+=", 0.001, 30.0)),
        ("freeze2@30-40", Fault("freeze2", "", 0.0, 30.0, 40.0)),
        ("slip@30", Fault("slip", "", 0.0, 30.0)),
    ],
)
def test_examples(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected TARGET .* targets are K1, .* or slip"),
        ("K2*=0.1", "expected TARGET"),
        ("K2*=fast@45", "expected TARGET"),
        ("K2*=nan@45", "expected TARGET"),
        ("K2-=1@45", "expected TARGET"),
        ("K2*=0.1@-45", "expected TARGET"),
        ("K4*=0.1@45", "unknown fault target 'K4': expected K1, K2, .* or slip"),
        ("k2*=0.1@45", "unknown fault target 'k2'"),
        ("K2@45", r"fault K2: expected \*=, \+= or = NUMBER"),
        ("bias1*=2@45", r"fault bias1: expected \+= NUMBER"),
        ("lock1+=2@45", "fault lock1: takes no number"),
        ("K2*=1e999@45", r"a number up to 1e\+06, got inf"),
        ("K2*=-1e7@45", r"a number up to 1e\+06, got -1"),
        ("K2*=0.1@1e10", r"a start from 0 to 1e\+09 s, got 1"),
        ("K2*=0.1@1e999", r"a start from 0 to 1e\+09 s, got inf"),
        ("scale2*=0@45", "expected a factor above 0, got 0"),
        ("scale2+=0.1@45", r"expected \*= NUMBER"),
        ("K2*=0.1@45-45", "expected an end after its start 45.0 s, got 45.0"),
        ("slip@30-40", "slip@START without an end"),
    ],
)
def test_bad_text_says_what_was_expected(text: str, message: str) -> None:
    with pytest.raises(FaultError, match=message) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


@given(st.text(alphabet="KDmupayloadbisfrezck123*+=-@.e 0", max_size=16))
def test_any_text_is_a_fault_or_a_fault_error(text: str) -> None:
    with contextlib.suppress(FaultError):
        fault = parse_fault(text)
        assert parse_fault(str(fault)) == fault


def conditions(*texts: str) -> dict[float, Condition]:
    return {change.time: change.condition for change in schedule(ARM, [parse_fault(text) for text in texts])}


def test_overlapping_faults_compose_and_each_is_undone_alone() -> None:
    at = conditions("D2+=0.05@20-40", "D2*=2@10-30")
    assert [at[t].parameters.damping[1] for t in (10, 20, 30, 40)] == pytest.approx(
        [0.10, 0.15, 0.10, 0.05], abs=1e-15
    )
    assert at[40].parameters == ARM


def test_later_start_applies_last() -> None:
    assert conditions("K1=1@5", "K1*=2@1")[5].parameters.voltage_constant[0] == 1.0
    assert conditions("K1*=2@5", "K1=1@1")[5].parameters.voltage_constant[0] == 2.0


def test_payload_faults_are_affine_in_the_box() -> None:
    at = conditions("payload*=2@1", "payload+=0.05@2", "payload=0.3@3-4")
    assert [at[t].payload(0.2) for t in (1, 2, 3, 4)] == pytest.approx([0.4, 0.45, 0.3, 0.45])


def test_encoder_faults_grow_from_their_start() -> None:
    encoders = conditions("drift3+=0.001@30", "drift3+=0.002@40", "bias3+=0.1@50", "freeze1@50")[50].encoders
    assert encoders.offset[2] + encoders.rate[2] * 60 == pytest.approx(0.1 + 0.001 * 30 + 0.002 * 20)
    assert encoders.frozen == {1}


def test_scales_of_an_encoder_multiply() -> None:
    at = conditions("scale2*=1.02@30-50", "scale2*=0.5@40")
    assert [at[t].encoders.scale for t in (30, 40, 50)] == [(1.0, 1.02, 1.0), (1.0, 0.51, 1.0), (1.0, 0.5, 1.0)]


def test_joints_are_locked_and_cut_between_start_and_end() -> None:
    at = conditions("lock2@1-3", "lock1@2", "cut3@2-3")
    assert [at[t].locked for t in (1, 2, 3)] == [{2}, {1, 2}, {1}]
    assert [at[t].cut for t in (1, 2, 3)] == [set(), {3}, set()]


def test_the_supply_feeds_the_joints_and_a_cut_motor_gets_nothing() -> None:
    at = conditions("supply*=0.5@1", "supply+=0.25@2-3", "cut2@2")
    volts = (4.0, -8.0, 2.0, 1.0)
    assert [at[t].arriving(volts) for t in (1, 2, 3)] == [(2, -4, 1, 1), (3, 0, 1.5, 1), (2, 0, 1, 1)]


def test_pushes_add_up() -> None:
    at = conditions("push2+=0.3@1-3", "push2+=-0.1@2", "push3+=1@2-3")
    assert [at[t].push for t in (1, 2, 3)] == [(0, 0.3, 0), (0, pytest.approx(0.2), 1), (0, -0.1, 0)]


def test_changes_are_told() -> None:
    changes = schedule(ARM, [parse_fault("K2*=0.1@1-2"), parse_fault("slip@2")])
    assert [(change.texts, change.slips) for change in changes] == [
        (("K2*=0.1@1-2 began",), False),
        (("K2*=0.1@1-2 ended", "slip@2 began"), True),
    ]


def test_a_cell_has_only_so_many_faults_that_are_not_over() -> None:
    faults = [parse_fault("K2*=0.5@1-2"), *(parse_fault(f"D1*=1.01@{k}") for k in range(3, MOST_FAULTS + 2))]
    cell = Emulation()
    cell.inject(faults)
    with pytest.raises(FaultError, match=f"at most {MOST_FAULTS} that are not over yet, got {MOST_FAULTS + 1}"):
        cell.inject([parse_fault("slip@50")])
    for _ in range(201):
        cell.advance(0.01)
    cell.inject([parse_fault("slip@50")])
    assert [event.text for event in cell.drain_events() if event.kind == "fault"] == [
        "K2*=0.5@1-2 began",
        "K2*=0.5@1-2 ended",
    ]


def test_faults_that_grow_without_bound_together_are_refused() -> None:
    for target in ("K2", "payload"):
        with pytest.raises(FaultError, match=f"fault {target}"):
            schedule(ARM, [parse_fault(f"{target}*=1e6@{k}") for k in range(60)])


@pytest.mark.parametrize("text", ["m3+=-1@20", "K1=0@5", "I2*=-1@5", "payload+=-0.3@5", "supply*=1.1@2", "pads=-1@3"])
def test_impossible_faults_are_refused_before_the_run(text: str) -> None:
    with pytest.raises(FaultError, match=f"fault {text[:2]}"):
        schedule(ARM, [parse_fault(text)])
