"""The emulator as a process, with the test in the bridge's place: safety, requests, hostile messages, kills."""

import math
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dtwin.bus.codec import encode
from dtwin.bus.messages import (
    EVENTS,
    FAULT,
    LATCH,
    RESET,
    SENSORS,
    STATUS,
    TICKS,
    TOGETHER,
    TOPICS,
    TRUTH,
    VOLTAGES,
    Done,
    FaultRequest,
    LatchRequest,
    LatchState,
    PassedTicks,
    ResetRequest,
    Status,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.parameters import HANGING, ROOT, GripperParameters
from dtwin.services.emulator import ASKED_TO_END
from dtwin.signals import Event, Sensors, Truth, Voltages
from tests.support.disks import full_disk
from tests.support.ports import free_port
from tests.support.waiting import until


class Emulator:
    """An emulator's process and a bus that answers it when told to."""

    def __init__(self, *options: str) -> None:
        self.meet = f"tcp/127.0.0.1:{free_port()}"
        self.bus = Bus(open_peer(self.meet))
        self.samples: list[Sensors] = []
        self.truths: list[Truth] = []
        self.events: list[Event] = []
        self.status: Status | None = None
        self.errors: set[str] = set()
        self.answering = False
        self.volts = (0.0, 0.0, 0.0, 3.0)
        self.copies = 1
        self._publish = self.bus.publisher(VOLTAGES)
        self.bus.subscribe(SENSORS, Sensors, self._on_sample)
        self.bus.subscribe(TRUTH, Truth, self.truths.append)
        self.bus.subscribe(EVENTS, Event, self.events.append)
        self.bus.subscribe(STATUS, Status, self._note)
        self._options = options
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-m", "dtwin.services.emulator", "--meet", self.meet, *self._options]
        self.process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()
        self.bus.close()

    def command(self, sequence: int) -> None:
        self._publish(Voltages(sequence, 0.01 * sequence, self.volts, False))

    def kinds(self) -> Counter[str]:
        return Counter(event.kind for event in self.events)

    def tick(self) -> int:
        return self.samples[-1].sequence if self.samples else -1

    def _on_sample(self, sample: Sensors) -> None:
        self.samples.append(sample)
        if self.answering:
            for _ in range(self.copies):
                self.command(sample.sequence)

    def _note(self, status: Status) -> None:
        self.status = status
        self.errors.add(status.last_error)


@pytest.fixture
def realtime() -> Iterator[Emulator]:
    emulator = Emulator()
    yield emulator
    emulator.close()


@pytest.fixture
def lockstep() -> Iterator[Emulator]:
    emulator = Emulator("--pace", "lockstep")
    yield emulator
    emulator.close()


@pytest.fixture
def patient() -> Iterator[Emulator]:
    """In real time, and obeying a last command for longer than a starved test may take to answer."""
    emulator = Emulator("--stale", "2")
    yield emulator
    emulator.close()


def test_an_arm_without_commands_is_made_safe_and_comes_back(patient: Emulator) -> None:
    until(lambda: len(patient.samples) > 2, "a sample is repeated")
    assert {sample.sequence for sample in patient.samples} == {0}, "no time passes before the first command"
    patient.answering = True
    until(lambda: patient.tick() > 20, "the cell runs")
    assert patient.kinds()["safe"] == 0
    patient.answering = False
    until(lambda: patient.kinds()["safe"] == 1, "the arm is made safe")
    at = patient.tick()
    until(lambda: patient.tick() > at + 10, "time goes on without commands")
    patient.answering = True
    until(lambda: patient.kinds()["resumed"] == 1, "the arm obeys again")
    safe, resumed = (next(e.time for e in patient.events if e.kind == kind) for kind in ("safe", "resumed"))
    assert resumed - safe > 0.09


def test_every_tick_that_has_passed_is_told_with_what_acted(lockstep: Emulator) -> None:
    told: list[PassedTicks] = []
    lockstep.bus.subscribe(TICKS, PassedTicks, told.append)
    lockstep.answering = True
    until(lambda: len(told) > 5, "ticks are told together")
    lockstep.answering = False
    ticks = [tick for message in told for tick in message.ticks]
    first = ticks[0].sensors.sequence
    assert [tick.sensors.sequence for tick in ticks] == list(range(first, first + len(ticks)))
    assert all(len(message.ticks) == TOGETHER for message in told[1:])
    samples = {sample.sequence: sample for sample in lockstep.samples}
    assert all(samples[tick.sensors.sequence] == tick.sensors for tick in ticks)
    assert {(tick.acted.volts, tick.acted.sequence == tick.sensors.sequence) for tick in ticks} == {
        (lockstep.volts, True)
    }


def test_safe_means_no_voltage(realtime: Emulator) -> None:
    """Without voltage the gripper's speed falls by exp(-D t / I); its stop is far enough for half a second."""
    realtime.volts = (0.0, 0.0, 0.0, -1.0)
    realtime.answering = True
    until(lambda: realtime.tick() > 5, "the cell runs")
    realtime.answering = False
    until(lambda: realtime.kinds()["safe"] > 0, "the arm is made safe")

    def safe_since() -> float:
        """The last time: an answer on its way when the test fell silent may have ended an earlier one."""
        return max(event.time for event in realtime.events if event.kind == "safe")

    until(lambda: realtime.truths[-1].time > safe_since() + 0.5, "half a second passes")
    since = safe_since()
    angles = [truth.gripper for truth in realtime.truths if since + 0.02 < truth.time <= since + 0.5]
    steps = np.diff(angles)
    gripper = GripperParameters()
    np.testing.assert_allclose(steps[1:] / steps[:-1], math.exp(-0.01 * gripper.damping / gripper.inertia), rtol=1e-6)


def test_a_second_publisher_is_noticed(realtime: Emulator) -> None:
    realtime.answering, realtime.copies = True, 2
    until(lambda: realtime.kinds()["rivals"] >= 1, "the second publisher is noticed")
    until(lambda: bool(realtime.status and realtime.status.refused.get("duplicate", 0) > 50), "and counted")
    assert realtime.kinds()["rivals"] == 1, "and told once"


def test_commands_out_of_order_are_refused_and_counted(lockstep: Emulator) -> None:
    lockstep.answering = True
    until(lambda: lockstep.tick() >= 50, "the cell runs")
    lockstep.answering = False
    lockstep.command(lockstep.tick() + 1000)
    lockstep.command(3)

    def counted() -> bool:
        refused = lockstep.status.refused if lockstep.status else {}
        return refused.get("from the future", 0) >= 1 and refused.get("out of sequence", 0) >= 1

    until(counted, "both are counted")


def test_faults_and_resets_are_requests(lockstep: Emulator) -> None:
    lockstep.answering = True
    until(lambda: lockstep.tick() >= 20, "the cell runs")
    done = lockstep.bus.ask(FAULT, FaultRequest(("K2*=0.5@0",)), Done)
    assert done.text.startswith("injected K2*=0.5@")
    until(lambda: lockstep.kinds()["fault"] == 1, "the fault begins")
    with pytest.raises(CommunicationError, match="unknown fault target 'K9'"):
        lockstep.bus.ask(FAULT, FaultRequest(("K9*=2@0",)), Done)
    lockstep.answering = False
    assert lockstep.bus.ask(RESET, ResetRequest(7), Done).text == "started anew with seed 7"
    until(lambda: lockstep.tick() == 0, "the cell starts anew")
    lockstep.answering = True
    lockstep.command(0)
    until(lambda: lockstep.tick() >= 20, "the cell runs again")
    assert lockstep.kinds()["fault"] == 1


def test_hostile_messages_on_every_key_do_no_harm(lockstep: Emulator) -> None:
    lockstep.answering = True
    until(lambda: lockstep.tick() >= 5, "the cell runs")
    session = lockstep.bus._session
    valid = encode(Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False))
    attacks = [
        b"",
        b"\x00\xff\xfe",
        b"null",
        b"[" * 60_000,
        valid.replace(b"0.0", b"1e999"),
        valid.replace(b"0.0", b"NaN"),
        valid.replace(b"[0.0", b"[9.0"),
        valid.replace(b'"sequence":0', b'"sequence":-1'),
        valid.replace(b'"sequence":0', b'"sequence":99999999999999999999'),
        b'{"schema":1,"faults":["' + b"x" * 900 + b'"]}',
        b"x" * 100_000,
        b"x" * 3_000_000,
    ]
    for topic in TOPICS:
        if topic.kind == "token":
            continue
        key = lockstep.bus.key(topic, "emulator")
        for attack in attacks:
            session.put(key, attack)
            if topic.kind == "query":
                list(session.get(key, payload=attack, timeout=0.5) if "emulator/" in key else ())
        session.delete(key)
    at = lockstep.tick()
    until(lambda: lockstep.tick() > at + 50, "the cell still runs")
    until(lambda: bool(lockstep.status and lockstep.status.refused.get("invalid", 0) >= 3), "refusals are counted")
    assert lockstep.process.poll() is None


def test_a_killed_emulator_goes_on_with_its_journal(tmp_path: Path) -> None:
    emulator = Emulator("--pace", "lockstep", "--journal", str(tmp_path / "journal"), "--noise", "0.01")
    try:
        emulator.volts = (1.0, 0.5, -0.5, 3.0)
        emulator.answering = True
        until(lambda: emulator.tick() >= 100, "the cell runs")
        emulator.answering = False
        emulator.process.kill()
        emulator.process.communicate()
        at, known = emulator.tick(), {sample.sequence: sample for sample in emulator.samples}
        emulator.samples.clear()
        emulator.start()
        until(lambda: emulator.samples, "it publishes again")
        again = emulator.samples[0]
        assert at - 1 <= again.sequence <= at + 1
        assert known.get(again.sequence, again) == again, "noise and motion go on where they were"
        emulator.answering = True
        emulator.command(again.sequence)
        until(lambda: emulator.tick() > at + 50, "the cell runs again")
    finally:
        emulator.close()


def test_an_emulator_on_a_full_disk_goes_on_and_takes_its_journal_up_again(tmp_path: Path) -> None:
    emulator = Emulator("--pace", "lockstep", "--journal", str(tmp_path / "journal"))
    try:
        emulator.answering = True
        until(lambda: emulator.tick() >= 50, "the cell runs", 60.0)
        with full_disk(1000, emulator.process.pid):
            at = emulator.tick()
            until(lambda: emulator.tick() >= at + 500, "it goes on without its journal", 60.0)
            # on a busy machine a later warning, of commands that come late, may take the place of this one
            until(lambda: any("journal" in text for text in emulator.errors), "its status tells", 60.0)
        until(lambda: emulator.kinds()["disk"] == 2, "it tells once that it cannot write and once that it can", 60.0)
        assert emulator.status is not None
        assert emulator.status.state == "running"
        emulator.answering = False
        emulator.process.kill()
        emulator.process.communicate()
        at = emulator.tick()
        emulator.samples.clear()
        emulator.start()
        until(lambda: emulator.samples, "it publishes again", 60.0)
        assert at - 1 <= emulator.samples[0].sequence <= at + 1
    finally:
        emulator.close()


def test_a_seed_out_of_range_is_refused_and_does_not_spoil_the_journal(tmp_path: Path) -> None:
    emulator = Emulator("--pace", "lockstep", "--journal", str(tmp_path / "journal"))
    try:
        emulator.answering = True
        until(lambda: emulator.tick() >= 20, "the cell runs")
        key = emulator.bus.key(RESET)
        for seed in (2**63, 2**64, 10**30, -1):
            replies = emulator.bus._session.get(key, payload=b'{"schema":1,"seed":%d}' % seed, timeout=10.0)
            (text,) = [reply.err.payload.to_bytes() for reply in replies if reply.err is not None]
            assert (b">= 0" if seed < 0 else b"<= 9223372036854775807") in text
        before = len(emulator.samples)
        assert emulator.bus.ask(RESET, ResetRequest(2**63 - 1), Done).text.endswith("9223372036854775807")
        until(lambda: any(sample.sequence == 0 for sample in emulator.samples[before:]), "the cell starts anew")
        emulator.command(emulator.tick())
        until(lambda: emulator.tick() >= 100, "the cell runs again")
        emulator.process.kill()
        emulator.process.communicate()
        emulator.samples.clear()
        emulator.start()
        until(lambda: emulator.tick() >= 100, "it goes on with its journal")
        assert [path.name for path in tmp_path.iterdir()] == ["journal"]
    finally:
        emulator.close()


def test_a_journal_that_cannot_be_read_is_set_aside_and_told(tmp_path: Path) -> None:
    (tmp_path / "journal").write_bytes(b"something else, and long enough to be one")
    emulator = Emulator("--pace", "lockstep", "--journal", str(tmp_path / "journal"))
    try:
        emulator.answering = True
        until(lambda: emulator.tick() >= 20, "the cell runs")
        until(lambda: emulator.kinds()["journal"] == 1, "an event tells")
        until(lambda: "unreadable-1" in (emulator.status.last_error if emulator.status else ""), "the status tells")
        assert (tmp_path / "journal.unreadable-1").read_bytes().startswith(b"something else")
    finally:
        emulator.close()


def test_a_cell_that_faults_tear_apart_starts_anew(tmp_path: Path) -> None:
    """A diverged cell tells so and hangs without torque until somebody releases the stop; its process lives."""
    emulator = Emulator("--pace", "lockstep", "--journal", str(tmp_path / "journal"))
    try:
        emulator.volts = (8.0, 8.0, 8.0, 0.0)
        emulator.answering = True
        until(lambda: emulator.tick() >= 20, "the cell runs")
        emulator.bus.ask(FAULT, FaultRequest(("K2*=1000@0",)), Done)
        until(lambda: emulator.kinds()["diverged"] == 1, "the cell diverges")
        until(lambda: any(b.sequence < a.sequence for a, b in pairwise(emulator.samples)), "it starts anew")
        at = emulator.tick()
        until(lambda: emulator.tick() >= at + 20, "ticks pass")
        assert emulator.samples[-1].theta == pytest.approx(HANGING, abs=1e-9)
        latch = emulator.bus.ask(LATCH, None, LatchState)
        assert latch.stop == "torque off"
        emulator.bus.ask(LATCH, LatchRequest("none", latch.number), LatchState)
        until(lambda: emulator.samples[-1].theta != pytest.approx(HANGING, abs=1e-3), "the arm obeys again")
        assert emulator.kinds()["diverged"] == 1, "the fault has gone with the arm that it tore apart"
        assert emulator.process.poll() is None
    finally:
        emulator.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signals_end_it_cleanly(lockstep: Emulator, number: signal.Signals) -> None:
    until(lambda: lockstep.samples, "it runs")
    lockstep.process.send_signal(number)
    _, said = lockstep.process.communicate(timeout=10)
    assert lockstep.process.returncode == ASKED_TO_END, "its run is not over"
    assert "Traceback" not in said


def test_bad_options_are_one_line() -> None:
    for options, expected in (
        (["--fault", "K9"], "K9"),
        (["--zenoh", "missing.json5"], "no Zenoh configuration"),
    ):
        command = [sys.executable, "-m", "dtwin.services.emulator", *options]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=30)
        assert done.returncode == 2
        assert expected in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
