"""Clients that are killed in the middle of an upload, as processes, on a FORTE and on the embedded runtime."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pytest
from served import FORTE, NO_FORTE, Served, embedded, forte, patiently

from dtwin.application import ControlLoop
from dtwin.control import MODEL, TUNING, ControlSettings
from dtwin.iec61499.address import Address
from dtwin.iec61499.types import LREAL
from dtwin.iec61499.wire import Signature
from dtwin.parameters import ArmParameters, Gains, scaled
from dtwin.signals import Sensors

CLIENT = """
import signal, socket, struct, sys
port, abort, message = int(sys.argv[1]), sys.argv[2] == "abort", bytes.fromhex(sys.argv[3])
link = socket.create_connection(("127.0.0.1", port))
if abort:
    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
link.sendall(message)
print("sent", flush=True)
signal.pause()
"""
"""Sends what it is told to and waits to be killed; its connection then ends with FIN, or with RST."""

NEW = ControlSettings(2.5, Gains((250.0, 510.0, 350.0), (80.0, 210.0, 160.0), (2.1, 2.2, 2.3)))
OTHER = scaled(ArmParameters(), "D", 1.1)
SAMPLES = 20


@dataclass
class Device:
    """A device with the application, the only one that the bridge's part of this test talks to."""

    loop: ControlLoop
    ports: dict[int, int]
    sequence: int = 0

    def settings(self) -> ControlSettings:
        """In force; the device answers samples, before and after."""
        self.answers()
        return self.loop.settings.in_force()

    def answers(self) -> None:
        for _ in range(SAMPLES):
            sensors = Sensors(self.sequence, 0.01 * self.sequence, (-1.0, 0.1, 0.2), 0.9, False, "")
            assert self.loop.answer(sensors).sequence == self.sequence
            self.sequence += 1


@pytest.fixture(params=["embedded", pytest.param("forte", marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE))])
def device(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Device]:
    with forte(tmp_path) if request.param == "forte" else embedded() as address:
        served = Served(address)
        served.deploy()
        served.client.close()  # a FORTE has one management client at a time
        with closing(patiently(lambda: ControlLoop(address))) as loop:
            yield Device(loop, served.ports)


def killed_client(address: Address, message: bytes, end: str) -> None:
    """A process that is killed when it has sent the message."""
    command = [sys.executable, "-S", "-E", "-c", CLIENT, str(address.port), end, message.hex()]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == "sent\n"
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL


@pytest.mark.parametrize("end", ["close", "abort"])
@pytest.mark.parametrize("kind", ["tuning", "model"])
def test_settings_are_the_old_or_the_new_ones(device: Device, kind: str, end: str) -> None:
    """Cut before the message, within it, within one of its values, after it; and half of it with rubbish behind."""
    names = TUNING if kind == "tuning" else MODEL
    address = Address("127.0.0.1", device.ports[61504 if kind == "tuning" else 61505])
    old, new = ControlSettings(), NEW if kind == "tuning" else ControlSettings(model=OTHER)
    whole = Signature([LREAL] * len(names)).encode([new.inputs()[name] for name in names])
    half = whole[: len(whole) // 2]
    broken = {
        "nothing": b"",
        "half": half,
        "half and a bit": half + whole[len(half) :][:4],
        "malformed": half + b"\x41",
    }
    for cut, message in broken.items():
        killed_client(address, message, end)
        assert not old.differing(device.settings()), cut
        # the next client comes from the bridge, and has to find the beginning of a message
        again(device, kind, new)
        again(device, kind, old)
    killed_client(address, whole, end)
    found = device.settings()
    assert not new.differing(found) or not old.differing(found), "of a whole message all or nothing counts"
    again(device, kind, new)
    again(device, kind, old)


def again(device: Device, kind: str, settings: ControlSettings) -> None:
    if kind == "tuning":
        device.loop.settings.set_tuning(settings.gains, settings.target_time)
    else:
        device.loop.settings.set_model(settings.model)
    assert not settings.differing(device.settings())
