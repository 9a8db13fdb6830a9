"""A cell of another arm than the thesis's on the bus: what it logs, how it is stopped, and what outlives a kill."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.arm.file import MODELS
from dtwin.arm.model import ArmModel, ArmTuning
from dtwin.arm.modelled import with_model
from dtwin.bus.chain.messages import JointAdjustment, JointModel, JointSensors, JointUpload
from dtwin.bus.messages import (
    ACKNOWLEDGE,
    ADJUSTMENT,
    ARM_UPLOAD,
    EVENTS,
    FAULT,
    JOINT_SENSORS,
    MODEL,
    MONITORING,
    Done,
    FaultRequest,
)
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import drawn
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import CommunicationError
from dtwin.services.chain.starting import ENDINGS
from dtwin.services.runfile import join
from dtwin.signals import Event
from tests.run.test_chain_sorting import TASK
from tests.support.desk import Desk
from tests.support.waiting import until

ARM = arm_of("planar-2r")
CELL = 'arm = "planar-2r"\nmachine = "7"\nsort = "task.toml"\nlate = 1\n'


def check_held(samples: list[JointSensors]) -> None:
    """Checks that an arm whose path stands comes to rest there, and then stays for a second of samples that come."""

    def moved(first: int) -> float:
        return float(max(np.ptp([sample.theta for sample in samples[first:]], axis=0)))

    until(lambda: len(samples) >= 20 and moved(-20) < 1e-3, "its drives have come to where the path stands")
    seen = len(samples)
    until(lambda: len(samples) > seen + 100, "a second passes")
    assert moved(seen) < 1e-3


def test_all_models_of_arms_are_taken_for_arms() -> None:
    assert set(ENDINGS) == {".toml", *MODELS}


def test_lockstep_over_zenoh_logs_what_a_headless_run_of_the_arm_logs(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TASK)
    (tmp_path / "cell.toml").write_text(CELL)
    served, headless = tmp_path / "served.parquet", tmp_path / "headless.parquet"
    words = ["--cell-file", str(tmp_path / "cell.toml"), "--seed", "3", "--duration", "9"]
    summary = json.loads(desk.up("--pace", "lockstep", *words, "--log", str(served), "--json"))
    counted = json.loads(desk.run("run", *words, "--log", str(headless), "--json"))["boxes"]
    assert pq.read_table(served).equals(pq.read_table(headless), check_metadata=True)
    assert summary["ticks"] == 900
    assert set(summary["services"]) == {"recorder", "bridge", "emulator"}
    assert counted["delivered"] > 0
    assert summary["boxes"]["delivered"] == counted["delivered"]
    assert not desk.processes()


def test_a_recorder_that_is_behind_gets_all_of_another_arm(desk: Desk, tmp_path: Path) -> None:
    log = tmp_path / "run.parquet"
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--duration", "20", "--log", str(log)]
    desk.detach(*words)
    recorder = desk.find("chain.recorder")
    os.kill(recorder, signal.SIGSTOP)
    until(lambda: desk.summary()["services"]["emulator"]["state"] == "stopping", "all ticks have passed", 60.0)
    os.kill(recorder, signal.SIGCONT)
    until(lambda: log.exists(), "the log is there", 60.0)
    until(lambda: not desk.processes(), "the cell has ended")
    assert len(pq.read_table(log)) == 2000


def test_an_arm_in_real_time_is_watched_stopped_released_and_outlives_its_services(
    desk: Desk, tmp_path: Path
) -> None:
    log = tmp_path / "run.parquet"
    desk.detach("--arm", "planar-2r", "--machine", "nominal", "--log", str(log))
    until(lambda: desk.summary()["ticks"] > 100, "the arm runs in real time")
    (line,) = desk.run("watch", "joints/sensors", "--count", "1").splitlines()
    assert line.startswith("dtwin/cell/planar-2r/joints/sensors sequence=")
    assert "the function blocks run in the bridge" in desk.run("status")
    assert desk.run("stop").startswith("standstill")
    with join("cell") as bus:
        samples: list[JointSensors] = []
        bus.subscribe(JOINT_SENSORS, JointSensors, samples.append)
        check_held(samples)
    os.kill(desk.find("chain.bridge"), signal.SIGKILL)
    back = {"restarts": 1, "state": "stopped"}.items()
    until(lambda: back <= desk.summary()["services"]["bridge"].items(), "the bridge is back, and so is the stop")
    assert desk.run("release").startswith("none")
    tick = desk.tick()
    until(lambda: desk.tick() > tick + 50, "the arm goes on")
    assert "down" in desk.run("down")
    t = np.asarray(pq.read_table(log)["t"])
    assert np.allclose(np.diff(t), 0.01), "no tick is missing, whatever was killed"


def test_the_monitor_of_another_arm_learns_it_names_a_fault_and_has_it_stopped(desk: Desk) -> None:
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--healthy", "20"]
    assert "--monitoring beside it" in desk.run("up", *words, status=2)
    desk.detach(*words, "--monitoring", "--safe-stop")
    verdicts: list[MonitoringVerdict] = []
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: verdicts and verdicts[-1].units["joint 1"].state == "nominal", "the arm is known", 60.0)
        assert list(verdicts[-1].units) == ["joint 1", "joint 2", "tool"]
        assert desk.summary()["verdict"] == "nominal"
        bus.ask(FAULT, FaultRequest(("K1*=0.6@0",)), Done)
        until(lambda: any(event.kind == "monitor_failed" for event in events), "the fault is told", 60.0)
        until(lambda: verdicts[-1].findings, "so does the verdict")
        unit = verdicts[-1].units["joint 1"]
        assert (unit.state, unit.parameter, unit.settled) == ("failed", "K1", True)
        assert abs(unit.size + 0.4) < 0.1
        until(lambda: any(event.kind == "monitor_stop" for event in events), "a stop is asked for")
        assert "drive of shoulder" in desk.run("status")
        os.kill(desk.find("dtwin.services.chain.monitoring"), signal.SIGKILL)
        until(lambda: any(event.kind == "restored" for event in events), "another process takes its place", 60.0)
        assert bus.ask(ACKNOWLEDGE, None, MonitoringVerdict).units["joint 1"] == unit, "it knows what that one knew"
        assert "no finding 'K2': expected K1" in desk.run("monitor", "acknowledge", "K2", status=2)
        assert "joint 1   not commissioned" in desk.run("monitor", "acknowledge", "K1")
    assert desk.run("release").startswith("none")


def test_recovery_lets_the_blocks_of_another_arm_count_on_what_was_found(desk: Desk) -> None:
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--monitoring", "--healthy", "30"]
    desk.detach(*words, "--recovery", "act", "--fault", "K1*=0.7@45")
    verdicts: list[MonitoringVerdict] = []
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: verdicts and verdicts[-1].units["joint 1"].state == "nominal", "the arm is known", 60.0)
        until(lambda: any(event.kind == "recovery" for event in events), "the fault is answered", 60.0)
        found = bus.ask(ADJUSTMENT, None, JointAdjustment)
        assert found.who == "recovery"
        assert found.strength == pytest.approx((0.7, 1.0), abs=0.05)
        assert_nothing_more_fails(verdicts, events)
        wrong = JointAdjustment("test", "too few", (0.0,), (1.0,), (1.0,))
        with pytest.raises(CommunicationError, match="offset: expected 2 values, one of each joint, got 1"):
            bus.ask(ADJUSTMENT, wrong, JointAdjustment)
        bus.ask(FAULT, FaultRequest(("lock2@0",)), Done)
        until(lambda: any(event.kind == "help" for event in events), "a person is called", 60.0)
    until(lambda: desk.summary()["services"]["bridge"]["state"] == "stopped", "the bridge says that the arm stands")


def assert_nothing_more_fails(verdicts: list[MonitoringVerdict], events: list[Event], seconds: float = 60.0) -> None:
    """For so long after an answer the arm is healthy; a doubt that passes is none of its faults."""
    until(lambda: any(event.kind == "monitor_recovered" for event in events), "the monitor counts on the answer")
    answered = next(event.time for event in events if event.kind == "monitor_recovered")
    until(lambda: verdicts[-1].time > answered + seconds, "the arm works on", 60.0)
    after = [verdict for verdict in verdicts if verdict.time > answered]
    states = [unit.state for verdict in after for unit in verdict.units.values()]
    assert set(states) <= {"nominal", "may be degrading"}
    assert states.count("nominal") > 0.9 * len(states)
    assert [event.kind for event in events].count("monitor_failed") == 1


def test_a_person_approves_what_recovery_of_another_arm_proposes(desk: Desk, tmp_path: Path) -> None:
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--monitoring", "--healthy", "20"]
    assert "expected --monitoring beside it" in desk.run("up", *words[:6], "--recovery", "propose", status=2)
    desk.detach(*words, "--recovery", "propose", "--history", str(tmp_path / "uploads.jsonl"))
    verdicts: list[MonitoringVerdict] = []
    events: list[Event] = []

    def told(kind: str) -> list[str]:
        return [event.text for event in events if event.kind == kind]

    with join("cell") as bus:
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: verdicts and verdicts[-1].units["joint 1"].state == "nominal", "the arm is known", 60.0)
        bus.ask(FAULT, FaultRequest(("K1*=0.7@0",)), Done)
        until(lambda: told("proposal"), "the answer is proposed", 60.0)
        assert bus.ask(ADJUSTMENT, None, JointAdjustment).strength == (1.0, 1.0), "nothing moves before"
        assert "strength for K1; `dtwin mcp approve 1`" in told("proposal")[0]
        assert "answer K1 by recovery: open" in desk.run("mcp", "proposals")
        desk.run("mcp", "approve", "1", "--yes", "--who", "ann")
        until(lambda: told("recovery"), "it is done")
        assert "proposal 1, approved by ann: " in told("recovery")[0]
        found = bus.ask(ADJUSTMENT, None, JointAdjustment)
        assert (found.who, found.strength) == ("ann", pytest.approx((0.7, 1.0), abs=0.05))
        assert "approved, ann" in desk.run("mcp", "proposals")
        assert "approved already" in desk.run("mcp", "approve", "1", "--yes", "--who", "bob", status=2)
        bus.ask(FAULT, FaultRequest(("freeze2@0",)), Done)
        until(lambda: told("help"), "a stop waits for nobody", 60.0)


def test_the_twin_of_a_running_arm_answers_what_if(desk: Desk, tmp_path: Path) -> None:
    files = ["--history", str(tmp_path / "uploads.jsonl")]
    desk.detach("--arm", "planar-2r", "--machine", "nominal", "--pace", "lockstep", "--simulation", *files)
    question = ["simulate", "--live", "--pole", "8"]

    def measured() -> dict[str, Any] | None:
        found: dict[str, Any] = json.loads(desk.run(*question, "--json"))
        return found if found["measured"] else None

    found = until(measured, "8 s have passed", 60.0)
    # From a pose in the middle of a motion the arm of either may be farther off at first.
    answers = [json.loads(desk.run(*question, "--json")) for _ in range(7)]
    softer = [max(each["proposed"]["tracking"]) - max(each["now"]["tracking"]) for each in answers]
    assert median(softer) > 0.0
    assert max(found["measured"]) < 5.0 * max(found["now"]["tracking"])
    assert found["version"] == 1
    assert "modulus" in desk.run(*question)
    assert "pole: expected 1 to 60 rad/s" in desk.run("simulate", "--live", "--pole", "80", status=2)
    upload = ["upload", "arm", "--who", "ann", "--why", "calmer"]
    assert "speed: expected 0.1 to 1 of the data sheet's" in desk.run(*upload, "--speed", "1.2", status=2)
    assert "expected a file, --pole, --observer or --speed" in desk.run(*upload, status=2)
    tried = json.loads(desk.run(*upload, "--pole", "11", "--speed", "0.8"))
    assert (tried["version"], tried["tuning"]) == (2, {"pole": 11.0, "observer": 100.0, "speed": 0.8})
    with join("cell") as bus:
        until(lambda: not bus.ask(ARM_UPLOAD, None, JointUpload).on_trial, "the trial is over", 60.0)
        assert bus.ask(ARM_UPLOAD, None, JointUpload).action == "confirm"
        wrong = JointModel("test", "far too stiff", ArmModel.of(ARM), ArmTuning(pole=1e4))
        with pytest.raises(CommunicationError, match="pole: expected 1 to 60 rad/s"):
            bus.ask(MODEL, wrong, JointModel)
        assert bus.ask(MODEL, None, JointModel).tuning == ArmTuning(pole=11.0, speed=0.8)
    history = desk.run("history")
    assert "refuse settings by ann: calmer" in history
    assert "version 2  upload settings by ann: calmer" in history
    assert "pole 11 rad/s, observer 100 rad/s, speed 0.8" in history
    said = desk.run("upload", "gains", "--kp", "1", "2", "3", "--why", "stiffer", status=2)
    assert "settings: not those of this controller: expected a model, a tuning or both" in said
    assert "--kp: has no meaning for another arm" in desk.run("simulate", "--live", "--kp", "1", "2", "3", status=2)


def test_another_arm_is_identified_while_it_works_and_its_blocks_get_the_model(desk: Desk, tmp_path: Path) -> None:
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--identification", "--simulation"]
    files = ["--store", str(tmp_path / "store"), "--history", str(tmp_path / "uploads.jsonl")]
    desk.detach(*words, *files)
    refused = desk.run("identify", "live", "--source", "signal", status=2)
    assert "expected no --source but motion" in refused
    live = ["identify", "live", "--accept", "--name", "found"]
    said = desk.run(*live, "--upload")
    assert "on trial in the blocks as version 2 of their settings" in said
    found = ArmModel.of(arm_of(str(tmp_path / "store" / "found.toml")))
    truth, sheet = (ArmModel.of(arm) for arm in (drawn(ARM, 7), ARM))
    assert found.constant == pytest.approx(truth.constant, rel=0.2)
    with join("cell") as bus:
        now = bus.ask(MODEL, None, JointModel)
        assert now.who == "identification", desk.run("history")
        assert now.model.constant == pytest.approx(found.constant, rel=1e-9)
        kept, told = (usual_inertia(with_model(ARM, model)) for model in (found, now.model))
        assert told == pytest.approx(kept, rel=1e-3), "the file of the model rounds"
        until(lambda: not bus.ask(ARM_UPLOAD, None, JointUpload).on_trial, "the trial is over", 60.0)
        done = bus.ask(ARM_UPLOAD, None, JointUpload)
        assert (done.action, done.version) == ("confirm", 2)
        wrong = JointModel("test", "far too heavy", replace(sheet, coulomb=(1e4, 0.0)))
        with pytest.raises(CommunicationError, match="coulomb of joint 1: expected 0 to"):
            bus.ask(MODEL, wrong, JointModel)
    os.kill(desk.find("chain.bridge"), signal.SIGKILL)
    with join("cell") as bus:
        until(lambda: _model_of(bus) == done.model, "another bridge gets the model again", 30.0)
    sheet_again = json.loads(desk.run("upload", "arm", "planar-2r", "--why", "as it was", "--who", "ann"))
    assert (sheet_again["version"], sheet_again["on_trial"]) == (3, True)
    with join("cell") as bus:  # with the data sheet the arm is farther from its path than the twin expects
        until(lambda: not bus.ask(ARM_UPLOAD, None, JointUpload).on_trial, "the worse model is judged", 60.0)
        assert bus.ask(MODEL, None, JointModel).model == done.model
    assert "nothing is on trial" in desk.run("upload", "rollback", "--why", "no", status=2)
    history = desk.run("history")
    for line in (
        "version 2  upload settings by identification",
        "version 3  upload settings by ann",
        "version 4  roll back",
    ):
        assert line in history
    assert "version 9: expected one of the history" in desk.run(
        "upload", "arm", "--version", "9", "--why", "x", status=2
    )


def _model_of(bus: Bus) -> ArmModel | None:
    try:
        return bus.ask(MODEL, None, JointModel).model
    except CommunicationError:
        return None


def test_an_arm_whose_drives_take_positions_is_held_where_it_was_by_whatever_stops_it(desk: Desk) -> None:
    """A command of zero would move it. Stopped by a person, and without a controller and its supervisor's help."""
    words = ["--arm", "servo-2r", "--machine", "nominal"]
    assert "makes its torque itself" in desk.run("up", *words, "--identification", status=2)
    desk.detach(*words)
    until(lambda: desk.summary()["ticks"] > 100, "the arm runs in real time")
    assert desk.run("stop").startswith("standstill")
    with join("cell") as bus:
        samples: list[JointSensors] = []
        bus.subscribe(JOINT_SENSORS, JointSensors, samples.append)
        check_held(samples)
        assert desk.run("release").startswith("none")
        events: list[Event] = []
        bus.subscribe(EVENTS, Event, events.append)
        os.kill(desk.find("chain.bridge"), signal.SIGSTOP)
        until(lambda: any(event.kind == "safe" for event in events), "the emulator misses its commands")
        where = samples[-1]
        until(lambda: samples[-1].time > where.time + 1.0, "the arm is held")
        held = [sample.theta for sample in samples if sample.time > where.time + 0.5]
        assert max(np.ptp(held, axis=0)) < 1e-3
        assert np.abs(np.array(held[-1]) - where.theta).max() < 0.2
        assert np.abs(held[-1]).max() > 0.05, "it did not go to zero"
        os.kill(desk.find("chain.bridge"), signal.SIGCONT)
        until(lambda: any(event.kind == "restored" for event in events), "commands come back")
        tick = desk.tick()
        until(lambda: desk.tick() > tick + 100, "the arm moves again")
        assert np.abs(np.array(samples[-1].theta) - held[-1]).max() > 0.01, "it goes on from where it is held"
        assert desk.summary()["services"]["bridge"]["state"] == "running", "what waited meanwhile did not stop it"
