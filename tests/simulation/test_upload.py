"""Uploads into a running controller: nothing jumps, nothing bad gets through, and what disappoints is taken back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from dtwin.arm.model import ArmSettings, ArmTuning
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import MODEL, TUNING
from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.errors import CommunicationError, ParameterError
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters, Gains, JointVector, scaled
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.settings.change import Change, Proposal, Refused
from dtwin.signals import Sensors
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import Entry, History
from dtwin.simulation.trial import Trial, TrialRules
from dtwin.simulation.upload import Uploader
from dtwin.simulation.watched_controller import WatchedController

HIGHER = usual_gains("computed_torque", kp=(250.0, 500.0, 350.0))
CellUploader = Uploader[ControlSettings, Entry]
Action = Callable[[CellUploader, float], object]


def wish(who: str, why: str, based_on: int, **values: Any) -> Proposal[ControlSettings]:
    return Proposal(who, why, based_on, Change.of(ControlSettings, values))


class UploadingCell:
    """A controller, its uploader and its history."""

    def __init__(self, folder: Path, checker: Checker, settings: ControlSettings | None = None) -> None:
        self.controller = EmbeddedController(settings)
        self.port = EmbeddedPort(self.controller)
        self.history = History(folder / "history.jsonl")
        self.checker = checker
        self.uploader = Uploader(self.port, self.history, checker.expected_tracking)

    def run(self, duration: float, actions: dict[float, Action], arm: ArmParameters | None = None) -> Log:
        """Runs the cell with something done to the uploader at some seconds."""
        cell = Cell(
            CellSettings(duration=duration, seed=1, arm=arm or ArmParameters()),
            WatchedController(self.controller, self.uploader),
        )

        def between(done: int) -> bool:
            if (action := actions.get(done / 100)) is not None:
                action(self.uploader, done / 100)
            return True

        cell.run(between)
        return cell.log.freeze()

    def actions(self) -> list[str]:
        return [entry.action for entry in self.history.entries()]


@pytest.fixture
def desk(tmp_path: Path, checker: Checker) -> UploadingCell:
    return UploadingCell(tmp_path, checker)


def gains(values: Gains, who: str = "anna", why: str = "to try") -> Action:
    return lambda uploader, at: uploader.upload(wish(who, why, uploader.version, gains=values), at)


def model(values: ArmParameters) -> Action:
    return lambda uploader, at: uploader.upload(wish("anna", "to try", uploader.version, model=values), at)


def test_sending_the_same_again_changes_no_voltage(tmp_path: Path, checker: Checker, desk: UploadingCell) -> None:
    undisturbed = Cell(CellSettings(duration=20.0, seed=1))
    undisturbed.run()

    def send(what: tuple[str, ...]) -> Action:
        return lambda uploader, at: desk.port.put(what, ControlSettings())

    log = desk.run(20.0, {float(k): send(TUNING if k % 2 else MODEL) for k in range(1, 20)})
    assert log.stack("volts").tobytes() == undisturbed.log.freeze().stack("volts").tobytes()


def test_new_gains_make_no_jump_beyond_the_new_law(tmp_path: Path, checker: Checker, desk: UploadingCell) -> None:
    """Gains change amid a motion of an arm that is heavier than the controller knows; the integral stays."""
    heavy = scaled(ArmParameters(), "m", 1.2)
    other = usual_gains("computed_torque", ki=(150.0, 100.0, 300.0))
    plain = Cell(CellSettings(duration=14.2, seed=1, arm=heavy))
    plain.run()
    usual, changed = plain.log.freeze().stack("volts"), desk.run(14.2, {14.0: gains(other)}, heavy).stack("volts")
    assert desk.uploader.settings.gains == other
    np.testing.assert_array_equal(changed[:1400], usual[:1400])
    # One sample of the new gain, 0.01 s x 150 1/s^3 x 0.1 rad; with the gain outside the integral it would be 0.26 V.
    assert 0.0 < np.abs(changed[1400] - usual[1400]).max() < 0.02


def test_an_upload_is_in_force_from_the_next_tick(desk: UploadingCell) -> None:
    desk.run(3.0, {2.0: gains(HIGHER)})
    assert desk.port.read_back().gains == HIGHER
    assert desk.uploader.settings.gains == HIGHER
    desk.port.put(MODEL, ControlSettings(model=scaled(ArmParameters(), "D", 1.1)))
    assert desk.port.read_back().model == scaled(ArmParameters(), "D", 1.1)
    assert desk.port.read_back().gains == HIGHER


def test_good_settings_are_confirmed(desk: UploadingCell) -> None:
    log = desk.run(30.0, {3.0: gains(HIGHER)})
    entries = desk.history.entries()
    assert [entry.action for entry in entries] == ["start", "upload", "confirm"]
    assert [entry.version for entry in entries] == [1, 2, 2]
    assert [entry.time for entry in entries[:2]] == pytest.approx([0.0, 3.0])
    first = next(event.time for event in log.events if event.kind == "picked")
    assert entries[2].time == pytest.approx(max(13.0, first + 2.02), abs=0.03)
    assert (entries[1].who, entries[1].why, entries[1].kind) == ("anna", "to try", "gains")
    assert entries[2].measured is not None
    assert entries[1].predicted is not None
    assert max(entries[2].measured) < 1.5 * max(entries[1].predicted) + 0.01
    assert desk.uploader.trial is None


def test_a_model_that_disappoints_is_rolled_back(desk: UploadingCell) -> None:
    """The twin is told that the arm has that damping, so it agrees; the arm has not."""
    log = desk.run(25.0, {7.0: model(scaled(ArmParameters(), "D", 2.5))})
    entries = desk.history.entries()
    assert [entry.action for entry in entries] == ["start", "upload", "roll back"]
    assert entries[-1].version == 3
    assert "rad from its path, expected at most" in entries[-1].why
    assert entries[-1].settings == entries[0].settings
    assert desk.port.read_back().inputs() == ControlSettings().inputs()
    late = np.abs(log.stack("target") - log.stack("theta"))[2000:]
    assert late.max() < 0.02


def test_a_trial_that_a_crash_cut_short_goes_on(desk: UploadingCell) -> None:
    desk.run(8.0, {7.0: model(scaled(ArmParameters(), "D", 2.5))})
    assert desk.actions() == ["start", "upload"]
    again = Uploader(desk.port, desk.history, desk.checker.expected_tracking)
    assert again.trial is not None
    assert again.version == 2
    assert again.observe(268.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)) is None, "no sample was judged before this one"
    for tick in range(20):
        entry = again.observe(268.01 + tick / 100, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0 if tick < 2 else 1.0))
        if entry is not None:
            break
    assert desk.actions() == ["start", "upload", "roll back"]
    assert desk.port.read_back().inputs() == ControlSettings().inputs()


def test_refusals_change_nothing_but_the_history(desk: UploadingCell) -> None:
    before = desk.port.read_back()
    refused = [
        wish("bob", "more is better", 1, gains=usual_gains("computed_torque", kp=(5000.0,) * 3)),
        wish("bob", "old", 0, gains=HIGHER),
        wish("bob", "quick", 1, target_time=0.5),
        wish("bob", "light", 1, model=scaled(ArmParameters(), "m", 0.1)),
    ]
    for proposal in refused:
        with pytest.raises(Refused) as reason:
            desk.uploader.upload(proposal, 1.0, partial(desk.checker.expected_tracking, arm=ArmParameters()))
        last = desk.history.last()
        assert last is not None
        assert (last.action, last.version, last.why, last.text) == ("refuse", 1, proposal.why, str(reason.value))
    assert desk.port.read_back() == before == desk.uploader.settings
    assert desk.uploader.trial is None


def test_one_trial_at_a_time_and_a_roll_back_by_hand(desk: UploadingCell) -> None:
    desk.uploader.upload(wish("anna", "", 1, gains=HIGHER, target_time=2.5), 5.0)
    with pytest.raises(Refused, match=r"version 2 is on trial until the end of a motion"):
        desk.uploader.upload(wish("bob", "", 2, gains=usual_gains("computed_torque")), 5.0)
    desk.uploader.observe(5.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(Refused, match=r"version 2 is on trial until 15\.00 s and the end of a motion"):
        desk.uploader.upload(wish("bob", "", 2, gains=usual_gains("computed_torque")), 6.0)
    entry = desk.uploader.roll_back("bob", "do not like it", 7.0)
    assert (entry.version, entry.who, entry.settings.inputs()) == (3, "bob", ControlSettings().inputs())
    assert desk.port.read_back().inputs() == ControlSettings().inputs()
    with pytest.raises(Refused, match="nothing is on trial"):
        desk.uploader.roll_back("bob", "again", 8.0)


@pytest.mark.parametrize(
    ("changes", "kind"), [({"payload": 0.23}, "payload"), ({"encoder_offset": (0.0, 0.01, -0.02)}, "offset")]
)
def test_a_payload_and_offsets_are_uploaded_alone_and_rolled_back(
    desk: UploadingCell, changes: dict[str, Any], kind: str
) -> None:
    entry = desk.uploader.upload(wish("anna", "measured", 1, **changes), 5.0)
    assert (entry.kind, entry.action) == (kind, "upload")
    assert desk.port.read_back() == replace(ControlSettings(), payload_model="point", **changes)
    assert not desk.uploader.earlier(1).apply(entry.settings).differing(ControlSettings())
    desk.uploader.roll_back("bob", "worse", 7.0)
    assert not desk.port.read_back().differing(ControlSettings())
    with pytest.raises(ParameterError, match="a payload or encoder offsets alone"):
        wish("anna", "", 3, gains=HIGHER, **changes)


def test_a_trial_takes_the_offsets_off_what_is_measured(desk: UploadingCell) -> None:
    class Led:
        """Leads the arm to and fro."""

        path = (0.0, 0.0, 0.0)

        def step(self, sensors: Sensors) -> None:
            pass

        def target(self) -> JointVector:
            return self.path

    desk.uploader.upload(wish("anna", "", 1, encoder_offset=(0.0, 0.15, 0.0)), 0.0)
    led = Led()
    ended: list[Entry] = []
    watched = WatchedController(cast(Any, led), desk.uploader, ended.append)
    for tick in range(1, 7000):
        led.path = (0.0, min(tick, 500) * 1e-3, 0.0)
        watched.step(Sensors(tick, tick * 0.01, (0.0, led.path[1] + 0.15, 0.0), 0.0, False, ""))
    assert [entry.action for entry in ended] == ["confirm"]


def test_settings_that_others_have_changed_are_noticed(desk: UploadingCell) -> None:
    desk.port.put(TUNING, ControlSettings(2.0, HIGHER))
    desk.uploader.look_again(4.0)
    assert desk.uploader.version == 2
    assert desk.uploader.settings.gains == HIGHER
    with pytest.raises(Refused, match="expected version 2, got 1"):
        desk.uploader.upload(wish("anna", "", 1, gains=usual_gains("computed_torque")), 5.0)
    again = Uploader(desk.port, desk.history, desk.checker.expected_tracking)
    assert again.version == 2
    desk.port.put(TUNING, ControlSettings(3.0, usual_gains("computed_torque")))
    assert Uploader(desk.port, desk.history, desk.checker.expected_tracking).version == 3


def test_a_controller_that_does_not_take_settings_over_is_an_error(desk: UploadingCell) -> None:
    class Deaf:
        def put(self, group: tuple[str, ...], settings: ControlSettings, who: str, why: str) -> ControlSettings:
            return ControlSettings()

        def read_back(self) -> ControlSettings:
            return ControlSettings()

    uploader = Uploader(Deaf(), desk.history, desk.checker.expected_tracking)
    with pytest.raises(CommunicationError, match="has not taken the gains it was sent"):
        uploader.upload(wish("anna", "", 1, gains=HIGHER), 0.0)
    assert uploader.settings == ControlSettings()
    assert uploader.trial is None
    assert desk.actions() == ["start", "upload", "start"]


@pytest.mark.parametrize("arrived", [False, True], ids=["before the message", "after the message"])
def test_an_upload_that_a_crash_cut_short_is_old_or_new(desk: UploadingCell, arrived: bool) -> None:
    class Dying:
        read_back = desk.port.read_back

        def put(self, group: tuple[str, ...], settings: ControlSettings, who: str, why: str) -> ControlSettings:
            if arrived:
                desk.port.put(group, settings)
            raise SystemExit

    before = desk.uploader.settings
    with pytest.raises(SystemExit):
        Uploader(Dying(), desk.history, desk.checker.expected_tracking).upload(wish("anna", "", 1, gains=HIGHER), 0.0)
    again = Uploader(desk.port, desk.history, desk.checker.expected_tracking)
    assert again.settings.gains == (HIGHER if arrived else before.gains)
    assert not again.settings.differing(desk.port.read_back())
    assert (again.trial is not None) == arrived
    if arrived:
        again.roll_back("bob", "", 1.0)
    assert not before.differing(desk.port.read_back())


def test_what_is_confirmed_is_in_force(desk: UploadingCell) -> None:
    desk.run(9.0, {3.0: gains(HIGHER), 6.0: lambda uploader, at: desk.port.put(TUNING, ControlSettings())})
    trial = desk.uploader.trial
    assert trial is not None
    trial.judged_motion = True
    entry = desk.uploader.observe(14.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert entry is not None
    assert (entry.action, entry.settings.gains) == ("start", usual_gains("computed_torque"))
    assert desk.uploader.trial is None


def test_an_earlier_version_is_an_upload_if_one_message_can_change_all(desk: UploadingCell) -> None:
    desk.uploader.upload(wish("anna", "", 1, gains=HIGHER, target_time=2.5), 0.0)
    desk.uploader.trial = None
    change = desk.uploader.earlier(1)
    assert change.values == {"gains": usual_gains("computed_torque"), "target_time": 2.0}
    entry = desk.uploader.upload(Proposal("bob", "it was better", 2, change), 1.0)
    assert (entry.version, entry.action, entry.who, entry.why) == (3, "upload", "bob", "it was better")
    assert not ControlSettings().differing(desk.port.read_back())
    desk.uploader.trial = None
    lighter = scaled(ArmParameters(), "m", 0.99)
    desk.uploader.upload(wish("anna", "", 3, model=lighter), 2.0)
    assert desk.uploader.earlier(3).values == {"model": ArmParameters()}
    for version, reason in (
        (2, r"version 2: expected that gains, a target time or both, or a model, .* got CONTROLLER\.KP1, CON"),
        (4, "version 4: expected another one, its settings are in force"),
        (5, "version 5: expected one of the history, 1 to 4"),
    ):
        with pytest.raises(ParameterError, match=reason):
            desk.uploader.earlier(version)


@pytest.mark.parametrize(
    "parts", [{}, {"gains": HIGHER, "model": ArmParameters()}, {"target_time": 1.0, "model": ArmParameters()}]
)
def test_proposals_are_one_message(parts: dict[str, object]) -> None:
    with pytest.raises(
        ParameterError, match="expected gains, a target time or both, or a model, a payload or encoder offsets alone"
    ):
        wish("anna", "", 1, **parts)


@pytest.mark.parametrize(
    ("kind", "values", "said"),
    [
        (
            ControlSettings,
            {"target_time": 2.0, "pole": 9.0},
            "pole: this controller has none: expected gains, a target",
        ),
        (ControlSettings, {"tuning": ArmTuning()}, "tuning: this controller has none"),
        (ControlSettings, {"law": "cascade"}, "settings: expected gains"),
        (ArmSettings, {"gains": HIGHER, "payload": 0.1}, "gains, payload: .* expected a model, a tuning or both"),
    ],
)
def test_what_a_controller_has_not_is_refused_by_name(kind: type, values: dict[str, object], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        Change.of(kind, values)


def test_gains_of_another_law_are_refused(desk: UploadingCell) -> None:
    with pytest.raises(Refused, match="expected those of the law in force, computed_torque, got those of cascade"):
        desk.uploader.upload(wish("bob", "tuned", 1, gains=HIGHER, law="cascade"), 1.0)
    assert desk.actions() == ["start", "refuse"]
    assert desk.uploader.upload(wish("bob", "tuned", 1, gains=HIGHER, law="computed_torque"), 1.0).action == "upload"


def test_not_a_number_and_wrong_shapes_never_become_settings() -> None:
    with pytest.raises(ParameterError, match="kp1"):
        usual_gains("computed_torque", kp=(float("nan"), 1.0, 1.0))
    with pytest.raises(ParameterError, match="mass: expected 3 values"):
        ArmParameters(mass=(0.1, 0.1))
    with pytest.raises(ParameterError, match="target time"):
        ControlSettings(target_time=float("inf"))


REST = (0.0, 0.0, 0.0)


def verdicts(distances: list[float], rules: TrialRules | None = None, path: float = 1.0) -> list[str]:
    trial = Trial(rules or TrialRules(), (0.01, 0.01, 0.01))
    assert trial.bounds == pytest.approx((0.025,) * 3)
    return [
        trial.observe(10.0 + k / 100, (path, 0.0, 0.0), (path - distance, 0.0, 0.0))
        for k, distance in enumerate(distances)
    ]


def test_trial_fails_after_some_samples_beyond_the_bound() -> None:
    moved = [0.01] * 100 + [0.0]  # the first sample of a path when the integrals fit
    assert verdicts(moved + [0.03] * 4 + [0.01] + [0.03] * 4)[-1] == "running"
    assert verdicts(moved + [0.03] * 5)[-2:] == ["running", "failed"]


def test_trial_is_patient_with_the_motion_that_ran_before() -> None:
    assert verdicts([0.02] + [0.07] * 50)[-1] == "running"
    assert verdicts([0.02] + [0.08] * 5)[-1] == "failed"


def test_trial_is_patient_with_a_motion_that_begins_before_the_integrals_fit() -> None:
    soon = [0.02] * 18 + [0.0]
    assert verdicts(soon + [0.07] * 50)[-1] == "running"
    assert verdicts(soon + [0.08] * 5)[-1] == "failed"


def test_trial_waits_for_a_distance_that_was_there_before() -> None:
    falling = [2.0 * 0.99**k for k in range(460)]
    assert verdicts(falling)[-1] == "running"
    swinging = [2.0] * 50 + [0.01] * 30 + [1.0] * 40 + [0.05] * 100
    assert verdicts(swinging)[-1] == "running"
    assert verdicts([*swinging, *[0.1] * 5])[-1] == "failed"
    assert verdicts([2.0] * 505)[-1] == "failed"


def swinging_trial(late: int) -> tuple[Trial, list[str]]:
    """A trial of an arm that swings until 11 s after so many late commands from 10.5 s on, and its verdicts."""
    trial, found = Trial(TrialRules(), (0.01, 0.01, 0.01)), list[str]()
    for tick in range(160):
        time = 10.0 + tick / 100
        if 50 <= tick < 50 + late:
            trial.miss(time)
        away = 0.3 if 52 <= tick < 100 else 0.01
        found.append(trial.observe(time, (1.0, 0.0, 0.0), (1.0 - away, 0.0, 0.0)))
    return trial, found


def test_commands_that_are_late_when_a_trial_could_end_make_it_longer() -> None:
    trial = Trial(TrialRules(), (0.1, 0.1, 0.1))
    verdicts = {}
    for tick in range(1600):
        time, still = 10.0 + tick / 100, (1.0, 0.0, 0.0)
        if 990 <= tick < 1010:
            trial.miss(time)
        verdicts[tick] = trial.observe(time, still, still)
    assert trial.judged_motion
    assert verdicts[1005] == "running", "60 s have not passed"
    assert verdicts[1100] == "passed"


def test_late_commands_are_no_fault_of_the_settings() -> None:
    assert "failed" in swinging_trial(2)[1]
    trial, found = swinging_trial(3)
    assert set(found) == {"running"}
    assert max(trial.measured) == pytest.approx(0.01), "what came of late commands is not measured"
    later = [trial.observe(12.0 + k / 100, (1.0, 0.0, 0.0), (0.9, 0.0, 0.0)) for k in range(5)]
    assert later[-1] == "failed", "the arm has tracked its path again, so its distance counts"


def test_an_arm_whose_commands_are_never_in_time_cannot_be_judged() -> None:
    trial = Trial(TrialRules(), (0.01, 0.01, 0.01))
    verdict = "running"
    for tick in range(6001):
        time = 10.0 + tick / 100
        trial.miss(time)
        verdict = trial.observe(time, (1.0, 0.0, 0.0), (0.5, 0.0, 0.0))
        assert verdict == "running" or tick == 6000
    assert (verdict, trial.why()) == ("failed", "commands came late: the arm could not be judged within 60 s")


def trial_of(path: Callable[[int], float]) -> list[str]:
    """The verdicts on an arm that is 10 mrad from its path, except at the start of a path."""
    trial = Trial(TrialRules(), (0.01, 0.01, 0.01))
    found: list[str] = []
    for tick in range(6001):
        away = 0.0 if tick and path(tick - 1) != path(tick) == 0.0 else 0.01
        found.append(trial.observe(10.0 + tick / 100, (path(tick), 0.0, 0.0), (path(tick) - away, 0.0, 0.0)))
        if found[-1] != "running":
            break
    return found


def test_trial_passes_after_its_time_and_a_motion() -> None:
    """The path starts anew at 0 rad, climbs for two seconds and stays."""

    def motion(start: int) -> Callable[[int], float]:
        return lambda tick: 1.0 if tick < start else min(tick - start, 200) / 200

    for start, end in ((100, 1000), (700, 1000), (900, 1101), (3000, 3201), (9999, 6000)):
        found = trial_of(motion(start))
        assert (len(found) - 1, found[-1]) == (end, "passed")
