"""Uploads to a running cell, from the command line through the service to the controller's ports and back."""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, cast

import numpy as np
import pytest
from msgspec.structs import replace

from dtwin.arm.model import ArmTuning
from dtwin.bus.chain.messages import JointUpload, JointUploadRequest
from dtwin.bus.messages import (
    ARM_UPLOAD,
    PATH,
    PREDICT,
    ROLL_BACK,
    SENSORS,
    SETTINGS,
    UPLOAD,
    SettingsInForce,
    SettingsRequest,
)
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import Predicted, PredictionRequest, RollBackRequest, Upload, UploadRequest
from dtwin.controller.excitation import ExcitationController
from dtwin.controller.settings import usual_gains
from dtwin.errors import CommunicationError
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.model import write_model
from dtwin.identification.result import from_estimate
from dtwin.parameters import ArmParameters, JointVector, scaled
from dtwin.services import simulation
from dtwin.services.runfile import join
from dtwin.signals import Sensors
from dtwin.simulation.checks import MOTIONS
from dtwin.simulation.history import History
from dtwin.simulation.trial import TrialRules
from evidence.identification.standard import standard_settings
from tests.support.desk import Desk, busy_cell, new_desk
from tests.support.waiting import until

HIGHER = usual_gains("computed_torque", kp=(250.0, 500.0, 350.0))


@pytest.fixture(scope="module")
def started() -> Iterator[Desk]:
    """A cell with the simulation service, shared: starting it takes longer than all that one test does to it."""
    with new_desk() as desk:
        history = str(desk.folder / "history.jsonl")
        options = ("--law", "computed_torque", "--simulation", "--history", history)
        desk.detach("--pace", "lockstep", "--seed", "2", *busy_cell(desk.folder), *options)
        yield desk


@pytest.fixture
def cell(started: Desk) -> Iterator[Desk]:
    """The shared cell with nothing on trial and the arm near its path; no service may end during the test."""
    with join("cell") as bus:
        end_the_trial(bus)
    until_calm()
    before = restarts(started)
    yield started
    assert restarts(started) == before


@pytest.fixture
def history(started: Desk) -> History:
    return History(started.folder / "history.jsonl")


def restarts(cell: Desk) -> int:
    count: int = cell.summary()["services"]["simulation"]["restarts"]
    return count


def now(bus: Bus) -> Upload:
    return bus.ask(UPLOAD, None, Upload)


def end_the_trial(bus: Bus) -> None:
    """Takes back what an earlier test has left on trial, which takes less than to wait for its end."""
    if now(bus).on_trial:
        with suppress(CommunicationError):  # the trial has ended meanwhile
            bus.ask(ROLL_BACK, RollBackRequest("anna", "the next test"), Upload)
    until(lambda: not now(bus).on_trial, "no settings are on trial")


def test_a_what_if_starts_where_the_arm_is(cell: Desk) -> None:
    """A what-if starts where the arm is; the candidate's target time counts, not that of the cell."""
    first, second = (
        json.loads(cell.run("simulate", "--live", "--goal", "red", "--json", "--candidate", "T=3")) for _ in range(2)
    )
    base, slower = first["candidates"]
    assert (base["target_time"], slower["target_time"]) == (2.0, 3.0)
    assert base["start"] == slower["start"] != second["candidates"][0]["start"]
    assert base["target"] == [2.5298, -2.0654, -0.4644]


def test_predictions_tell_what_would_be_and_change_nothing(cell: Desk) -> None:
    worn = scaled(ArmParameters(), "D", 1.6)
    with join("cell") as bus:
        before = now(bus)
        usual, blind, knowing, heavy = (
            bus.ask(PREDICT, request, Predicted)
            for request in (
                PredictionRequest(),
                PredictionRequest(arm=worn),
                PredictionRequest(model=worn),
                PredictionRequest(target_time=1.6, box=0.21),
            )
        )
        assert now(bus) == before
        with pytest.raises(CommunicationError, match="target time"):
            bus.ask(PREDICT, PredictionRequest(target_time=-1.0), Predicted)
    assert usual.version == before.version
    assert [(m.start, m.goal, m.carries) for m in usual.motions] == [tuple(motion) for motion in MOTIONS]
    errors = [sum(max(motion.rms) for motion in p.motions) for p in (usual, blind, knowing, heavy)]
    assert errors[1] > 3 * errors[0]
    assert errors[2] == pytest.approx(errors[0], rel=0.5)
    assert max(motion.saturated for motion in heavy.motions) > max(motion.saturated for motion in usual.motions) == 0


@pytest.mark.parametrize("value", [1e-300, 1e300])
def test_an_arm_that_cannot_be_is_refused(cell: Desk, value: float) -> None:
    held = (value, value, value)
    with join("cell") as bus:
        before = now(bus)
        for arm in (ArmParameters(mass=held), ArmParameters(inertia=held), ArmParameters(voltage_constant=held)):
            with pytest.raises(CommunicationError, match=r"1: expected .*, got 1e"):
                bus.ask(PREDICT, PredictionRequest(arm=arm), Predicted)
            with pytest.raises(CommunicationError, match=r"1: expected .*, got 1e"):
                bus.ask(
                    UPLOAD, UploadRequest("x", "y", before.version, usual_gains("computed_torque"), arm=arm), Upload
                )
        with pytest.raises(CommunicationError, match=r"<= 1.0"):
            bus.ask(PREDICT, PredictionRequest(box=1e300), Predicted)
        assert now(bus) == before


def test_gains_are_checked_uploaded_and_confirmed(cell: Desk, history: History) -> None:
    with join("cell") as bus:
        before, count = now(bus).version, len(history.entries())
        first = json.loads(
            cell.run("upload", "gains", "--why", "to try", "--who", "anna", "--kp", "250", "500", "350")
        )
        assert (first["version"], first["action"], first["on_trial"]) == (before + 1, "upload", True)
        assert first["gains"]["kp"] == [250.0, 500.0, 350.0]
        assert bus.ask(SETTINGS, None, SettingsInForce).gains == HIGHER
        until(lambda: not now(bus).on_trial, "the trial of good gains ends")
        assert now(bus).action == "confirm"
    entries = history.entries()
    assert entries[0].action == "start"
    assert [entry.action for entry in entries[count:]] == ["upload", "confirm"]


def test_what_is_refused_changes_nothing(cell: Desk, history: History) -> None:
    with join("cell") as bus:
        before, count = now(bus), len(history.entries())
        held = before.version
        for request, reason in (
            (
                UploadRequest("bob", "old", held - 1, gains=usual_gains("computed_torque")),
                f"expected version {held}, got {held - 1}",
            ),
            (
                UploadRequest("bob", "wild", held, gains=usual_gains("computed_torque", kp=(2000.0,) * 3)),
                "blue with a box: not stable",
            ),
            (
                UploadRequest("bob", "nothing", held),
                "expected gains, a target time or both, or a model, a payload or encoder offsets alone",
            ),
        ):
            with pytest.raises(CommunicationError, match=reason):
                bus.ask(UPLOAD, request, Upload)
        after = now(bus)
        assert (after.version, after.gains, after.target_time) == (held, before.gains, before.target_time)
        assert (after.model, after.on_trial) == (before.model, False)
        assert bus.ask(SETTINGS, None, SettingsInForce).gains == before.gains
    assert [entry.action for entry in history.entries()[count:]] == ["refuse"] * 2, (
        "a request for nothing is not written down"
    )


def test_settings_of_another_arms_controller_are_refused_by_name(cell: Desk, history: History) -> None:
    with join("cell") as bus:
        before, count = now(bus), len(history.entries())
        asked = JointUploadRequest("bob", "calmer", before.version, tuning=ArmTuning(pole=9.0))
        with pytest.raises(CommunicationError, match="tuning: not those of this controller: expected gains"):
            bus.ask(ARM_UPLOAD, asked, JointUpload)
        assert now(bus) == before
    assert "settings: not those of this" in cell.run("upload", "arm", "--pole", "9", "--why", "calmer", status=2)
    assert len(history.entries()) == count


def test_nobody_sets_anything_past_the_checks(cell: Desk, history: History) -> None:
    """The bridge takes settings from the services of the cell alone."""
    with join("cell") as bus, cell.join_as_stranger() as stranger:
        before, count = bus.ask(SETTINGS, None, SettingsInForce), len(history.entries())
        with pytest.raises(CommunicationError, match="unsigned: expected the signature of this cell"):
            stranger.ask(
                SETTINGS,
                SettingsRequest(usual_gains("computed_torque", kp=(220.0, 500.0, 300.0)), 2.0),
                SettingsInForce,
            )
        assert bus.ask(SETTINGS, None, SettingsInForce) == before
    assert len(history.entries()) == count


def test_an_upload_by_somebody_unaware_of_another_one_is_refused(cell: Desk, history: History) -> None:
    """Gains set by another service are found to be in force, as a version of their own."""
    with join("cell") as bus, join("cell") as service:
        before, count = now(bus).version, len(history.entries())
        service.ask(
            SETTINGS, SettingsRequest(usual_gains("computed_torque", kp=(220.0, 500.0, 300.0)), 2.0), SettingsInForce
        )
        with pytest.raises(CommunicationError, match=f"expected version {before + 1}, got {before}"):
            bus.ask(UPLOAD, UploadRequest("anna", "unaware of bob", before, target_time=1.8), Upload)
    assert [entry.action for entry in history.entries()[count:]] == ["start", "refuse"]


def test_a_wrong_model_is_rolled_back(cell: Desk, history: History) -> None:
    wrong = scaled(ArmParameters(), "D", 2.5)
    with join("cell") as bus:
        before, count = now(bus), len(history.entries())
        answer = bus.ask(UPLOAD, UploadRequest("bob", "a wrong model", before.version, model=wrong), Upload)
        assert (answer.version, answer.model) == (before.version + 1, wrong)
        until(lambda: not now(bus).on_trial, "the trial of a wrong model ends")
        last = now(bus)
        assert (last.action, last.version, last.model) == ("roll back", before.version + 2, before.model)
    assert [entry.action for entry in history.entries()[count:]] == ["upload", "roll back"]


def test_values_set_by_hand_pass_the_same_checks_and_stand_in_the_same_history(cell: Desk) -> None:
    """An operator's values pass the same checks, and stand in the same history."""
    with join("cell") as bus:
        before = now(bus)
        for words, found in (
            (
                ["gains", "set", "--kp", "210", "500", "300"],
                lambda said: said["gains"]["kp"] == [210.0, 500.0, 300.0],
            ),
            (["target", "set", "--time", "2.2"], lambda said: said["target_time"] == 2.2),
            (["model", "set", "--set", "m1=0.119"], lambda said: said["model"]["mass"][0] == 0.119),
        ):
            with cell.standing_still():
                said = json.loads(cell.run(*words))
                back = json.loads(cell.run("upload", "rollback", "--why", "enough"))
            assert (said["action"], said["on_trial"], said["text"]) == ("upload", True, "by hand")
            assert found(said)
            assert back["action"] == "roll back"
        after = now(bus)
        assert (after.gains, after.target_time, after.model) == (before.gains, before.target_time, before.model)


def test_numbers_that_no_arm_can_have_are_refused_with_the_range(cell: Desk) -> None:
    """Finite numbers that no arm can have are refused with the range, by the service and by the bridge."""
    heavy = scaled(ArmParameters(), "m", 1e300)
    wild = usual_gains("computed_torque", kp=(1e308, 500.0, 300.0))
    with join("cell") as bus, join("cell") as service:
        before = bus.ask(SETTINGS, None, SettingsInForce)
        asked = UploadRequest("bob", "wild", now(bus).version)
        for upload, request, reason in (
            (replace(asked, gains=wild), SettingsRequest(wild, 2.0), "kp1: expected 0 to 100000, got 1e.308"),
            (replace(asked, model=heavy), SettingsRequest(model=heavy), "m1: expected 0.001 to 1, got 1"),
            (
                replace(asked, target_time=1e-300),
                SettingsRequest(usual_gains("computed_torque"), 1e-300),
                "target time: expected 0.1 to 60 s, got 1e-300",
            ),
            (
                replace(asked, target_time=-1.0),
                SettingsRequest(usual_gains("computed_torque"), -1.0),
                "target time: expected",
            ),
            (
                replace(asked, gains=usual_gains("computed_torque"), model=ArmParameters()),
                SettingsRequest(usual_gains("computed_torque"), 2.0, ArmParameters()),
                "or a model, a payload or encoder offsets alone",
            ),
        ):
            with pytest.raises(CommunicationError, match=reason):
                bus.ask(UPLOAD, upload, Upload)
            with pytest.raises(CommunicationError, match=reason):
                service.ask(SETTINGS, request, SettingsInForce)
        for question in (PredictionRequest(target_time=1e300), PredictionRequest(gains=wild)):
            with pytest.raises(CommunicationError, match="expected 0"):
                bus.ask(PREDICT, question, Predicted)
        assert bus.ask(SETTINGS, None, SettingsInForce) == before
    assert "kp1: expected 0 to 100000" in cell.run("gains", "set", "--kp", "1e308", "1", "1", status=2)


def test_identified_models_and_optimised_gains_come_from_files(cell: Desk, tmp_path: Path) -> None:
    estimate = identify(
        [Rig(noise=0.002).measure(Plan(), ExcitationController(), np.random.default_rng(0))], standard_settings()
    )
    file = tmp_path / "arm.json"
    write_model(from_estimate(estimate, np.ones(3), "test"), file)
    said = cell.run("upload", "model", "--why", "identified", "--model", str(file), "--wait").splitlines()
    answers: list[dict[str, Any]] = [json.loads(line) for line in said]
    assert [answer["action"] for answer in answers] == ["upload", "confirm"]
    assert answers[-1]["model"]["damping"] == list(estimate.parameters.damping)
    saved = tmp_path / "best.json"
    saved.write_text(
        json.dumps({"target_time": 1.9, "gains": {"kp": [210, 480, 300], "ki": [70, 200, 150], "kd": [2, 2, 2]}})
    )
    upload = ("upload", "gains", "--why", "optimised", "--file", str(saved), "--arm", str(file))
    with cell.standing_still():
        answer = json.loads(cell.run(*upload))
        message = cell.run("upload", "target", "--why", "impatient", "--time", "0.2", status=2)
    assert answer["target_time"] == 1.9
    assert answer["gains"]["kp"] == [210.0, 480.0, 300.0]
    assert answer["gains"]["kd"] == [2.0, 2.0, 2.0]
    assert "is on trial until" in message


def test_a_killed_service_finds_old_or_new_settings_and_watches_the_new(started: Desk, history: History) -> None:
    """Killed while it checks, once the upload is written down, and once the controller has it."""
    with join("cell") as bus, ThreadPoolExecutor() as pool:
        until_there(bus)
        end_the_trial(bus)

        def written() -> bool:
            last = history.last()
            return last is not None and last.action == "upload"

        def sent() -> bool:
            return bus.ask(SETTINGS, None, SettingsInForce).gains != before.gains

        for number, (moment, when) in enumerate((("checks", lambda: True), ("written", written), ("sent", sent))):
            before = now(bus)
            wanted = usual_gains("computed_torque", kp=(210.0 + number, 500.0, 300.0))
            request = UploadRequest("anna", moment, before.version, gains=wanted)
            asked = pool.submit(bus.ask, UPLOAD, request, Upload)
            until(when, moment, between=lambda: None)
            os.kill(started.find("dtwin.services.simulation"), signal.SIGKILL)
            asked.exception()
            after = until_there(bus)
            in_force = bus.ask(SETTINGS, None, SettingsInForce).gains
            assert in_force in (before.gains, wanted), moment
            assert after.gains == in_force, moment
            last = history.last()
            assert last is not None
            assert (last.version, last.settings.gains) == (after.version, in_force), moment
            until(lambda: not now(bus).on_trial, "the trial ends")
            assert now(bus).action == ("confirm" if in_force == wanted else after.action), moment
            if in_force == wanted:
                lasted = re.search(r"for (\d+\.\d) s", now(bus).text)
                assert lasted is not None
                rules, watched = TrialRules(), float(lasted[1])
                assert rules.duration <= watched < 2 * rules.longest, "what was watched, not the time until then"
        assert now(bus).gains == wanted, "what has been sent is watched, not lost"


class FakeUploader:
    """Refuses every upload, and notes that it came."""

    trial, last, version = None, None, 1

    def __init__(self, checker: FakeChecker) -> None:
        self._noted = checker.noted

    def look_again(self, time: float) -> None:
        pass

    def upload(self, *asked: object) -> None:
        self._noted.append("upload")
        raise CommunicationError("refused")


class FakeChecker:
    """Notes that it is loaded."""

    def __init__(self) -> None:
        self.noted: list[str] = []

    def load(self) -> None:
        self.noted.append("load")

    def expected_tracking(self, *settings: object) -> None:
        self.noted.append("check")


class FakeService:
    """Uploads as soon as the service says that it is there, and has it end then; it is its own bus."""

    def __init__(self) -> None:
        self.bus, self.stopping, self.doing = self, False, ""
        self.inbox: SimpleQueue[object] = SimpleQueue()
        self._answers: dict[str, Any] = {}

    def publisher(self, topic: Topic) -> None:
        pass

    def subscribe(self, *what: object) -> None:
        pass

    def refuse(self) -> None:
        pass

    def answer(self, topic: Topic, request: type, handle: Any, now: Any = None) -> None:
        self._answers[topic.name] = handle

    def report_due(self) -> bool:
        return False

    def report(self, *what: object, **figures: object) -> None:
        pass

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        yield

    def ready(self) -> None:
        self.stopping = True
        with pytest.raises(CommunicationError, match="refused"):
            self._answers[UPLOAD.name](UploadRequest("test", "at once", 1, target_time=3.0))


def test_an_upload_that_comes_at_once_waits_for_what_it_is_checked_with(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    checker = FakeChecker()
    monkeypatch.setattr(simulation, "Uploader", lambda *parts: FakeUploader(checker))
    history = History(tmp_path / "history.jsonl")
    simulation.Simulation(cast(Any, FakeService()), history, cast(Any, checker)).run()
    assert checker.noted == ["load", "upload"]


def until_calm(samples: int = 200) -> None:
    """The arm has been near its path for a while: one that a wrong model has thrown off fails the next trial."""
    angles: dict[int, JointVector] = {}
    inside = 0

    def judge(path: PathAngles) -> None:
        nonlocal inside
        theta = angles.pop(path.sequence, None)
        if theta is not None:
            near = max(abs(a - b) for a, b in zip(path.theta, theta, strict=True)) < 0.01
            inside = inside + 1 if near else 0

    with join("cell") as bus:
        bus.subscribe(SENSORS, Sensors, lambda sample: angles.__setitem__(sample.sequence, sample.theta))
        bus.subscribe(PATH, PathAngles, judge)
        until(lambda: inside >= samples, "the arm follows its path", 60.0)


def until_there(bus: Bus) -> Upload:
    """What the service says as soon as it is back."""

    def answer() -> Upload | None:
        try:
            return bus.ask(UPLOAD, None, Upload, 1.0)
        except CommunicationError:
            return None

    return until(answer, "the service answers", 60.0)
