"""A cell whose controller is a 4diac FORTE; what concerns settings also with the embedded device in its place."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from dtwin.bus.messages import (
    EVENTS,
    SETTINGS,
    SIGNAL,
    UPLOAD,
    VOLTAGES,
    IdentificationSignal,
    SettingsInForce,
    SettingsRequest,
    SignalRequest,
)
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.settings import usual_gains
from dtwin.errors import CommunicationError
from dtwin.identification.store import ModelStore, open_model
from dtwin.logs.reading import read_log
from dtwin.parameters import ArmParameters, Gains, scaled
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions, PlantOptions
from dtwin.run.settings import CellSettings
from dtwin.services.controller import deploy_cell
from dtwin.services.runfile import join
from dtwin.signals import Event, EventKind, Voltages
from dtwin.simulation.history import History
from tests.support.desk import Desk
from tests.support.forte import FORTE, FORTES, NO_FORTE, forte
from tests.support.waiting import until

needs_forte = pytest.mark.skipif(not FORTE, reason=NO_FORTE)


EMBEDDED_TOO = pytest.mark.parametrize(
    "controller", [pytest.param("embedded", marks=pytest.mark.thorough), *FORTES], indirect=True
)
"""Test_simulation_service.py, test_secured.py and the pages do the same with the embedded device in any run."""


@pytest.fixture(params=["embedded", *FORTES])
def controller(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """What `dtwin up` is told of the controller."""
    if request.param == "embedded":
        yield "embedded"
        return
    with forte(tmp_path, binary=request.param) as address:
        yield f"forte://{address}"


@pytest.mark.parametrize("binary", FORTES)
@pytest.mark.parametrize("cell_file", [None, "four-colours"])
def test_a_forte_moves_the_arm_as_the_embedded_device_does(
    desk: Desk, tmp_path: Path, cell_file: str | None, binary: str
) -> None:
    log = tmp_path / "run.parquet"
    with forte(tmp_path, binary=binary) as address:
        words = ["--controller", f"forte://{address}", "--pace", "lockstep", "--duration", "30", "--seed", "1"]
        words += ["--cell-file", cell_file] if cell_file else []
        desk.up(*words, "--log", str(log), "--json")
    plant = PlantOptions(seed=1, cell_file=cell_file).settings()
    control = ControlOptions(cell_file=cell_file).control()
    cell = Cell(dataclasses.replace(plant, duration=30.0, control=control))
    cell.run()
    expected, found = cell.log.freeze(), read_log(log)
    assert found.events == expected.events
    np.testing.assert_allclose(found.stack("volts"), expected.stack("volts"), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.stack("target"), expected.stack("target"), rtol=0, atol=1e-9)


@needs_forte
def test_a_forte_that_starts_again_gets_application_and_settings_before_the_arm_moves(
    desk: Desk, tmp_path: Path
) -> None:
    gains = usual_gains("computed_torque", (260.0, 500.0, 300.0))
    events: list[Event] = []
    volts: list[Voltages] = []
    with ExitStack() as life:
        address = life.enter_context(forte(tmp_path))
        desk.detach("--controller", f"forte://{address}", "--pace", "lockstep", "--seed", "2")
        with join("cell") as bus, join("cell") as service:
            bus.subscribe(EVENTS, Event, events.append)
            bus.subscribe(VOLTAGES, Voltages, volts.append)
            service.ask(SETTINGS, SettingsRequest(gains, 3.0), SettingsInForce)
            until(lambda: len(volts) > 100, "the cell runs")
            life.close()
            with forte(tmp_path, port=address.port):
                until(lambda: any(event.kind == EventKind.TROUBLE for event in events), "an event says why", 60.0)
                (text,) = (event.text for event in events if event.kind == EventKind.TROUBLE)
                assert "no sample is answered" in text

                def waiting() -> bool:
                    bridge = desk.summary()["services"]["bridge"]
                    return bridge["state"] == "waiting" and "deploy the application first" in bridge["last_error"]

                # The status of a service is a second old at most.
                until(waiting, "the bridge waits and says for what", 60.0)
                reached = len(volts)
                deploy_cell(address, ControlOptions().control())
                until(lambda: len(volts) > reached + 100, "the cell goes on", 60.0)
                kinds = [event.kind for event in events]
                assert EventKind.RESTORED in kinds
                found = bus.ask(SETTINGS, None, SettingsInForce)
                assert (found.gains, found.target_time) == (gains, 3.0)
                assert "is down" in desk.run("down")


@EMBEDDED_TOO
def test_uploads_are_acknowledged_watched_and_confirmed(controller: str, desk: Desk, tmp_path: Path) -> None:
    history = tmp_path / "history.jsonl"
    options = ["--law", "row_sum", "--simulation", "--history", str(history)]
    desk.detach("--controller", controller, "--pace", "lockstep", "--seed", "2", *options)
    with join("cell") as bus:
        first = bus.ask(SETTINGS, None, SettingsInForce)
        assert (first.law, first.payload, first.payload_model) == ("row_sum", 0.2, "weight")
        assert first.gains == usual_gains("computed_torque")
        uploads(bus)
        by_hand(desk, bus)
    actions = [entry.action for entry in History(history).entries()]
    assert actions == ["start", *["upload", "confirm"] * 3, "refuse", "upload", "roll back", "upload"]
    assert [*dict.fromkeys(entry.settings.law for entry in History(history).entries())] == ["row_sum"]
    services = desk.summary()["services"]
    assert {name: service["restarts"] for name, service in services.items() if service["restarts"]} == {}
    assert "is down" in desk.run("down")


def uploads(bus: Bus) -> None:
    heavier = scaled(ArmParameters(), "m", 1.01)
    gains = Gains((210.0, 480.0, 310.0), (80.0, 190.0, 150.0), (2.1, 2.0, 2.0))
    blank = UploadRequest("anna", "better", 0)
    for request in (
        replace(blank, gains=gains, target_time=2.2),
        replace(blank, model=heavier),
        replace(blank, target_time=2.0),
    ):
        before = now(bus).version
        answer = bus.ask(UPLOAD, replace(request, based_on=before), Upload)
        assert (answer.version, answer.action, answer.on_trial) == (before + 1, "upload", True)
        until(lambda: not now(bus).on_trial, "the trial ends", 60.0)
        assert now(bus).action == "confirm"
    found = bus.ask(SETTINGS, None, SettingsInForce)
    assert (found.gains, found.target_time) == (gains, 2.0)
    np.testing.assert_allclose(found.model.vector(), heavier.vector(), rtol=1e-14)
    wild = replace(blank, based_on=now(bus).version, gains=usual_gains("computed_torque", kp=(2000.0,) * 3))
    with pytest.raises(CommunicationError, match="not stable: spectral radius"):
        bus.ask(UPLOAD, wild, Upload)
    assert bus.ask(SETTINGS, None, SettingsInForce) == found


def by_hand(desk: Desk, bus: Bus) -> None:
    with desk.standing_still():
        desk.run("upload", "gains", "--why", "to try", "--who", "anna", "--kp", "260", "500", "300")
        assert bus.ask(SETTINGS, None, SettingsInForce).gains.kp == (260.0, 500.0, 300.0)
        answer = json.loads(desk.run("upload", "rollback", "--why", "no good", "--who", "bob"))
    assert (answer["action"], answer["on_trial"], answer["gains"]["kp"]) == (
        "roll back",
        False,
        [210.0, 480.0, 310.0],
    )
    assert bus.ask(SETTINGS, None, SettingsInForce).gains.kp == (210.0, 480.0, 310.0)
    assert "nothing is on trial" in desk.run("upload", "rollback", "--why", "again", status=2)
    assert "between two messages" in desk.run("upload", "version", "1", "--why", "as before", status=2)
    answer = json.loads(desk.run("upload", "version", "3", "--why", "slower again", "--who", "bob"))
    assert (answer["action"], answer["on_trial"], answer["target_time"]) == ("upload", True, 2.2)
    assert bus.ask(SETTINGS, None, SettingsInForce).target_time == 2.2


def now(bus: Bus) -> Upload:
    return bus.ask(UPLOAD, None, Upload)


@EMBEDDED_TOO
def test_the_running_arm_is_identified(controller: str, desk: Desk, tmp_path: Path) -> None:
    store = tmp_path / "store"
    options = ["--noise", "0.002", "--identification", "--store", str(store)]
    options += ["--simulation", "--history", str(tmp_path / "history.jsonl")]
    desk.detach("--controller", controller, "--pace", "lockstep", "--seed", "2", *options)
    with join("cell") as bus:
        signal_ = bus.ask(SIGNAL, None, IdentificationSignal)
        assert signal_ == IdentificationSignal((6.0, 4.0, 3.0), 5, (0, 0, 0), 350)
        volts: list[Voltages] = []
        bus.subscribe(VOLTAGES, Voltages, volts.append)
        until(lambda: bool(volts) and volts[-1].box_gripped, "a box is carried, whose mass nobody knows")
        said = json.loads(desk.run("identify", "live", "--accept", "--upload", "--json"))
        assert (said["phase"], said["samples"]) == ("accepted", 350)
        played = [command for command in volts if abs(command.volts[0]) == 6.0]
        assert len(played) >= 350
        assert not any(command.box_gripped for command in played)
        assert bus.ask(SETTINGS, None, SettingsInForce).model.damping != ArmParameters().damping
        model = open_model("arm", ModelStore(store))
        np.testing.assert_allclose(model.arm.damping, ArmParameters().damping, rtol=0.05)
        # asked for and taken back: the controller has the arm again long before the signal would end
        bus.ask(SIGNAL, SignalRequest(True), IdentificationSignal)
        until(lambda: volts[-1].volts[:3] == (6.0, 4.0, 3.0), "the signal plays")
        bus.ask(SIGNAL, SignalRequest(False), IdentificationSignal)
        at = len(volts)
        until(lambda: len(volts) > at + 100, "the cell goes on")
        assert sum(abs(command.volts[0]) == 6.0 for command in volts[at + 20 : at + 100]) == 0
    assert "is down" in desk.run("down")


def test_sending_the_same_settings_again_changes_no_voltage(controller: str, desk: Desk, tmp_path: Path) -> None:
    disturbed = tmp_path / "disturbed.parquet"
    control = ControlOptions().control()
    desk.detach("--controller", controller, "--pace", "lockstep", "--seed", "3", "--log", str(disturbed))
    sent = 0
    volts: list[Voltages] = []
    with join("cell") as bus:
        bus.subscribe(VOLTAGES, Voltages, volts.append)
        while sent <= 10 or len(volts) < 1200:  # how far the cell gets between two requests is up to the scheduler
            bus.ask(SETTINGS, SettingsRequest(control.gains, control.target_time), SettingsInForce, 10.0)
            bus.ask(SETTINGS, SettingsRequest(model=control.model), SettingsInForce, 10.0)
            sent += 1
    assert "is down" in desk.run("down")
    found = read_log(disturbed).stack("volts")
    assert len(found) >= 1200
    # over the bus it is the same, byte for byte
    quiet = Cell(CellSettings(duration=round(0.01 * len(found), 2), seed=3, control=control))
    quiet.run()
    assert found.tobytes() == quiet.log.freeze().stack("volts").tobytes()
