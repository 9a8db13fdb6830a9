"""The operator's decisions, at a bus whose services answer at once."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import msgspec
import pytest

from dtwin.bus.session import Bus
from dtwin.bus.stopping import PATIENCE
from dtwin.bus.twin_messages import (
    PredictedMotion,
)
from dtwin.controller.motion import MotionController
from dtwin.controller.proposed import LeastMargins, ProposedSettings
from dtwin.controller.settings import USUAL_GAINS, Compensation, ControlSettings
from dtwin.parameters import scaled
from dtwin.recovery.desk import Desk
from dtwin.recovery.margins import control_settings, settings_for_late
from dtwin.recovery.measures import Measures
from dtwin.recovery.operator import Operator
from dtwin.recovery.strength import Strength
from dtwin.recovery.tuning import times
from dtwin.signals import MONITOR, Event, EventKind
from dtwin.simulation.checks import MOTIONS, Checker
from dtwin.simulation.margins.demands import DEMANDS, cases
from dtwin.simulation.margins.loop import lateness, later
from dtwin.simulation.margins.poses import places
from dtwin.twin.effects import Effects
from tests.recovery.fake_cell import HEALTHY, TRIAL, FakeCell, measures_of, watched
from tests.support.records import recorded


@pytest.fixture
def cell() -> FakeCell:
    return FakeCell()


def test_nothing_found_is_nothing_done(cell: FakeCell) -> None:
    operator = watched(cell)
    assert (operator.steps, operator.trouble, cell.uploads, cell.told) == ([], "", [], [])


@pytest.mark.parametrize(("share", "uploads"), [(1e-12, 0), (1e-3, 1)])
def test_a_model_in_force_is_not_sent_again(cell: FakeCell, share: float, uploads: int) -> None:
    """A device may read back another last digit than it was sent."""
    cell._now = msgspec.structs.replace(cell._now, model=scaled(HEALTHY, "K", 1.0 + share))
    Measures(Desk(cast(Bus, cell), cell.over, lambda time: None, 60.0), HEALTHY).put_into_force()
    assert len(cell.uploads) == uploads


def test_a_weaker_motor_is_refitted_and_its_model_uploaded(cell: FakeCell) -> None:
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.1, 0.01), 0.1416
    operator = watched(cell)
    assert measures_of(operator) == [("refit", ("K2",))]
    assert operator.steps[0].taken.values == {"K2": 0.1416}
    (request,) = cell.identified
    assert (request.free, request.anew, request.source, request.since) == ("K", "K2", "motion", 20.0)
    (upload,) = cell.uploads
    assert upload.model == HEALTHY.with_values({"K2": 0.1416})
    assert operator.trouble == ""


def test_the_monitor_tells_what_an_arm_with_effects_has_become(cell: FakeCell) -> None:
    """No fit to the equations of motion would; rotors are parts of the links that the controller knows."""
    cell.found |= {"K2": (20.0, -0.1, 0.2), "mu1": (20.0, 0.004, 1e-4)}

    def learn() -> None:
        if cell.time > 22.5:
            cell.found["K2"] = (20.0, -0.15, 0.001)

    cell.changing = learn
    operator = watched(cell, recorded(Effects(rotor_inertia=(1e-4, 0.0, 0.0))))
    weak = 0.85 * HEALTHY.get("K2")
    assert measures_of(operator) == [("refit", ("mu1", "K2"))]
    assert operator.steps[0].taken.values == {"mu1": pytest.approx(0.004), "K2": pytest.approx(weak)}
    assert cell.identified == []
    upload = cell.uploads[0]
    assert upload.arm is not None
    assert upload.model is not None
    for told in (upload.arm, upload.model):
        assert (told.get("K2"), told.get("mu1")) == (pytest.approx(weak), pytest.approx(0.004))
    assert upload.model.get("I1") - upload.arm.get("I1") == pytest.approx(1e-4)


def test_a_doubtful_change_stops_the_arm_and_a_person_has_to_find_out(cell: FakeCell) -> None:
    """A heavier link looks a little like a weaker motor; with that model the arm would work on."""
    cell.found["K1"], cell.confidence = (20.0, -0.04, 0.002), 0.29
    operator = watched(cell, recorded())
    assert measures_of(operator) == [("refit", ("K1",)), ("stop", ("K1",))]
    assert (cell.uploads, operator.trouble) == ([], "")
    assert cell.told[-1].endswith(
        "K1: too doubtful to change the model: find out what is wrong, then `dtwin release`"
    )


def test_what_the_monitor_withdraws_before_it_is_answered_changes_nothing(cell: FakeCell) -> None:
    """A push that is taken for a stronger motor is examined anew once the motor is seen to be as strong as before."""
    cell.found["K3"] = (20.0, 0.12, 0.004)

    def withdraw() -> None:
        cell.open = ["K3"] if 20.5 <= cell.time < 23.0 else []
        if cell.time >= 23.0:
            cell.found = {}

    cell.changing = withdraw
    operator = watched(cell, recorded())
    assert measures_of(operator) == [("go on", ("K3",))]
    assert (cell.uploads, operator.trouble) == ([], "")
    assert cell.told[-1] == "goes on: K3 changed nothing that lasts"


def test_what_the_monitor_names_anew_is_answered_as_that_alone(cell: FakeCell) -> None:
    cell.found["K2"] = (20.0, -0.1, 0.1)

    def rename() -> None:
        if cell.time >= 23.0:
            cell.found = {"mu2": (23.0, 0.01, 1e-4)}

    cell.changing = rename
    operator = watched(cell, recorded())
    assert measures_of(operator) == [("refit", ("mu2",))]


def test_what_the_monitor_withdraws_of_two_changes_is_left_as_it_was(cell: FakeCell) -> None:
    cell.found |= {"K3": (20.0, 0.12, 0.1), "mu1": (20.0, 0.004, 1e-4)}

    def withdraw() -> None:
        if cell.time >= 23.0:
            cell.found.pop("K3", None)

    cell.changing = withdraw
    operator = watched(cell, recorded())
    assert operator.steps[0].taken.values == {"mu1": pytest.approx(0.004), "K3": HEALTHY.get("K3")}


def test_two_changes_of_one_measure_are_refitted_together(cell: FakeCell) -> None:
    cell.found |= {"K2": (20.0, -0.1, 0.01), "D1": (20.5, 0.03, 0.001)}
    cell.refits |= {"K2": 0.1416, "D1": 0.08}
    operator = watched(cell)
    assert measures_of(operator) == [("refit", ("D1", "K2"))]
    assert (cell.identified[0].free, cell.identified[0].anew) == ("D,K", "D1,K2")
    assert cell.uploads[0].model == HEALTHY.with_values({"K2": 0.1416, "D1": 0.08})


def test_what_another_finding_hides_in_the_state_of_its_joint_is_answered_too(cell: FakeCell) -> None:
    cell.found |= {"K2": (20.0, -0.1, 0.01), "mu2": (20.5, 0.01, 1e-3)}
    cell.refits |= {"K2": 0.1416, "mu2": 0.01}
    assert measures_of(watched(cell)) == [("refit", ("mu2", "K2"))]


def test_an_arm_that_needs_more_time_gets_it_before_its_model(cell: FakeCell) -> None:
    cell.found["D1"], cell.refits["D1"] = (20.0, 0.1, 0.01), 0.15
    cell.worse = lambda request: 3.0 if request.model and (request.target_time or 2.0) < 2.4 else 0.9
    watched(cell)
    first, second = cell.uploads
    assert (first.target_time, first.model) == (2.5, None)
    assert first.arm == second.model == HEALTHY.with_values({"D1": 0.15})


def test_a_friction_that_is_estimated_below_zero_is_none(cell: FakeCell) -> None:
    cell.found |= {"D1": (20.0, 0.03, 1e-4), "mu2": (20.0, -0.004, 1e-4)}
    operator = watched(cell, recorded())
    assert (operator.steps[0].taken.values["mu2"], operator.trouble) == (0.0, "")


@pytest.mark.parametrize("parameter", ["K2", "supply"])
def test_an_arm_too_weak_for_its_boxes_is_stopped(cell: FakeCell, parameter: str) -> None:
    cell.found[parameter], cell.refits["K2"] = (20.0, -0.3, 0.01), 0.7 * HEALTHY.get("K2")
    operator = watched(cell)
    assert measures_of(operator)[1:] == [("stop", (parameter,))]
    assert cell.uploads == []
    assert cell.stops[0].state == "failed"
    assert "the arm can work without a box only, it cannot hold a box of 210 g at red" in cell.told[-1]
    assert "then `dtwin release`" in cell.told[-1]


def test_a_model_comes_first_where_more_time_alone_would_be_refused(cell: FakeCell) -> None:
    """A motor with half its torque leaves its path with the old model at any pace: nothing was done about it."""
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.1, 0.01), 0.1416
    cell.worse = lambda request: 3.0 if request.model and (request.target_time or 2.0) < 2.4 else 0.9
    cell.refuses = lambda request: "" if request.model or cell._now.model != HEALTHY else "it would leave its path"
    operator = watched(cell)
    assert [(upload.target_time, upload.model is not None) for upload in cell.uploads] == [(None, True), (2.5, False)]
    assert measures_of(operator) == [("refit", ("K2",))]
    assert not operator.trouble


def test_a_refit_that_is_refused_is_told(cell: FakeCell) -> None:
    cell.found["mu1"], cell.refuse = (20.0, 0.1, 0.01), "the motion tells too little"
    operator = watched(cell)
    assert [(step.measure, step.taken.uploaded) for step in operator.steps] == [("refit", None)]
    assert operator.trouble == "identification: the motion tells too little"
    assert cell.told[-1] == f"cannot go on: {operator.trouble}"


def test_settings_that_are_taken_back_are_told(cell: FakeCell) -> None:
    cell.found["bias1"] = (20.0, 0.01, 1e-4)
    desk = Desk(cast(Bus, cell), cell.over, lambda time: None, 60.0)
    measures = Measures(desk, HEALTHY)
    measures.put_into_force()
    cell.roll_back = True
    operator = Operator(desk, measures)
    operator.watch()
    assert [(step.measure, step.taken.uploaded) for step in operator.steps] == [("offset", None)] * 2
    assert operator.trouble == "version 4 of the settings was taken back: worse"
    assert "version 2 of the settings was taken back: worse; tries once more" in cell.told


def test_settings_that_are_taken_back_once_are_tried_again(cell: FakeCell) -> None:
    cell.found["bias1"] = (20.0, 0.01, 1e-4)
    cell.roll_back = True

    def better() -> None:
        cell.roll_back = len(cell.uploads) < 2

    cell.changing = better
    operator = watched(cell)
    assert measures_of(operator) == [("offset", ("bias1",))] * 2
    assert [upload.encoder_offset for upload in cell.uploads] == [(0.01, 0.0, 0.0)] * 2
    assert operator.steps[-1].taken.values == {"bias1": 0.01}
    assert operator.trouble == ""


def test_an_offset_is_taken_off_once_it_is_known_well(cell: FakeCell) -> None:
    cell.found["bias2"] = (20.0, 0.013, 0.003)

    def better() -> None:
        if cell.time > 23.0:
            cell.found["bias2"] = (20.0, 0.01, 1e-4)

    cell.changing = better
    operator = watched(cell)
    (upload,) = cell.uploads
    assert upload.encoder_offset == (0.0, 0.01, 0.0)
    assert measures_of(operator) == [("offset", ("bias2",))]
    assert operator.steps[0].taken.values == {"bias2": 0.01}


def test_a_large_offset_that_is_known_roughly_is_taken_off_at_once_and_what_is_left_later(cell: FakeCell) -> None:
    cell.found["bias1"] = (20.0, 0.03, 0.0014)

    def better() -> None:
        if cell.time > 25.0:
            cell.found["bias1"] = (20.0, 0.028, 1e-4)

    cell.changing = better
    watched(cell)
    first, second = cell.uploads
    assert (first.encoder_offset, second.encoder_offset) == ((0.03, 0.0, 0.0), (0.028, 0.0, 0.0))


def test_an_offset_that_turns_out_otherwise_is_taken_off_anew(cell: FakeCell) -> None:
    cell.found["bias3"] = (20.0, 0.02, 1e-4)

    def otherwise() -> None:
        if cell.uploads and cell.uploads[-1].encoder_offset:
            cell.found["bias3"] = (20.0, 0.01, 1e-4)

    cell.changing = otherwise
    watched(cell)
    assert [upload.encoder_offset for upload in cell.uploads] == [(0.0, 0.0, 0.02), (0.0, 0.0, 0.01)]


def test_a_doubtful_offset_that_is_withdrawn_is_never_taken_off(cell: FakeCell) -> None:
    """Beside it a box has slipped, of which there is nothing to see any more once the gripper has opened."""
    cell.found |= {"slip": (20.0, -0.2, 0.0), "bias3": (20.0, -0.0038, 1e-3)}

    def withdraw() -> None:
        if cell.time > 21.0:
            cell.found.pop("slip", None)
        if cell.time > 30.0:
            cell.found.pop("bias3", None)

    cell.changing = withdraw
    operator = watched(cell)
    assert measures_of(operator) == [("go on", ("slip",)), ("go on", ("bias3",))]
    assert cell.uploads == []
    assert cell.told[-1] == "goes on: bias3 is none after all"


def test_a_doubtful_offset_that_stays_is_taken_off_at_last(cell: FakeCell) -> None:
    cell.found["bias3"] = (20.0, -0.0038, 1e-3)
    operator = watched(cell)
    (upload,) = cell.uploads
    assert upload.encoder_offset == (0.0, 0.0, -0.0038)
    assert operator.steps[0].taken.uploaded == pytest.approx(36.0, abs=1.0)


def test_an_offset_that_is_withdrawn_once_it_is_taken_off_is_given_back(cell: FakeCell) -> None:
    cell.found["bias3"] = (20.0, 0.02, 1e-4)
    cell.changing = lambda: cell.found.clear() if cell.uploads else None
    operator = watched(cell)
    assert [upload.encoder_offset for upload in cell.uploads] == [(0.0, 0.0, 0.02), (0.0, 0.0, 0.0)]
    assert operator.steps[0].taken.values == {"bias3": 0.0}


def test_an_offset_beyond_all_bounds_stops_the_arm(cell: FakeCell) -> None:
    cell.found["bias3"] = (20.0, 0.5, 1e-4)
    assert measures_of(watched(cell)) == [("offset", ("bias3",)), ("stop", ("bias3",))]
    assert cell.uploads == []


def test_a_heavier_box_is_counted_on(cell: FakeCell) -> None:
    cell.found["payload"] = (20.0, 0.02, 1e-3)
    operator = watched(cell)
    (upload,) = cell.uploads
    assert upload.payload == pytest.approx(0.22)
    assert measures_of(operator) == [("payload", ("payload",))]


def test_the_mean_of_all_boxes_that_differed_is_counted_on(cell: FakeCell) -> None:
    boxes = {20.0: 0.02, 40.0: 0.04}

    def carrying() -> None:
        held = [(time, heavier, 1e-3) for time, heavier in boxes.items() if time < cell.time <= time + 3.0]
        cell.found = {"payload": held[0]} if held else {}

    cell.changing = carrying
    watched(cell)
    assert [upload.payload for upload in cell.uploads] == pytest.approx([0.22, 0.23])


@pytest.mark.parametrize(("load", "measures"), [(None, ["refit"]), (1.1, ["refit", "stop"])])
def test_an_arm_holds_boxes_as_heavy_as_they_move_on_it(
    cell: FakeCell, load: float | None, measures: list[str]
) -> None:
    """The share of the voltage that is left at the highest place decides, and boxes are a third of the load there."""
    known = msgspec.structs.replace(recorded(), load=load)
    cell.found["K2"] = (20.0, -0.14, 1e-3)
    operator = watched(cell, known)
    assert [measure for measure, _ in measures_of(operator)] == measures


@pytest.mark.parametrize(("more", "heaviest"), [(0.1, 310), (0.15, 360)])
def test_a_box_too_heavy_to_hold_stops_the_arm(cell: FakeCell, more: float, heaviest: int) -> None:
    cell.found["payload"] = (20.0, more, 1e-3)
    assert measures_of(watched(cell)) == [("payload", ("payload",)), ("stop", ("payload",))]
    assert f"a box of {heaviest} g at" in cell.told[-1]


def test_an_arm_that_needs_more_time_for_a_heavier_box_gets_that_first(cell: FakeCell) -> None:
    cell.found["payload"] = (20.0, 0.02, 1e-3)
    cell.worse = lambda request: 1.0 if request.payload is None or (request.target_time or 2.0) > 3.5 else 2.0
    assert measures_of(watched(cell)) == [("payload", ("payload",))]
    assert [(upload.target_time, upload.payload) for upload in cell.uploads] == [
        (4.0, None),
        (None, pytest.approx(0.22)),
    ]


def test_a_supply_that_sags_scales_all_voltage_constants(cell: FakeCell) -> None:
    cell.found["supply"] = (20.0, -0.1, 1e-3)
    operator = watched(cell)
    (upload,) = cell.uploads
    assert upload.model is not None
    assert upload.model.voltage_constant == pytest.approx([0.9 * value for value in HEALTHY.voltage_constant])
    assert operator.steps[0].taken.values == {"supply": 0.9}


def test_late_commands_leave_gains_with_margins_and_make_the_arm_slower(cell: FakeCell) -> None:
    cell.found["late"] = (20.0, 0.0, 0.0)
    cell.worse = lambda request: 3.0 if request.late and (request.target_time or 2.0) < 2.4 else 0.9
    operator = watched(cell)
    assert measures_of(operator) == [("margins", ("late",))]
    assert [upload.late for upload in cell.uploads] == [1.0]
    (upload,) = cell.uploads
    assert upload.gains == USUAL_GAINS["cascade"]
    assert upload.target_time is not None
    assert upload.target_time > 2.0


FAST = replace(USUAL_GAINS["cascade"], kp=(1100.0,) * 3, ki=(7000.0,) * 3, kd=(57.0,) * 3)


def test_late_commands_lower_gains_that_are_too_fast(cell: FakeCell) -> None:
    cell._now = msgspec.structs.replace(cell._now, gains=FAST)
    cell.found["late"] = (20.0, 0.0, 0.0)
    watched(cell)
    (upload,) = cell.uploads
    assert upload.gains is not None
    assert upload.gains.ki[0] < FAST.ki[0]


@pytest.mark.parametrize("worse", [1.1, 0.9])
def test_gains_without_margins_are_lowered_before_the_model_and_made_no_stiffer(cell: FakeCell, worse: float) -> None:
    fast = replace(FAST, kp=(3000.0,) * 3)
    cell._now = msgspec.structs.replace(cell._now, gains=fast)
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.1, 0.01), 0.1416
    cell.worse = lambda request: worse
    watched(cell)
    first, second = cell.uploads
    assert (first.model, second.gains) == (None, None)
    assert first.gains is not None
    assert first.gains.ki[0] < fast.ki[0]
    assert second.model is not None
    for model in (HEALTHY, second.model):
        settings = replace(ControlSettings(law="cascade", model=model), gains=first.gains)
        Checker().check(settings, HEALTHY.with_values({"K2": 0.1416}))


def test_gains_without_margins_with_a_heavier_box_are_lowered_before_it_is_counted_on(cell: FakeCell) -> None:
    fast = replace(FAST, kp=(3000.0,) * 3)
    cell._now = msgspec.structs.replace(cell._now, gains=fast)
    cell.found["payload"] = (20.0, 0.03, 1e-3)
    assert measures_of(watched(cell)) == [("payload", ("payload",))]
    first, second = cell.uploads
    assert (first.payload, second.gains) == (None, None)
    assert first.gains is not None
    assert first.gains.ki[0] < fast.ki[0]
    assert second.payload == pytest.approx(0.23)
    for payload in (0.2, 0.23):
        Checker().check(replace(ControlSettings(law="cascade"), gains=first.gains, payload=payload), HEALTHY)


@pytest.mark.parametrize(("fast", "stiffest"), [(1.0, 1.5), (3.0, 1.3)])
def test_gains_are_made_no_stiffer_than_their_margins_allow(cell: FakeCell, fast: float, stiffest: float) -> None:
    """The stiffer the better here; settings without margins would be refused, and the arm left as it was."""
    usual = USUAL_GAINS["cascade"]
    begun = replace(usual, kp=times(fast, usual.kp))
    weak = HEALTHY.with_values({"K2": 0.1416})
    cell._now = msgspec.structs.replace(cell._now, gains=begun)
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.1, 0.01), 0.1416
    cell.worse = lambda request: 1.6 * begun.kp[0] / request.gains.kp[0] if request.gains else 1.0
    watched(cell)
    assert cell._now.gains.kp == pytest.approx(times(stiffest, begun.kp))
    Checker().check(replace(control_settings(cell._now, None), model=weak), weak)


@pytest.mark.parametrize(("refused", "compensated"), [("", True), ("no gains have the margins", False)])
def test_margins_are_those_of_a_controller_that_compensates_as_its_record_proposes(
    refused: str, compensated: bool
) -> None:
    """An upload does not tell of that; settings that were refused are not in force."""
    record, upload = recorded(), msgspec.structs.replace(FakeCell()._now, target_time=1.7, payload=0.23)
    control = ControlSettings(law="cascade", compensation=Compensation(delay=0.008, bandwidth=100.0))
    lacking = LeastMargins(0.5, 7.0, 40.0, 2.0, 0.6)
    proposed = ProposedSettings(control, (0.0, 1.0), lacking, lacking, 0.1, refused, [])
    settings = control_settings(upload, msgspec.structs.replace(record, settings=proposed))
    assert settings.compensation == (control.compensation if compensated else Compensation())
    assert (settings.target_time, settings.payload, settings.gains) == (1.7, 0.23, upload.gains)
    assert (settings.law, settings.model) == (upload.law, upload.model)


@pytest.mark.parametrize(("delay", "integral"), [(0.0065, 1.0), (0.008, 0.6)])
def test_a_machine_works_on_with_nine_tenths_of_the_margins_when_commands_are_late(
    delay: float, integral: float
) -> None:
    """With much delay no loop has them that is slower only: it takes less of Ki besides."""
    record = recorded(Effects(delay=delay, lag=(0.006,) * 3))
    in_force = FakeCell()._now
    expected = PredictedMotion("pickup", "red", True, (0.002,) * 3, (0.005,) * 3, (1.0,) * 3, 0.0)
    reference = [expected] * len(MOTIONS)
    tuned = settings_for_late(
        control_settings(in_force, record),
        record.arm,
        record,
        0.2,
        Strength.of(record.arm, 0.2),
        lambda gains, time: reference,
        reference,
    )
    assert tuned.gains.kp[0] < in_force.gains.kp[0]
    speed = tuned.gains.kd[0] / in_force.gains.kd[0]
    assert tuned.gains.ki[0] == pytest.approx(integral * speed**3 * in_force.gains.ki[0])
    found = replace(ControlSettings(law=in_force.law), gains=tuned.gains, target_time=tuned.target_time)
    effects = later(record.effects, 1.0)
    resting = cases(MotionController(), found, record.arm, places(), lateness(effects), effects)
    lacking = [each.share for case in resting if (each := DEMANDS[found.law].shortfall(case.margins)) is not None]
    assert 0.9 <= min(lacking) < 1.0
    Checker(effects=record.effects).check(found, record.arm, late=1.0)


@pytest.mark.parametrize(
    ("parameter", "state"),
    [
        ("freeze2", "angles unknown"),
        ("drift1", "angles unknown"),
        ("lock3", "failed"),
        ("cut1", "failed"),
        ("unknown2", "failed"),
    ],
)
def test_what_nothing_helps_stops_the_arm_whatever_is_being_done(cell: FakeCell, parameter: str, state: str) -> None:
    cell.found |= {"bias3" if parameter[-1] != "3" else "bias1": (20.0, 0.01, 1e-4), parameter: (24.0, 0.0, 0.0)}
    operator = watched(cell)
    assert len(cell.uploads) == 1
    assert measures_of(operator)[1:] == [("stop", (parameter,))]
    (stop,) = cell.stops
    assert (stop.state, stop.confidence) == (state, 1.0)
    assert f" {parameter[-1]}, then `dtwin release`" in cell.told[-1]


def test_an_arm_that_the_blocks_have_stopped_is_left_to_a_person_whatever_is_found(cell: FakeCell) -> None:
    """A stop that is released is none, and a finding that stops the arm tells more than the blocks do."""
    cell.events = [
        Event(10.0, EventKind.STOP, "safe stop: braking (dtwin stop)"),
        Event(10.5, EventKind.STOP, "safe stop: released"),
        Event(24.6, EventKind.STOP, "safe stop: braking (it was not released: it left its path)"),
    ]
    cell.found["slip"] = (24.4, 0.0, 0.0)
    operator = watched(cell)
    assert measures_of(operator)[-1] == ("stop", ("slip",))
    assert 26.6 <= operator.steps[-1].time <= 27.1
    (stop,) = cell.stops
    assert stop.state == "failed"
    assert "it left its path); slip does not explain it: find out" in cell.told[-1]


@pytest.mark.parametrize(
    ("parameter", "size", "told"),
    [
        ("K2", -0.3, "K2 explains it, the arm can work without a box only, it cannot hold a box of 210 g at red"),
        ("D2", 0.1, "D2 explains it, the arm can work with 3 s a motion: grease"),
        ("D2", 0.01, "D2 does not explain it"),
        ("bias2", 0.01, "bias2 does not explain it"),
    ],
)
def test_an_arm_that_had_to_leave_its_path_is_told_with_its_cause(
    cell: FakeCell, parameter: str, size: float, told: str
) -> None:
    """Where it leaves its path at 2 s a motion if its friction is large; what it can hold is computed."""
    strong = HEALTHY.damping[1] + 0.05
    cell.off = lambda request: 0.6 if request.arm and request.arm.damping[1] > strong else 0.0
    cell.worse = lambda request: 2.0 if cell.off(request) and (request.target_time or 2.0) < 3.0 else 1.0
    cell.events = [Event(20.1, EventKind.STOP, "safe stop: braking (it left its path)")]
    cell.found[parameter] = (20.0, size, abs(size) / 3.0)  # so unsure that it stops no arm by itself
    watched(cell)
    assert f"it left its path); {told}" in cell.told[-1]
    assert "then `dtwin release`" in cell.told[-1]
    assert [stop.state for stop in cell.stops] == ["failed"]


def test_what_was_answered_before_is_not_counted_twice(cell: FakeCell) -> None:
    """A motor that lost 8 %, and 14 % in all, holds its boxes still; one that lost both would not."""
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.08, 1e-4), 0.92 * HEALTHY.get("K2")
    cell.noticed["K2"] = 20.0

    def worse() -> None:
        if cell.time >= 45.0:
            cell.found["K2"], cell.refits["K2"] = (20.0, -0.14, 1e-4), 0.86 * HEALTHY.get("K2")
            cell.noticed["K2"] = 45.0

    cell.changing = worse
    operator = watched(cell)
    assert [measure for measure, _ in measures_of(operator)] == ["refit", "refit"]
    assert not cell.stops


def test_a_finding_tells_why_the_blocks_have_stopped_the_arm(cell: FakeCell) -> None:
    cell.events = [Event(24.6, EventKind.STOP, "safe stop: braking (it left its path)")]
    cell.found["lock3"] = (25.6, 0.0, 0.0)
    assert measures_of(watched(cell)) == [("stop", ("lock3",))]
    assert "free joint 3" in cell.told[-1]


def test_a_slip_that_is_over_before_it_is_answered_is_told(cell: FakeCell) -> None:
    def put_down() -> None:
        cell.found = {"slip": (20.0, -0.2, 0.0)} if 20.0 <= cell.time < 20.4 else {}

    cell.changing = put_down
    assert measures_of(watched(cell)) == [("go on", ("slip",))]


def test_a_box_that_is_put_down_before_it_is_answered_is_counted_on(cell: FakeCell) -> None:
    def put_down() -> None:
        cell.found = {"payload": (20.0, 0.02, 1e-3)} if 20.0 <= cell.time < 20.4 else {}

    cell.changing = put_down
    assert measures_of(watched(cell)) == [("payload", ("payload",))]
    assert [upload.payload for upload in cell.uploads] == pytest.approx([0.22])


def test_a_box_that_is_put_down_while_something_else_is_answered_is_counted_on(cell: FakeCell) -> None:
    def put_down() -> None:
        cell.found = {"bias3": (20.0, -0.005, 1e-4)} if cell.time >= 20.0 else {}
        cell.found |= {"payload": (20.0, 0.02, 1e-3)} if 20.0 <= cell.time < 23.0 else {}

    cell.changing = put_down
    assert measures_of(watched(cell)) == [("offset", ("bias3",)), ("payload", ("payload",))]
    first, second = cell.uploads
    assert first.encoder_offset == (0.0, 0.0, -0.005)
    assert second.payload == pytest.approx(0.22)


def test_an_arm_that_stands_no_further_delay_is_stopped(cell: FakeCell) -> None:
    cell.found["late"] = (20.0, 1.0, 0.01)
    operator = watched(cell, recorded(Effects(delay=0.04)))
    assert [measure for measure, _ in measures_of(operator)] == ["margins", "stop"]
    assert "no gains have 90% of the margins, down to 0.5 times" in cell.told[-1]
    assert operator.trouble == ""


def test_a_slip_and_a_push_are_told_and_nothing_else(cell: FakeCell) -> None:
    cell.found["slip"] = (20.0, -0.2, 0.0)
    cell.events.append(Event(30.0, f"{MONITOR}push", "push of joint 2"))
    operator = watched(cell)
    assert measures_of(operator) == [("go on", ("slip",)), ("go on", ("push",))]
    assert (cell.uploads, cell.stops) == ([], [])
    assert cell.told == [
        "slip asks for go on: the sequence fetches the next box; for a person: pick up the box that was lost",
        "push asks for go on: it is over",
    ]


@pytest.mark.parametrize(("size", "deviation", "told"), [(-0.017, 0.002, False), (-0.009, 0.026, True)])
def test_a_box_that_weighs_what_it_did_has_not_slipped(
    cell: FakeCell, size: float, deviation: float, told: bool
) -> None:
    """A box that touches something while an offset is taken off seems to lose a little of its weight."""
    cell.found["slip"] = (20.0, size, deviation)
    operator = watched(cell)
    assert measures_of(operator) == ([("go on", ("slip",))] if told else [])
    assert ("slip is none: the box has lost 27 g at most" in cell.told) != told


def test_a_push_is_told_while_something_else_is_answered(cell: FakeCell) -> None:
    cell.found["bias1"] = (20.0, 0.01, 1e-4)
    cell.events.append(Event(25.0, f"{MONITOR}push", "push of joint 2"))
    operator = watched(cell)
    assert measures_of(operator) == [("offset", ("bias1",)), ("go on", ("push",))]
    assert [step.taken.values for step in operator.steps] == [{"bias1": 0.01}, {}]
    assert operator.steps[1].time == 25.0
    assert operator.steps[0].taken.uploaded is not None
    assert operator.steps[0].taken.uploaded < 25.0 < operator.steps[0].taken.uploaded + TRIAL


def test_what_has_ended_may_come_again(cell: FakeCell) -> None:
    cell.found["slip"] = (20.0, -0.2, 0.0)

    def coming_and_going() -> None:
        cell.found = {} if 30.0 <= cell.time <= 40.0 else {"slip": (20.0 if cell.time < 30.0 else 40.0, -0.2, 0.0)}

    cell.changing = coming_and_going
    assert measures_of(watched(cell)) == [("go on", ("slip",))] * 2


def test_a_stop_that_nobody_answers_is_asked_for_again(cell: FakeCell) -> None:
    cell.found["freeze1"] = (20.0, 0.0, 0.0)
    cell.deaf = 3
    operator = watched(cell)
    assert measures_of(operator) == [("stop", ("freeze1",))]
    assert cell.deaf == 0


@pytest.mark.parametrize(("confidence", "size"), [(1.0, -0.3), (0.3, -0.05)])
def test_a_stop_for_an_arm_that_no_settings_help_is_asked_for_again(
    cell: FakeCell, confidence: float, size: float
) -> None:
    cell.found["K2"], cell.confidence = (20.0, size, 1e-3), confidence
    cell.deaf = 1
    operator = watched(cell, recorded())
    assert measures_of(operator) == [("refit", ("K2",)), ("refit", ("K2",)), ("stop", ("K2",))]
    assert (cell.deaf, len(cell.stops)) == (0, 1)


def test_the_torque_is_taken_off_when_the_blocks_stop_nothing_for_too_long(cell: FakeCell) -> None:
    cell.found["freeze1"] = (20.0, 0.0, 1e-3)
    cell.deaf = 10_000
    operator = watched(cell)
    ((when, stop),) = cell.latched
    assert stop == "torque off"
    assert when == pytest.approx(20.0 + PATIENCE, abs=1.0)
    assert measures_of(operator) == [("stop", ("freeze1",))]
