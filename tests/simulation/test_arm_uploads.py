"""Uploads of models to the blocks of an arm: checked, tried, taken back, and what outlives the end of a process."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.model import ArmModel, ArmSettings, ArmTuning
from dtwin.arm.modelled import with_model
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.chain.model import held_inputs
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import drawn
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import CommunicationError, ParameterError
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run
from dtwin.services.chain.simulation import RULES
from dtwin.settings.change import Change, Proposal
from dtwin.simulation.chain.checks import as_before, check_model, check_settings, expected_tracking
from dtwin.simulation.chain.history import ArmEntry, ArmHistory
from dtwin.simulation.upload import Uploader

ARM = arm_of("planar-2r")
SHEET = ArmSettings(ArmModel.of(ARM))
OTHER = ArmSettings(ArmModel.of(drawn(ARM, 7)), ArmTuning(pole=10.0, speed=0.8))
EXPECTED = (0.01, 0.02)
ArmUploads = Uploader[ArmSettings, ArmEntry]


class FakeBlocks:
    """Blocks that take what they are told, or nothing."""

    def __init__(self) -> None:
        self.settings = SHEET
        self.deaf = False

    def put(self, group: tuple[str, ...], settings: ArmSettings, who: str, why: str) -> ArmSettings:
        if self.deaf:
            raise CommunicationError("no answer")
        self.settings = settings
        return settings

    def read_back(self) -> ArmSettings:
        return self.settings


def uploads(path: Path, blocks: FakeBlocks) -> ArmUploads:
    history = ArmHistory(path / "history.jsonl")
    return Uploader(blocks, history, lambda settings, now: EXPECTED, RULES, forgotten=SHEET)


def wish(who: str, why: str, based_on: int, wanted: ArmSettings) -> Proposal[ArmSettings]:
    values = {"model": wanted.model, "tuning": wanted.tuning}
    return Proposal(who, why, based_on, Change.of(ArmSettings, values))


def moved(found: ArmUploads, begin: float, error: float, seconds: float = 20.0) -> list[str]:
    """Lets the arm go to and fro, 2 s of way and 1 s of rest, that far from its path; actions of the entries."""
    actions: list[str] = []
    for k in range(round(100 * seconds)):
        phase = (k / 100) % 3.0
        target = (min(phase, 2.0), 0.0)
        entry = found.observe(begin + k / 100, target, (target[0] + error, target[1]))
        if entry is not None:
            actions.append(entry.action)
    return actions


def test_a_model_that_tracks_as_predicted_is_confirmed(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    entry = found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    assert (entry.version, entry.predicted, blocks.settings) == (2, EXPECTED, OTHER)
    assert moved(found, 5.0, 0.005) == ["confirm"]
    assert [e.action for e in ArmHistory(tmp_path / "history.jsonl").entries()] == ["start", "upload", "confirm"]
    assert found.last.measured == pytest.approx((0.005, 0.0))


def test_a_model_that_tracks_worse_is_taken_back(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    found.upload(wish("ann", "wrong", 1, OTHER), 5.0)
    assert moved(found, 5.0, 0.2) == ["roll back"]
    assert blocks.settings == SHEET
    assert (found.version, "joint 1 is 0.2 rad from its path" in found.last.why) == (3, True)


def test_an_arm_that_stood_still_is_not_said_to_have_tracked(tmp_path: Path) -> None:
    found = uploads(tmp_path, FakeBlocks())
    found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    for k in range(4000):
        found.observe(5.0 + k / 100, (1.0, 0.0), (1.005, 0.0))
    assert (found.last.action, found.last.text) == ("confirm", "the arm stood still for 30.0 s")


def test_a_trial_begins_anew_where_the_blocks_had_forgotten_the_model(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    assert moved(found, 5.0, 0.005, 9.0) == []
    blocks.settings = SHEET  # others have come in their place, and nobody has looked yet
    assert moved(found, 14.0, 0.005, 9.0) == []
    assert (blocks.settings, (found.trial is not None)) == (OTHER, True)
    assert moved(found, 23.0, 0.005) == ["confirm"]


def test_late_commands_tell_nothing_of_a_model(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    moved(found, 5.0, 0.005, 5.0)
    for k in range(50):
        found.miss(10.0 + k / 100)
    assert found.trial is not None
    assert moved(found, 10.5, 0.005) == ["confirm"]


def test_a_trial_of_an_arm_that_obeys_nothing_ends(tmp_path: Path) -> None:
    """One that was stopped before its first sample with the new settings has no sample that could be judged."""
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    entries = [found.miss(10.0 + k / 100) for k in range(3001)]
    assert not any(entries[:3000])
    assert entries[3000] is not None
    assert (entries[3000].action, blocks.settings, (found.trial is not None)) == ("roll back", SHEET, False)
    assert "could not be judged within 30 s" in entries[3000].why


def test_what_must_not_be_uploaded_is_refused_and_noted(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    with pytest.raises(ParameterError, match="expected version 1, got 4"):
        found.upload(wish("ann", "late", 4, OTHER), 1.0)
    found.upload(wish("ann", "first", 1, OTHER), 2.0)
    with pytest.raises(ParameterError, match="version 2 is on trial"):
        found.upload(wish("bob", "second", 2, SHEET), 3.0)
    assert found.roll_back("ann", "by hand", 4.0).version == 3
    with pytest.raises(ParameterError, match="nothing is on trial"):
        found.roll_back("ann", "again", 5.0)
    assert found.earlier(2).apply(SHEET) == OTHER
    with pytest.raises(ParameterError, match="version 9: expected one of the history, 1 to 3"):
        found.earlier(9)
    actions = [e.action for e in ArmHistory(tmp_path / "history.jsonl").entries()]
    assert actions == ["start", "refuse", "upload", "refuse", "roll back"]


def test_blocks_that_refuse_or_forget_do_not_part_from_the_history(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    blocks.deaf = True
    with pytest.raises(CommunicationError):
        found.upload(wish("ann", "deaf", 1, OTHER), 1.0)
    assert (found.settings, (found.trial is not None)) == (SHEET, False)
    blocks.deaf = False
    found.upload(wish("ann", "again", found.version, OTHER), 2.0)
    assert not found.look_again(3.0)
    blocks.settings = SHEET  # others are in their place
    assert found.look_again(3.0)
    assert blocks.settings == OTHER


def test_a_trial_that_the_end_of_a_process_cut_short_is_taken_up(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    uploads(tmp_path, blocks).upload(wish("ann", "identified", 1, OTHER), 5.0)
    again = uploads(tmp_path, blocks)
    assert (again.version, again.trial is not None) == (2, True)
    assert moved(again, 9.0, 0.2) == ["roll back"]
    assert blocks.settings == SHEET


def test_who_is_refused_meanwhile_ends_no_trial(tmp_path: Path) -> None:
    blocks = FakeBlocks()
    found = uploads(tmp_path, blocks)
    found.upload(wish("ann", "identified", 1, OTHER), 5.0)
    for forgets in (False, True):
        with pytest.raises(ParameterError, match="version 2 is on trial"):
            found.upload(wish("bob", "impatient", 2, SHEET), 6.0)
        if forgets:
            blocks.settings = SHEET
            assert found.look_again(3.0)
        else:
            found = uploads(tmp_path, blocks)
        assert (found.version, (found.trial is not None)) == (2, True)
    assert moved(found, 9.0, 0.2) == ["roll back"]
    assert blocks.settings == SHEET


def test_blocks_that_get_a_model_answer_as_blocks_that_were_made_with_it() -> None:
    arm = arm_of("six-axis")
    other = with_model(arm, ArmModel.of(drawn(arm, 3)))
    control, inertia = Control(), usual_inertia(other)
    told = ChainController(len(arm), inputs(arm, usual_inertia(arm), control, None))
    made = ChainController(len(arm), inputs(other, inertia, control, None))
    told.reckon_with(held_inputs(other, inertia, control))
    generator = np.random.default_rng(1)
    q = np.zeros(len(arm))
    for _ in range(50):
        q = q + 1e-3 * generator.standard_normal(len(arm))
        assert told.step(q.tolist()) == made.step(q.tolist())


@pytest.mark.parametrize("another", [True, False])
def test_a_model_that_knows_what_the_integrals_have_balanced_jolts_no_arm(another: bool) -> None:
    settings = ArmCell(arm="planar-2r", machine="7", faults=("K2*=0.75@0",)).settings(8.9, 3)
    joints = list(settings.machine.arm.joints)
    drive = joints[1].actuator
    joints[1] = replace(joints[1], actuator=replace(drive, constant=0.75 * (drive.constant or 0.0)))
    known = with_model(settings.arm, ArmModel.of(replace(settings.machine.arm, joints=tuple(joints))))
    told = held_inputs(known, usual_inertia(known), settings.control)

    def tell(blocks: ChainController, rows: np.ndarray, gripped: np.ndarray, done: int) -> None:
        if done == 850:
            blocks.reckon_with(told, another)

    ran = run(settings, beside=tell)
    speed = np.abs(np.diff(ran.error[850:880], axis=0)).max() / settings.arm.period
    assert ran.stop == 0
    assert speed < 0.05 if another else speed > 0.2


def test_the_twin_expects_an_arm_to_follow_its_path_and_refuses_what_its_drives_cannot_do() -> None:
    settings = ArmCell(arm="planar-2r", machine="nominal").settings(10.0)
    expected = expected_tracking(settings, SHEET)
    assert len(expected) == 2
    assert 0.0 < max(expected) < 0.05


def test_blocks_that_get_a_tuning_lead_the_arm_as_blocks_that_were_made_with_it() -> None:
    arm, poses = arm_of("planar-2r"), ArmCell(arm="planar-2r").settings(1.0).poses
    inertia, tuned = usual_inertia(arm), Control().tuned(ArmTuning(pole=9.0, observer=60.0, speed=0.5))
    told = ChainController(len(arm), inputs(arm, inertia, Control(), poses))
    made = ChainController(len(arm), inputs(arm, inertia, tuned, poses))
    usual = ChainController(len(arm), inputs(arm, inertia, Control(), poses))
    told.reckon_with(held_inputs(arm, inertia, tuned))
    fastest = np.zeros(2)
    for k in range(300):
        q = (poses.positions[0] + 1e-4 * k).tolist()
        assert told.step(q) == made.step(q)
        usual.step(q)
        fastest = np.maximum(fastest, [np.abs(blocks.desired()[1]).max() for blocks in (told, usual)])
    assert fastest[0] < 0.7 * fastest[1]


def test_the_twin_tries_a_tuning_in_the_arms_own_motion() -> None:
    settings = ArmCell(arm="planar-2r", machine="nominal").settings(10.0)
    weak = expected_tracking(settings, replace(SHEET, tuning=ArmTuning(pole=8.0)))
    assert max(weak) > max(expected_tracking(settings, SHEET))
    with pytest.raises(ParameterError, match="the loop of shoulder would not be stable"):
        expected_tracking(settings, replace(SHEET, tuning=ArmTuning(observer=20.0)))


@pytest.mark.parametrize(
    ("arm", "tuning", "said"),
    [
        ("planar-2r", ArmTuning(pole=80.0), "pole: expected 1 to 60 rad/s, got 80"),
        ("planar-2r", ArmTuning(pole=float("nan")), "pole: expected 1 to 60 rad/s, got nan"),
        ("planar-2r", ArmTuning(observer=1.0), "observer: expected 10 to 500 rad/s, got 1"),
        ("planar-2r", ArmTuning(speed=1.2), "speed: expected 0.1 to 1 of the data sheet's, .* got 1.2"),
        ("servo-2r", ArmTuning(pole=10.0), "the drive of shoulder has a loop of its own: expected a speed alone"),
    ],
)
def test_a_tuning_out_of_bounds_is_refused(arm: str, tuning: ArmTuning, said: str) -> None:
    settings = ArmCell(arm=arm).settings(1.0)
    with pytest.raises(ParameterError, match=said):
        check_settings(settings, ArmSettings(ArmModel.of(settings.arm), tuning))


def test_a_path_with_times_of_its_own_has_no_other_speed() -> None:
    settings = ArmCell(arm="planar-2r").settings(1.0)
    followed = replace(settings, poses=replace(settings.poses, spacing=0.5))
    with pytest.raises(ParameterError, match="in the time that its file says: expected 1, got"):
        check_settings(followed, replace(SHEET, tuning=ArmTuning(speed=0.5)))


def test_a_drive_with_its_own_loop_is_tried_at_another_speed() -> None:
    settings = ArmCell(arm="servo-2r", machine="nominal").settings(10.0)
    assert max(expected_tracking(settings, ArmSettings(ArmModel.of(settings.arm), ArmTuning(speed=0.5)))) < 0.01


def test_a_history_without_tunings_is_read_as_one_with_the_usual_one(tmp_path: Path) -> None:
    file = tmp_path / "history.jsonl"
    uploads(tmp_path, FakeBlocks())
    content = json.loads(file.read_text())
    del content["tuning"]
    file.write_text(json.dumps(content) + "\n")
    assert ArmHistory(file).entries()[0].settings == SHEET


def test_an_arm_that_was_farther_from_its_path_than_its_twin_is_expected_to_be_so_again() -> None:
    assert as_before((0.002, 0.004, 0.001), (0.001, 0.004, 0.0), (0.003, 0.002, 0.0)) == (0.006, 0.004, 0.001)


def test_a_model_is_checked_once_and_its_inertia_cannot_be_written() -> None:
    made = check_model(ARM, SHEET.model)
    assert check_model(ARM, ArmModel.of(ARM)) is made
    assert check_model(ARM, OTHER.model) is not made
    inertia = usual_inertia(made)
    assert usual_inertia(made) is inertia
    with pytest.raises(ValueError, match="read-only"):
        inertia[0] = 1.0
    far = replace(SHEET.model, rotor=(50.0, 50.0))
    for _ in range(2):
        with pytest.raises(ParameterError, match="inertia at joint 1"):
            check_model(ARM, far)
