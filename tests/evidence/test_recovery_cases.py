"""The drawn cases, the right answers to them, and the report of the campaign."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import pytest

from dtwin.bus.messages import Done, FaultRequest
from dtwin.controller.proposed import LeastMargins, ProposedSettings
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.emulation.faults import parse_fault, schedule
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import FaultError
from dtwin.identification.machine.record import write_record
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from dtwin.recovery.answers import ANSWERS
from dtwin.recovery.desk import Desk
from dtwin.recovery.measures import Taken
from dtwin.recovery.operator import Step
from dtwin.recovery.tuning import WORSE
from dtwin.services.launch import CellOptions
from dtwin.services.parts.stopping.stops import OWN
from dtwin.signals import Event, EventKind
from dtwin.simulation.proposal import controllable
from dtwin.twin.effects import NO_EFFECTS, Effects
from evidence.recovery.campaign import RecoveryTrial, passed, pushes, recovery_report
from evidence.recovery.cases import DRAWS, RecoveryCase, drawn_case
from evidence.recovery.demonstration import PUSH_AFTER, make_faults, parse_faults
from evidence.recovery.expected import Expected, expected_of, kind_of, made_of
from evidence.recovery.known import KnownArm, recorded_arm
from evidence.recovery.outcome import Recovery, Story, pushed_off
from tests.support.records import recorded

CONTROL = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
TRIAL = RecoveryTrial(
    *(0, "ideal", "K2*=0.9", 0.1, ("K2",), ("refit",), ("refit",), True, "recovered", True, 12.0, False, 1.0, 3.0, "")
)


def test_cases_are_drawn_from_the_whole_table_and_are_possible() -> None:
    cases = [drawn_case(seed) for seed in range(300)]
    assert cases == [drawn_case(seed) for seed in range(300)]
    kinds = {kind_of(fault) for case in cases for fault in case.faults}
    assert kinds == set(DRAWS)
    assert kinds | {"friction", "free"} == set(ANSWERS), "two kinds are hypotheses of the diagnosis alone"
    assert {len(case.faults) for case in cases} == {1, 2}
    assert {case.deliveries for case in cases} == {1, 2, 3}
    for case in cases:
        schedule(ArmParameters(), case.faults)


def test_a_push_that_was_told_is_named_though_no_finding_stands() -> None:
    told = [(9.0, "push of joint 1, confidence 99 %"), (12.5, "push of joint 2, confidence 100 %, since 12.00 s")]
    events = [Event(time, "monitor_push", text) for time, text in told]
    assert pushes([*events, Event(13.0, "monitor_failed", "locked joint of joint 1")], 12.0) == [(12.5, "push2")]
    assert pushes(events, None) == []


@pytest.mark.parametrize(
    ("stopped", "text", "name"),
    [
        (12.3, f"safe stop: braking{OWN}", "push of joint 2"),
        (17.5, f"safe stop: braking{OWN}", ""),
        (12.3, "safe stop: braking (operator: look at it)", ""),
    ],
)
def test_a_push_that_the_blocks_do_not_bear_is_left_to_a_person_who_is_told_of_it(
    stopped: float, text: str, name: str
) -> None:
    events = [Event(12.0, EventKind.FAULT, "push2+=0.5@12-12.2 began"), Event(stopped, EventKind.STOP, text)]
    faults, log = parse_faults(["push2+=0.5"]), cast(Log, SimpleNamespace(events=events))
    assert pushed_off(faults, log, 12.0) == name
    assert not pushed_off(faults, log, 12.1), "that push was over when the faults began"
    stop = (Step(14.0, (), "stop", Taken(None, {})),)
    for told in ("", "push of joint 1", "push of joint 2"):
        story, expected = Story(12.0, steps=stop, cause=told), Expected(frozenset({"stop"}), None)
        run = Recovery(0, faults, expected, story, (), None, "stopped, person told", False, 0.0, 0.0, (), log, name)
        assert run.right == (told == name or not name)


@pytest.mark.parametrize(
    ("faults", "told", "began"),
    [("cut1,push2+=0.3", 10.2, 11.5), ("push2+=0.3", 10.2, 11.5 + PUSH_AFTER), ("cut1", 12.0, 12.0)],
)
def test_what_came_of_faults_is_judged_from_the_first_on(faults: str, told: float, began: float) -> None:
    """A push comes later than what begins with it, and a fault that was asked for late begins when it is known."""
    asked: list[FaultRequest] = []

    def ask(topic: object, request: FaultRequest, reply: type) -> Done:
        asked.append(request)
        return Done(told, "")

    desk = SimpleNamespace(await_event=lambda kind: SimpleNamespace(time=10.0), bus=SimpleNamespace(ask=ask))
    case = RecoveryCase(parse_faults([faults]), deliveries=1, wait=1.5)
    assert make_faults(cast(Desk, desk), case) == pytest.approx(began)
    assert len(asked[0].faults) == len(case.faults)


@pytest.mark.parametrize(
    ("fault", "measures", "ability"),
    [
        ("K2*=0.9", {"refit"}, "as before"),
        ("K2*=0.8", {"stop"}, None),
        ("D1*=3", {"refit"}, "as before"),
        ("supply*=0.9,bias1+=0.01", {"rescale", "offset"}, "as before"),
        ("payload+=0.1", {"stop"}, None),
        ("bias2+=0.01,freeze3", {"stop"}, None),
        ("m2*=1.3", {"stop"}, None),
        ("slip", {"go on"}, "as before"),
        ("cutgripper", {"stop"}, None),
    ],
)
def test_the_right_answer_is_what_physics_allows(fault: str, measures: set[str], ability: str | None) -> None:
    expected = expected_of(parse_faults([fault]), ArmParameters(), CONTROL)
    assert (expected.measures, expected.ability) == (measures, ability)


def test_what_a_machine_has_beside_its_parameters_decides_what_it_can_do() -> None:
    """A motor that no voltage gets through to does not follow its path; back-EMF is a damping."""
    arm, effects = made_of(machine_of("servo"), ArmParameters())
    assert effects.rotor_inertia[0] > 0.0
    assert arm.damping[0] > ArmParameters().damping[0]
    assert made_of(IDEAL, ArmParameters()) == (ArmParameters(), NO_EFFECTS)
    faults, lossy = parse_faults(["supply*=0.85"]), Effects(dead_zone=(2.0, 2.0, 2.0))
    abilities = [expected_of(faults, ArmParameters(), CONTROL, each).ability for each in (NO_EFFECTS, lossy)]
    assert abilities == ["as before", None]


def test_late_commands_leave_as_much_distance_as_settings_with_margins_do() -> None:
    late = parse_faults(["late"])
    expected = expected_of(late, ArmParameters(), CONTROL)
    assert (expected.measures, expected.ability) == ({"margins"}, "as before")
    assert 1.0 < expected.distance <= WORSE
    assert expected_of(parse_faults(["D1*=3"]), ArmParameters(), CONTROL).distance == 1.0
    slow = recorded(Effects(delay=0.03, lag=(0.02,) * 3))
    assert expected_of(late, ArmParameters(), CONTROL, slow.effects, record=slow).measures == {"stop"}


def test_what_is_expected_is_of_the_model_that_the_controller_has_when_a_fault_begins(tmp_path: Path) -> None:
    """An arm that no settings suit has the usual ones, and a controller that knows its rotors."""
    record = recorded(Effects(delay=0.0134, lag=(0.0037,) * 3, rotor_inertia=(0.001, 0.001, 0.002)))
    lacking = LeastMargins(0.1, 3.0, 20.0, 1.0, 0.2)
    refused = ProposedSettings(ControlSettings(), (1.0, 2.0), lacking, lacking, 0.1, "too slow", [])
    record = msgspec.structs.replace(record, settings=refused)
    settings = KnownArm(record.arm, tmp_path / "arm.json", record).control(CellOptions())
    assert settings == replace(CellOptions().control(), model=controllable(record))
    assert settings.model != record.arm
    late, believed = parse_faults(["late"]), replace(settings, model=ArmParameters())
    known, unknown = (
        expected_of(late, record.arm, each, record.effects, record=record) for each in (settings, believed)
    )
    assert unknown.distance > 1.2 * known.distance, "a controller that knows less tracks worse"


def test_an_arm_that_was_commissioned_before_is_known_from_its_record(tmp_path: Path) -> None:
    record, file = recorded(Effects(delay=0.01)), tmp_path / "record.json"
    write_record(record, file)
    known = recorded_arm(file)
    assert known == KnownArm(record.arm, file, record)
    assert known.used(CellOptions()).commissioned == file


def test_a_fault_without_an_answer_is_refused() -> None:
    with pytest.raises(FaultError, match="pads: expected one that the monitor can name"):
        kind_of(parse_fault("pads*=0.5@0"))
    with pytest.raises(FaultError, match="unknown fault target"):
        parse_faults(["K9*=2"])


def test_a_campaign_passes_with_the_shares_that_are_asked_for() -> None:
    good = [TRIAL] * 19
    assert passed([*good, replace(TRIAL, right=False, works=False)])
    assert not passed([*good[1:], *[replace(TRIAL, right=False)] * 2])
    assert not passed([*good[2:], *[replace(TRIAL, works=False)] * 3])
    assert not passed([*good, replace(TRIAL, box_lost=True)])
    text = recovery_report([TRIAL, replace(TRIAL, seed=1, right=False, recovered=None)]).text
    assert "| 0 | ideal | `K2*=0.9` | 0.1 | K2 | refit | yes | recovered | yes | 12.0 | 1.0 V (3.0 V) |" in text
    assert "Right answer: 1 of 2" in text
