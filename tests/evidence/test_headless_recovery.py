"""The cell in one process: the operator hears and does there what the services of a cell would tell and do."""

from pathlib import Path

import pytest

from dtwin.bus.messages import FAULT, STOP, UPLOAD, Done, FaultRequest, StopRequest, StopState
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.errors import ParameterError
from dtwin.recovery.desk import Desk, Message, StoppedByController
from dtwin.run.settings import CellSettings
from dtwin.services.launch import CellOptions
from dtwin.signals import EventKind
from dtwin.twin.effects import NO_EFFECTS
from evidence.recovery.demonstration import recover
from evidence.recovery.headless import HeadlessCell
from evidence.recovery.known import KnownArm
from tests.support.records import recorded

CONTROL = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
KNOWN = recorded(NO_EFFECTS)


def _cell(folder: Path) -> tuple[HeadlessCell, Desk]:
    cell = HeadlessCell(CellSettings(seed=3, noise=0.001, control=CONTROL), KNOWN, folder)
    return cell, cell.desk(lambda time: None, 60.0)


def _halted(folder: Path) -> tuple[HeadlessCell, list[Message]]:
    """A cell whose encoder 2 stops on its way, which the blocks see, and what was said up to the operator's stop."""
    folder.mkdir()
    cell, desk = _cell(folder)
    heard: list[Message] = []
    asked = FaultRequest(("freeze2@4",))
    assert cell.ask(FAULT, asked, Done) == Done(4.0, "freeze2@4")
    with pytest.raises(StoppedByController):
        heard.extend(desk.messages())
    state = cell.ask(STOP, StopRequest("operator", "its encoder has stopped", "angles unknown"), StopState)
    assert state.stop == "torque off"
    desk.stopped = True
    desk.pass_time(0.5)
    return cell, heard


def test_a_cell_in_one_process_is_the_same_whenever_it_is_repeated(tmp_path: Path) -> None:
    """What is found stops the arm, and log and events tell of it."""
    (first, heard), (second, heard_again) = (_halted(tmp_path / name) for name in ("one", "two"))
    assert heard == heard_again
    log, again = first.log(), second.log()
    assert log.events == again.events
    assert all((log.columns[name] == again.columns[name]).all() for name in ("theta_1", "measured_2", "volts_3"))
    stops = [event for event in log.events if event.kind == EventKind.STOP]
    assert stops[0].text.startswith("safe stop: braking (the controller has stopped the arm")
    assert stops[-1].text == "safe stop: torque off (operator: its encoder has stopped)"
    assert (log.stack("volts")[-10:, :3] == 0.0).all()


def test_settings_are_on_trial_until_their_samples_were_judged(tmp_path: Path) -> None:
    cell, desk = _cell(tmp_path)
    before = desk.settings()
    upload = desk.upload("boxes are lighter", payload=0.19)
    assert (upload.version, upload.on_trial, upload.payload) == (before.version + 1, True, 0.19)
    desk.confirm(upload)
    kinds = [event.kind for event in cell.log().events]
    assert kinds.index(EventKind.UPLOAD) < kinds.index(EventKind.CONFIRM)
    refused = UploadRequest("operator", "outdated", before.version, payload=0.2)
    with pytest.raises(ParameterError, match="expected version"):
        cell.ask(UPLOAD, refused, Upload)


def test_an_arm_of_which_nothing_is_recorded_needs_the_services(tmp_path: Path) -> None:
    known = KnownArm(KNOWN.arm, tmp_path / "arm.json")
    with pytest.raises(ParameterError, match="--headless: expected an arm with a record"):
        recover(CellOptions(noise=0.001), known=known, headless=True)
