"""The secured configuration with real sessions: who may join, read, write and ask."""

import json
import os
import re
import shutil
import signal
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from dtwin.bus.messages import (
    DECIDE,
    EVENTS,
    FAULT,
    IDENTIFICATION,
    IDENTIFY,
    LATCH,
    MONITORING,
    RELEASE,
    RESET,
    RESIDUALS,
    ROLL_BACK,
    SENSORS,
    SETTINGS,
    SIGNAL,
    STOP,
    UPLOAD,
    VOLTAGES,
    Done,
    FaultRequest,
    IdentificationSignal,
    LatchRequest,
    LatchState,
    ReleaseRequest,
    ResetRequest,
    SettingsInForce,
    SettingsRequest,
    SignalRequest,
    StopRequest,
    StopState,
)
from dtwin.bus.opening import open_configured
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import (
    IdentificationRequest,
    IdentificationState,
    MonitoringResiduals,
    MonitoringVerdict,
    Upload,
    UploadRequest,
)
from dtwin.controller.settings import usual_gains
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT, ArmParameters
from dtwin.services.runfile import join
from dtwin.signals import Event, Sensors, Voltages
from tests.support.bus import noting
from tests.support.desk import Desk
from tests.support.ports import free_port
from tests.support.secured import SECURED, certify
from tests.support.waiting import until

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the openssl command: install it")

SAMPLE = Sensors(0, 0.0, (0.0, 0.0, 0.0), 0.9, False, "")
COMMAND = Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)
IDLE = IdentificationState("idle")
QUIET = MonitoringResiduals(0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0, 1.0)


def variant(secured: Path, name: str, old: str, new: str) -> Path:
    """A client's configuration with something changed, which gives up when it cannot join."""
    text = (secured / f"{name}.json5").read_text()
    assert old in text
    file = secured / f"{name}-variant.json5"
    text = text.replace("exit_on_failure: false", "exit_on_failure: true").replace(
        "timeout_ms: -1", "timeout_ms: 1000"
    )
    file.write_text(text.replace(old, new))
    return file


class Probe:
    """Joins as somebody and remembers what it hears."""

    def __init__(self, folder: Path, name: str) -> None:
        self.bus = Bus(open_configured(folder, name))
        self.heard: list[object] = []

    def __enter__(self) -> "Probe":
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()

    def subscribe(self, topic: Topic, message: type) -> "Probe":
        self.bus.subscribe(topic, message, self.heard.append)
        return self


def test_every_client_file_is_the_same_but_for_the_name() -> None:
    names = {file.stem for file in SECURED.glob("*.json5")} - {"router"}
    texts = {
        (SECURED / f"{name}.json5").read_text().replace(f'"{name}"', "NAME").replace(f"/{name}.", "/NAME.")
        for name in names
    }
    assert len(names) == 14
    assert len(texts) == 1


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("connect_certificate:", "// "),
        ("certificates/bridge", "other/bridge"),
        ("certificates/ca.pem", "other/ca.pem"),
        ("tls/localhost", "tls/127.0.0.2"),
    ],
    ids=["no certificate", "certificate of another authority", "trusts another authority", "another host's name"],
)
def test_whoever_has_no_valid_certificate_cannot_join(secured: Path, old: str, new: str) -> None:
    open_configured(variant(secured, "bridge", "", ""), "bridge").close()
    with pytest.raises(CommunicationError):
        open_configured(variant(secured, "bridge", old, new), "bridge").close()


@pytest.mark.parametrize(
    ("who", "topic", "message", "allowed"),
    [
        ("bridge", VOLTAGES, COMMAND, True),
        ("operator", VOLTAGES, COMMAND, False),
        ("emulator", VOLTAGES, COMMAND, False),
        ("emulator", SENSORS, SAMPLE, True),
        ("recorder", SENSORS, SAMPLE, False),
        ("identification", IDENTIFICATION, IDLE, True),
        ("simulation", IDENTIFICATION, IDLE, False),
        ("monitoring", RESIDUALS, QUIET, True),
        ("identification", RESIDUALS, QUIET, False),
    ],
)
def test_who_may_publish(secured: Path, who: str, topic: Topic, message: Any, allowed: bool) -> None:
    with Probe(secured, "controller").subscribe(topic, type(message)) as listener, Probe(secured, who) as publisher:
        publish = publisher.bus.publisher(topic)
        if allowed:

            def passes() -> bool:
                publish(message)
                return bool(listener.heard)

            until(passes, "the message passes")
        else:
            listener.subscribe(EVENTS, Event)
            report, said = publisher.bus.publisher(EVENTS), Event(0.0, who, "")

            def follows() -> bool:
                """What it may publish comes after what it may not, on the same way: then nothing is on its way."""
                publish(message)
                report(said)
                return said in listener.heard

            until(follows, "the event passes")
            assert message not in listener.heard


def test_a_certificate_without_a_role_reads_nothing(secured: Path) -> None:
    file = variant(secured, "recorder", "certificates/recorder", "certificates/stranger")
    with Probe(secured, "emulator") as emulator, Probe(file, "").subscribe(SENSORS, Sensors) as stranger:
        with Probe(secured, "recorder").subscribe(SENSORS, Sensors) as recorder:
            publish = emulator.bus.publisher(SENSORS)

            def hears() -> bool:
                publish(SAMPLE)
                return bool(recorder.heard)

            until(hears, "the recorder hears")
        assert not stranger.heard


def test_the_monitor_may_stop_the_arm_and_only_operators_release_it(secured: Path) -> None:
    applied: list[object] = []
    stop, release = StopRequest("probe", "test"), ReleaseRequest("probe", "test")
    with Probe(secured, "bridge") as bridge:
        bridge.bus.answer(STOP, StopRequest, noting(applied, StopState(0.0, "braking")))
        bridge.bus.answer(RELEASE, ReleaseRequest, noting(applied, StopState(0.0, "none")))
        for name in ("monitoring", "operator"):
            with Probe(secured, name) as other:
                assert other.bus.ask(STOP, stop, StopState).stop == "braking"
        with Probe(secured, "operator") as operator:
            assert operator.bus.ask(RELEASE, release, StopState).stop == "none"
        for name in ("monitoring", "simulation"):
            with Probe(secured, name) as other, pytest.raises(CommunicationError, match="may this session ask"):
                other.bus.ask(RELEASE, release, StopState, 0.5)
        for name in ("recorder", "emulator", "simulation"):
            with Probe(secured, name) as other, pytest.raises(CommunicationError, match="may this session ask"):
                other.bus.ask(STOP, stop, StopState, 0.5)
    assert applied == [stop, stop, release]


def test_only_operators_may_inject_faults(secured: Path) -> None:
    fault = FaultRequest(("slip@1",))
    with Probe(secured, "emulator") as emulator:
        emulator.bus.answer(FAULT, FaultRequest, lambda asked: Done(0.0, "done"))
        with Probe(secured, "operator") as operator:
            assert operator.bus.ask(FAULT, fault, Done).text == "done"
        for name in ("recorder", "monitoring", "simulation", "ai-act"):
            with Probe(secured, name) as other, pytest.raises(CommunicationError, match="may this session ask"):
                other.bus.ask(FAULT, fault, Done, 0.5)


def test_the_bridge_and_those_who_stop_tell_the_latch_of_a_stop(secured: Path) -> None:
    kept = LatchState(0.0, 1, "braking")
    with Probe(secured, "emulator") as emulator:
        emulator.bus.answer(LATCH, LatchRequest, lambda asked: kept)
        for name in ("bridge", "monitoring", "operator", "console", "ai-act"):
            with Probe(secured, name) as other:
                assert other.bus.ask(LATCH, LatchRequest("braking"), LatchState) == kept
        for name in ("recorder", "simulation", "ai-propose"):
            with Probe(secured, name) as other, pytest.raises(CommunicationError, match="may this session ask"):
                other.bus.ask(LATCH, LatchRequest("none", 1), LatchState, 0.5)


def rogue(secured: Path, certificate: str, **changes: object) -> zenoh.Config:
    """A router's configuration with somebody else's certificate, at a port of its own, without access control."""
    folder = secured / "certificates"
    settings = {
        "mode": "router",
        "listen": {"endpoints": []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport/link/tls": {
            "root_ca_certificate": str(folder / "ca.pem"),
            "enable_mtls": True,
            **{
                f"{side}_{what}": str(folder / f"{certificate}.{ending}")
                for side in ("listen", "connect")
                for what, ending in (("certificate", "pem"), ("private_key", "key"))
            },
        },
        **changes,
    }
    configuration = zenoh.Config()
    for key, value in settings.items():
        configuration.insert_json5(key, json.dumps(value))
    return configuration


@pytest.mark.parametrize("certificate", ["recorder", "bridge", "operator"])
def test_nobody_joins_a_router_that_shows_a_services_certificate(secured: Path, certificate: str) -> None:
    port = free_port()
    with zenoh.open(rogue(secured, certificate, listen={"endpoints": [f"tls/127.0.0.1:{port}"]})):
        text = (secured / "router.json5").read_text()
        (own,) = re.findall(r"tls/127.0.0.1:(\d+)", text)
        for name in ("operator", "emulator"):
            with pytest.raises(CommunicationError):
                open_configured(variant(secured, name, own, str(port)), name).close()


def test_the_routers_certificate_is_no_clients(secured: Path) -> None:
    with pytest.raises(CommunicationError):
        open_configured(variant(secured, "operator", "certificates/operator", "certificates/router"), "").close()


def test_a_router_that_joins_with_a_services_certificate_has_its_rights_alone(secured: Path) -> None:
    """Whatever a session calls itself, the certificate counts."""
    text = (secured / "router.json5").read_text()
    (port,) = re.findall(r"tls/127.0.0.1:(\d+)", text)
    connect = {"endpoints": [f"tls/localhost:{port}"], "exit_on_failure": True, "timeout_ms": 5000}
    acted: list[object] = []
    with (
        Probe(secured, "emulator") as emulator,
        Probe(secured, "operator") as operator,
        Bus(zenoh.open(rogue(secured, "recorder", connect=connect))) as joined,
    ):
        emulator.bus.answer(RESET, ResetRequest, noting(acted, Done(0.0, "done")), lambda: Done(0.0, "read"))
        until(lambda: operator.bus.ask(RESET, None, Done).text == "read", "the operator is answered")
        with pytest.raises(CommunicationError):
            joined.ask(RESET, ResetRequest(5), Done, 0.5)
    assert acted == []


def test_rights_and_certificates_are_those_of_one_cell(tmp_path: Path, secured: Path) -> None:
    script = ROOT / "scripts" / "secured-cell"
    subprocess.run([script, tmp_path / "blue", "blue", "left"], check=True, timeout=60)
    text = (tmp_path / "blue" / "router.json5").read_text()
    assert set(re.findall(r'"(dtwin/[^"]*?/[^"]*?)/', text)) == {"dtwin/blue/left"}
    certificates = tmp_path / "blue" / "certificates"
    assert not [file.name for file in certificates.iterdir() if file.name.startswith("ca.") and file.suffix != ".pem"]
    shutil.copytree(certificates, secured / "blue")
    with pytest.raises(CommunicationError):
        open_configured(variant(secured, "operator", "certificates/operator", "blue/operator"), "").close()
    assert (
        subprocess.run([script, tmp_path / "x", "a/b"], capture_output=True, timeout=60, check=False).returncode == 2
    )


def test_renewed_certificates_count_when_a_session_joins_again(secured: Path) -> None:
    """Nobody else needs to stop: the old ones hold as long as they last."""
    file = variant(secured, "recorder", "", "")
    certify(secured / "certificates", "recorder")
    open_configured(file, "").close()


def test_each_may_ask_the_controller_what_it_needs_and_no_more(secured: Path) -> None:
    """Settings pass the checks of the simulation service, whoever wants them."""
    in_force = SettingsInForce(usual_gains("computed_torque"), 2.0, ArmParameters(), "computed_torque", 0.2, "point")
    played = IdentificationSignal((6.0, 4.0, 3.0), 5, (0, 0, 0), 350)
    requests: dict[Topic, msgspec.Struct] = {
        SETTINGS: SettingsRequest(usual_gains("computed_torque", (1.0, 2.0, 3.0)), 2.0),
        SIGNAL: SignalRequest(True),
    }
    replies: dict[Topic, msgspec.Struct] = {SETTINGS: in_force, SIGNAL: played}
    may = {"simulation": {SETTINGS}, "identification": {SIGNAL}, "operator": {SIGNAL}, "monitoring": set()}
    with Probe(secured, "bridge") as bridge:
        for topic, reply in replies.items():
            bridge.bus.answer(topic, type(requests[topic]), noting([], reply), partial(noting([], reply), None))
        for name, allowed in may.items():
            with Probe(secured, name) as service:
                for topic, reply in replies.items():
                    for request in (requests[topic], None):
                        if topic in allowed:
                            assert service.bus.ask(topic, request, type(reply)) == reply
                        else:
                            with pytest.raises(CommunicationError, match="may this session ask"):
                                service.bus.ask(topic, request, type(reply), 0.5)


def test_operators_ask_the_twin_and_each_module_answers_for_itself(secured: Path) -> None:
    upload = Upload(
        1, 0.0, "start", "", False, usual_gains("computed_torque"), 2.0, "computed_torque", ArmParameters()
    )
    with Probe(secured, "simulation") as simulation, Probe(secured, "identification") as identification:
        for topic in (UPLOAD, ROLL_BACK):
            simulation.bus.answer(topic, UploadRequest, lambda asked: upload, lambda: upload)
        for topic in (IDENTIFY, DECIDE):
            identification.bus.answer(topic, IdentificationRequest, lambda asked: IDLE, lambda: IDLE)
        assert identification.bus.ask(UPLOAD, None, Upload) == upload
        with Probe(secured, "operator") as operator:
            for topic in (UPLOAD, ROLL_BACK):
                assert operator.bus.ask(topic, None, Upload) == upload
            for topic in (IDENTIFY, DECIDE):
                assert operator.bus.ask(topic, None, IdentificationState) == IDLE
        for name, topic in (("recorder", UPLOAD), ("identification", ROLL_BACK), ("monitoring", IDENTIFY)):
            with Probe(secured, name) as other, pytest.raises(CommunicationError, match="may this session ask"):
                other.bus.ask(topic, None, Upload, 0.5)
    with Probe(secured, "monitoring") as monitoring, Probe(secured, "operator") as operator:
        monitoring.bus.answer(UPLOAD, UploadRequest, lambda asked: upload)
        with pytest.raises(CommunicationError, match="nobody answered"):
            operator.bus.ask(UPLOAD, None, Upload, 1.0)


def test_a_secured_cell_uploads_identifies_and_monitors(
    secured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    desk = Desk(tmp_path)
    options = ["--zenoh", str(secured), "--pace", "lockstep", "--noise", "0.002", "--monitoring"]
    options += ["--simulation", "--history", str(tmp_path / "history.jsonl")]
    options += ["--identification", "--store", str(tmp_path / "store")]
    try:
        desk.detach(*options)
        with join("cell") as bus:
            verdicts: list[MonitoringVerdict] = []
            bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
            with desk.standing_still():
                said = json.loads(desk.run("upload", "gains", "--why", "to try", "--kp", "550", "540", "530"))
                assert (said["action"], said["on_trial"]) == ("upload", True)
                assert bus.ask(UPLOAD, None, Upload).gains.kp == (550.0, 540.0, 530.0)
                assert json.loads(desk.run("upload", "rollback", "--why", "enough"))["action"] == "roll back"
            said = json.loads(desk.run("identify", "live", "--accept", "--upload", "--json"))
            assert said["phase"] == "accepted"
            assert bus.ask(UPLOAD, None, Upload).model != ArmParameters()
            until(lambda: verdicts, "the monitor is heard")
            until(lambda: not bus.ask(UPLOAD, None, Upload).on_trial, "the trial is over")
            with desk.standing_still():
                an_ai_proposes_with_a_certificate_of_its_own(secured, desk, tmp_path)
        assert "is down" in desk.run("down")
    finally:
        for pid in desk.processes():
            os.kill(pid, signal.SIGKILL)


def an_ai_proposes_with_a_certificate_of_its_own(secured: Path, desk: Desk, folder: Path) -> None:
    """It has the cell's key, and the right to propose and no other; an operator carries out what was approved."""

    async def propose(client: Any) -> tuple[Any, Any]:
        version = (await client.call_tool("settings", {})).structured_content["in_force"]["version"]
        slower = {"why": "slower is safer", "based_on": version, "target_time": 2.5}
        return await client.call_tool("status", {}), await client.call_tool("propose_settings", slower)

    mcp = pytest.importorskip("tests.support.ai", reason="needs the extra mcp: pip install 'dtwin[mcp]'")
    with join("cell", secured, "ai-observe") as looking:
        with mcp.serving(looking, mcp.place(folder / "look", "propose")) as served:
            status, refused = mcp.talk(served, propose)
        assert not status.is_error
        assert refused.is_error
    with join("cell", secured, "ai-propose") as proposing:
        with mcp.serving(proposing, mcp.place(folder / "propose", "propose")) as served:
            status, made = mcp.talk(served, propose)
        assert not made.is_error, made.content
        with pytest.raises(CommunicationError, match="may this session ask"):
            proposing.ask(UPLOAD, UploadRequest("ai", "itself", 1, target_time=9.0), Upload, 0.5)
    number = str(made.structured_content["number"])
    zenoh_file = str(secured / "operator.json5")
    assert "approved, carol, version" in desk.run(
        "mcp", "approve", number, "--yes", "--who", "carol", "--zenoh", zenoh_file
    )
