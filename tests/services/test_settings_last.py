"""Settings in force outlive the controller and the bridge: no sample is answered before the controller has them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

from dtwin.bus.messages import (
    EVENTS,
    LATCH,
    SENSORS,
    SETTINGS,
    STATUS,
    UPLOAD,
    LatchRequest,
    LatchState,
    SettingsInForce,
    SettingsRequest,
    Status,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.device import Outcome
from dtwin.controller.ports import LOAD, MODEL, OFFSETS, TUNING
from dtwin.controller.sequence import AMONG_BODIES, CALLS, STRAIGHT, SequenceSettings
from dtwin.controller.settings import Compensation, ControlSettings, usual_gains
from dtwin.errors import CommunicationError, RecordingError
from dtwin.parameters import JointVector
from dtwin.services import bridge
from dtwin.services.parts.answering import connection
from dtwin.services.parts.state_file import StateFile
from dtwin.services.service import Service
from dtwin.signals import ArmState, Event, EventKind, Sensors, Stop, Voltages
from iec61499.net.address import Address
from tests.services.test_stop_lasts import PATIENCE, watched
from tests.support.desk import Desk, busy_cell
from tests.support.ports import free_port
from tests.support.waiting import pause, until

TUNED = ControlSettings(
    3.0, usual_gains("computed_torque", kp=(260.0, 500.0, 300.0)), payload=0.22, encoder_offset=(0.0, 0.01, -0.02)
)


FIELDS = {TUNING: ("gains", "target_time"), MODEL: ("model",), LOAD: ("payload",), OFFSETS: ("encoder_offset",)}
"""what belongs to each group of inputs"""


@dataclass
class Device:
    """A controller in this process, which can die and come back with other settings.

    Attributes:
        settings: settings in force in its blocks.
        life: number of the device; connections of an earlier one are dead.
        answered: settings in force at every answer.
    sequence: sequence in force in its blocks.
    help: number of what it calls help for.
    fetched: sequence in force at every answer.
    """

    settings: ControlSettings = field(default_factory=ControlSettings)
    sequence: SequenceSettings = STRAIGHT
    help: int = 0
    life: int = 0
    answered: list[ControlSettings] = field(default_factory=list)
    fetched: list[SequenceSettings] = field(default_factory=list)

    def come_back(self, settings: ControlSettings) -> None:
        self.life, self.settings, self.sequence = self.life + 1, settings, STRAIGHT


class Loop:
    """A connection to the device, as the bridge has it; it is settings port and safe stop in one."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._life = device.life
        self.settings = self.safe_stop = self
        self.lost = False

    def _alive(self) -> Device:
        if self._life != self._device.life:
            self.lost = True
            raise CommunicationError("the device has gone")
        return self._device

    def close(self) -> None:
        self.lost = True

    def answer(self, sensors: Sensors) -> Voltages:
        device = self._alive()
        device.answered.append(device.settings)
        device.fetched.append(device.sequence)
        return Voltages(sensors.sequence, sensors.time, (1.0, 0.0, 0.0, 0.0), False)

    def outcome(self) -> Outcome:
        return Outcome((0.0, 0.0, 0.0), self._alive().help, "none")

    def restart(self, way: Sequence[Sensors], recent: Sequence[Sensors]) -> None:
        self._alive()
        assert recent

    def last_angles(self) -> JointVector | None:
        self._alive()
        return None

    def in_force(self) -> ControlSettings:
        return self._alive().settings

    def put_sequence(self, sequence: SequenceSettings) -> set[str]:
        device = self._alive()
        other = sequence.differing(device.sequence.inputs())
        device.sequence = sequence
        return other

    def put(self, group: tuple[str, ...], settings: ControlSettings) -> ControlSettings:
        device = self._alive()
        values = {name: getattr(settings, name) for name in FIELDS[group]}
        device.settings = replace(device.settings, **values)
        return device.settings

    def now(self) -> Stop:
        self._alive()
        return "none"

    def judge(self, state: ArmState, confidence: float) -> Stop:
        return self.now()


class Peer:
    """The emulator's place on the bus, and what the bridge says there."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.events: list[Event] = []
        self.status: list[Status] = []
        self._publish = bus.publisher(SENSORS, lossless=True)
        self.tick = 0
        bus.subscribe(EVENTS, Event, self.events.append)
        bus.subscribe(STATUS, Status, self.status.append, "bridge")
        bus.answer(LATCH, LatchRequest, None, lambda: LatchState(0.0, 0, "none"))

    def sample(self) -> None:
        self.tick += 1
        self._publish(Sensors(self.tick, 0.01 * self.tick, (0.0, 0.0, 0.0), 0.9, False, ""))

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Publishes a sample between two looks."""

        def sample() -> None:
            self.sample()
            pause()

        until(condition, what, PATIENCE, sample)


@contextmanager
def bridged(meet: str, state: StateFile, sequence: SequenceSettings = STRAIGHT) -> Iterator[None]:
    """A bridge that works on a thread of its own."""
    with Service("bridge", bridge.Options(meet=meet)) as service:
        thread = threading.Thread(target=bridge.Bridge(service, Address("127.0.0.1", 1), state, False, sequence).run)
        thread.start()
        try:
            yield
        finally:
            service.stopping = True
            thread.join(PATIENCE)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Device:
    device = Device()
    monkeypatch.setattr(connection, "ControlLoop", lambda address, patience: Loop(device))
    monkeypatch.setattr(connection, "PATIENCE", 0.0)
    return device


def test_no_sample_is_answered_with_other_settings(device: Device, tmp_path: Path) -> None:
    meet, file = f"tcp/127.0.0.1:{free_port()}", tmp_path / "settings"
    with Bus(open_peer(meet)) as bus:
        peer = Peer(bus)
        with bridged(meet, StateFile(file)):
            peer.until(lambda: device.answered, "samples are answered")
            bus.ask(SETTINGS, SettingsRequest(TUNED.gains, TUNED.target_time), SettingsInForce)
            bus.ask(SETTINGS, SettingsRequest(payload=TUNED.payload), SettingsInForce)
            bus.ask(SETTINGS, SettingsRequest(encoder_offset=TUNED.encoder_offset), SettingsInForce)
            with pytest.raises(CommunicationError, match="a payload or encoder offsets alone"):
                bus.ask(SETTINGS, SettingsRequest(payload=0.3, target_time=2.0), SettingsInForce)
            device.answered.clear()
            device.come_back(ControlSettings())
            peer.until(lambda: device.answered, "the device that came back answers")
            peer.until(lambda: any(e.kind == EventKind.RESTORED for e in peer.events), "the event says so")
        device.come_back(ControlSettings())
        with bridged(meet, StateFile(file)):
            before = len(device.answered)
            peer.until(lambda: len(device.answered) > before, "another bridge has samples answered")
        assert set(device.answered) == {TUNED}


def test_no_sample_is_answered_with_another_sequence(device: Device, tmp_path: Path) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as bus, bridged(meet, StateFile(tmp_path / "settings"), AMONG_BODIES):
        peer = Peer(bus)
        peer.until(lambda: device.answered, "samples are answered")
        device.come_back(ControlSettings())
        before = len(device.answered)
        peer.until(lambda: len(device.answered) > before, "the device that came back answers")
        peer.until(lambda: any(e.kind == EventKind.RESTORED for e in peer.events), "the event says so")
        assert "SEQUENCE.VIA" in next(e.text for e in peer.events if e.kind == EventKind.RESTORED)
        assert set(device.fetched) == {AMONG_BODIES}


def test_a_call_for_help_is_told_once_and_its_end_too(device: Device, tmp_path: Path) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as bus, bridged(meet, StateFile(tmp_path / "settings")):
        peer = Peer(bus)
        peer.until(lambda: len(device.answered) > 20, "samples are answered")
        device.help = 1
        peer.until(lambda: any(e.kind == EventKind.HELP for e in peer.events), "help is called for")
        before = len(device.answered)
        peer.until(lambda: len(device.answered) > before + 20, "samples are answered")
        device.help = 0
        peer.until(lambda: len([e for e in peer.events if e.kind == EventKind.HELP]) > 1, "help has come")
        assert [e.text for e in peer.events if e.kind == EventKind.HELP] == [CALLS[1], CALLS[0]]


def test_a_controller_that_cannot_have_the_settings_answers_nothing(device: Device, tmp_path: Path) -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as bus, bridged(meet, StateFile(tmp_path / "settings")):
        peer = Peer(bus)
        peer.until(lambda: device.answered, "samples are answered")
        device.come_back(ControlSettings(law="row_sum"))
        device.answered.clear()
        peer.until(lambda: any(e.kind == EventKind.TROUBLE for e in peer.events), "an event says why")
        (text,) = (event.text for event in peer.events if event.kind == EventKind.TROUBLE)
        assert "no sample is answered" in text
        assert "CONTROLLER.LAW" in text
        peer.until(lambda: peer.status and peer.status[-1].state == "waiting", "the status says so")
        assert "CONTROLLER.LAW" in peer.status[-1].last_error
        assert device.answered == []
        device.come_back(ControlSettings())
        peer.until(lambda: device.answered, "the right one answers")


def test_a_state_file_is_whole_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "settings"
    StateFile(path).keep(TUNED)
    assert StateFile(path).settings == replace(TUNED, payload_model="point")
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(RecordingError, match=f"{path}: expected settings in force"):
        StateFile(path)


def test_a_state_file_keeps_what_is_known_of_drives_and_encoders(tmp_path: Path) -> None:
    """Repetitions were lost, so that a bridge that came back took its own settings for those of another run."""
    compensation = Compensation(0.004, 0.2, 150.0, (20, 0, 50), (0.4, 1.0, 0.25))
    known = ControlSettings(law="cascade", compensation=compensation)
    StateFile(tmp_path / "settings.json").keep(known)
    kept = StateFile(tmp_path / "settings.json").settings
    assert kept is not None
    assert kept.compensation == known.compensation
    assert not kept.differing(known)


def test_settings_that_cannot_be_written_are_kept_in_memory_until_they_can(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "settings"
    state = StateFile(path)
    with pytest.raises(RecordingError, match="cannot be written"):
        state.keep(TUNED)
    assert (state.settings, state.saved) == (TUNED, False)
    path.parent.mkdir()
    state.save()
    assert state.saved
    saved = StateFile(path).settings
    assert saved is not None
    assert not saved.differing(TUNED)


def test_confirmed_settings_are_in_force_before_the_arm_moves(desk: Desk, tmp_path: Path) -> None:
    history = str(tmp_path / "history.jsonl")
    options = ("--law", "computed_torque", "--simulation", "--history", history, *busy_cell(tmp_path))
    desk.detach("--pace", "lockstep", "--seed", "2", *options)
    with watched(desk) as watch:
        bus = watch.bus
        version = bus.ask(UPLOAD, None, Upload).version
        request = UploadRequest("anna", "to try", version, gains=TUNED.gains, target_time=TUNED.target_time)
        assert bus.ask(UPLOAD, request, Upload).on_trial
        until(lambda: not bus.ask(UPLOAD, None, Upload).on_trial, "the trial ends", 120.0)
        assert bus.ask(UPLOAD, None, Upload).action == "confirm"
        for killed in (("controller",), ("controller", "bridge")):
            watch.demand("torque off")
            off = watch.catch_up()
            watch.kill(killed)
            until(lambda: watch.stop() == "torque off", "the bridge answers", PATIENCE)
            watch.goes_on(50)
            found = bus.ask(SETTINGS, None, SettingsInForce)
            assert (found.gains, found.target_time) == (TUNED.gains, TUNED.target_time)
            watch.assert_without_voltage(off, watch.tick)
            watch.release()
            watch.goes_on(100)
            assert bus.ask(SETTINGS, None, SettingsInForce) == found
    desk.run("down")
    assert list((desk.folder / "dtwin").glob("cell.settings*")) == []
