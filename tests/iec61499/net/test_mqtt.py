"""MQTT: texts and values by a broker that starts later, and once more."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from iec61499.errors import CommunicationError
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from tests.support.iec61499.served_device import ANY_PORT, PATIENCE, ServedDevice, build, wait_for
from tests.support.ports import free_port
from tests.support.waiting import until

pytest.importorskip("paho.mqtt.client", reason="the extra mqtt is not installed")
from paho.mqtt.client import MQTTMessageInfo
from paho.mqtt.enums import MQTTErrorCode

from iec61499.net.mqtt import UNSENT, MqttChannel
from iec61499.net.wire import Signature
from iec61499.types import BOOL

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")

NETWORK = """
SAY PUBLISH_1 QI=1 ID="raw[].mqtt[tcp://127.0.0.1:PORT, press, plant/said]"
TEXT STRING2STRING
HEAR SUBSCRIBE_1 QI=1 ID="raw[].mqtt[tcp://127.0.0.1:PORT, press, plant/+]"
HEARD STRING2STRING
SEND PUBLISH_2 QI=1 ID="fbdk[].mqtt[tcp://127.0.0.1:PORT, press, values]"
LEVEL LREAL2LREAL IN=2.5
OPEN BOOL2BOOL IN=TRUE
TAKE SUBSCRIBE_2 QI=1 ID="fbdk[].mqtt[tcp://127.0.0.1:PORT, crane, values]"
TAKEN LREAL2LREAL
OPENED BOOL2BOOL
START.COLD -> SAY.INIT
SAY.INITO -> HEAR.INIT
HEAR.INITO -> SEND.INIT
SEND.INITO -> TAKE.INIT
TEXT.CNF -> SAY.REQ
TEXT.OUT -> SAY.SD_1
HEAR.IND -> HEARD.REQ
HEAR.RD_1 -> HEARD.IN
LEVEL.CNF -> OPEN.REQ
OPEN.CNF -> SEND.REQ
LEVEL.OUT -> SEND.SD_1
OPEN.OUT -> SEND.SD_2
TAKE.IND -> TAKEN.REQ
TAKEN.CNF -> OPENED.REQ
TAKE.RD_1 -> TAKEN.IN
TAKE.RD_2 -> OPENED.IN
"""


@pytest.fixture
def device() -> Iterator[ServedDevice]:
    device = ServedDevice(Library([]), ANY_PORT)
    device.start()
    yield device
    device.stop()


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Callable[[int], subprocess.Popen[bytes]]]:
    """Starts Debian's broker for this machine alone."""
    if MOSQUITTO is None:
        pytest.skip("no mosquitto: the package mosquitto is not installed")
    running: list[subprocess.Popen[bytes]] = []

    def start(port: int) -> subprocess.Popen[bytes]:
        settings = tmp_path / "mosquitto.conf"
        settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
        process = subprocess.Popen([MOSQUITTO, "-c", str(settings)], stderr=subprocess.DEVNULL)
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()


def until_heard(client: ManagementClient, trigger: str, name: str, value: str) -> None:
    """Has something sent again and again until it has come: the broker may not serve yet, and keeps nothing."""

    def come() -> bool:
        client.trigger("R", trigger)
        return client.read("R", name) == value

    until(come, f"{name} is {value}", PATIENCE)


def test_texts_and_values_go_by_a_broker_as_soon_as_it_is_there(
    device: ServedDevice, broker: Callable[[int], subprocess.Popen[bytes]]
) -> None:
    port = free_port()
    with device.client() as client:
        build_with_spaces(client, NETWORK.replace("PORT", str(port)))
        client.start("R")
        wait_for(client, "R", "TAKE.QO", lambda value: value == "TRUE")
        client.write("R", "TEXT.IN", "'Öl'")
        client.trigger("R", "TEXT.REQ")
        wait_for(client, "R", "SAY.STATUS", lambda value: value == "SEND_FAILED")
        for text in ("first", "second"):
            running = broker(port)
            client.write("R", "TEXT.IN", f"'{text}'")
            until_heard(client, "TEXT.REQ", "HEARD.OUT", text)
            until_heard(client, "LEVEL.REQ", "OPENED.OUT", "TRUE")
            assert client.read("R", "TAKEN.OUT") == "2.5"
            running.terminate()
            running.wait(PATIENCE)
        running = broker(port)
        # a text is no message of the layer fbdk
        client.write("R", "SAY.ID", f"'raw[].mqtt[tcp://127.0.0.1:{port}, press, values]'")
        client.write("R", "SAY.QI", "FALSE")
        client.trigger("R", "SAY.INIT")
        client.write("R", "SAY.QI", "TRUE")
        client.trigger("R", "SAY.INIT")
        until_heard(client, "TEXT.REQ", "TAKE.STATUS", "RECV_FAILED")


def build_with_spaces(client: ManagementClient, steps: str) -> None:
    """As `build`, whose steps are split at spaces."""
    build(client, "R", steps.replace(", ", ","))


@pytest.mark.parametrize(
    ("text", "kind", "complaint"),
    [
        ("tcp://h:1883, c", "PUBLISH", "expected tcp://HOST:PORT, CLIENT, TOPIC"),
        ("h:1883, c, t", "PUBLISH", "expected tcp://HOST:PORT or ssl://HOST:PORT"),
        ("tcp://h:99999, c, t", "PUBLISH", "expected tcp://HOST:PORT or ssl://HOST:PORT"),
        ("tcp://h:1883, c, t", "CLIENT", "of a CLIENT: expected a PUBLISH or a SUBSCRIBE"),
        ("tcp://h:1883, c, t/#", "PUBLISH", "expected one without"),
    ],
)
def test_what_is_no_topic_is_told(text: str, kind: str, complaint: str) -> None:
    from iec61499.net.mqtt import parse_topic

    with pytest.raises(CommunicationError, match=complaint):
        parse_topic(text, kind)


def test_layers_that_mqtt_does_not_carry_are_refused(device: ServedDevice) -> None:
    steps = """
    TWO PUBLISH_2 QI=1 ID="raw[].mqtt[tcp://127.0.0.1:1,c,t]"
    NONE PUBLISH_1 QI=1 ID="mqtt[tcp://127.0.0.1:1,c,t]"
    NUMBER PUBLISH_1 QI=1 ID="raw[].mqtt[tcp://127.0.0.1:1,c,t]"
    A STRING2STRING
    B STRING2STRING
    C INT2INT
    START.COLD -> TWO.INIT
    TWO.INITO -> NONE.INIT
    NONE.INITO -> NUMBER.INIT
    A.OUT -> TWO.SD_1
    B.OUT -> TWO.SD_2
    A.OUT -> NONE.SD_1
    C.OUT -> NUMBER.SD_1
    """
    with device.client() as client:
        build(client, "R", steps)
        client.start("R")
        wait_for(client, "R", "NUMBER.STATUS", lambda value: value == "TERMINATED")
        statuses = [client.read("R", f"{name}.STATUS") for name in ("TWO", "NONE")]
        assert statuses == ["TERMINATED", "INVALID_ID"]


def test_a_message_that_was_lost_with_its_connection_keeps_no_other_one_waiting() -> None:
    sent: list[MQTTMessageInfo] = []

    class Lossy:
        """A client whose connection breaks after every message."""

        broker = "tcp://127.0.0.1:1883"

        def publish(self, topic: str, data: bytes) -> MQTTMessageInfo:
            for each in sent:
                each.rc = MQTTErrorCode.MQTT_ERR_CONN_LOST
            sent.append(MQTTMessageInfo(len(sent)))
            return sent[-1]

    inlet = SimpleNamespace(port=SimpleNamespace(kind="PUBLISH"))
    channel = MqttChannel(cast(Any, Lossy()), "plant/said", cast(Any, inlet), Signature([BOOL]), Signature([]))
    for _ in range(UNSENT + 2):
        channel.send((True,))
    assert len(sent) == UNSENT + 2
