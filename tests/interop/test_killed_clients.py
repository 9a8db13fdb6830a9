"""Clients that are killed in the middle of an upload, as processes, on a FORTE and on the embedded runtime."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from dtwin.controller.device import ControlLoop
from dtwin.controller.ports import MODEL, TUNING
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters, Gains, scaled
from dtwin.signals import Sensors
from iec61499.net.address import Address
from iec61499.net.wire import Signature
from iec61499.types import LREAL
from tests.support.devices import DeployedApplication, embedded
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.waiting import connected

CLIENT = """
import signal, socket, struct, sys
port, abort, message = int(sys.argv[1]), sys.argv[2] == "abort", bytes.fromhex(sys.argv[3])
try:
    link = socket.create_connection(("127.0.0.1", port))
    if abort:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    link.sendall(message)
except OSError:
    pass  # a FORTE serves one client only
print("sent", flush=True)
signal.pause()
"""
"""Sends what it is told to and waits to be killed; its connection then ends with FIN, or with RST."""

NEW = ControlSettings(2.5, Gains((250.0, 510.0, 350.0), (80.0, 210.0, 160.0), (2.1, 2.2, 2.3)))
OTHER = ControlSettings(model=scaled(ArmParameters(), "D", 1.1))
SAMPLES = 20


class LoopedDevice:
    """A device with the application, and the bridge's end of it."""

    def __init__(self, management: Address) -> None:
        self._management = management
        served = DeployedApplication(management)
        served.deploy()
        served.client.close()  # a FORTE has one management client at a time
        self._ports = served.ports
        self._sequence = 0
        self.join()

    def join(self) -> None:
        self._loop = connected(lambda: ControlLoop(self._management))

    def leave(self) -> None:
        self._loop.close()

    def settings(self) -> ControlSettings:
        """The settings in force, after the device has answered some samples."""
        for _ in range(SAMPLES):
            sensors = Sensors(self._sequence, 0.01 * self._sequence, (-1.0, 0.1, 0.2), 0.9, False, "")
            assert self._loop.answer(sensors).sequence == self._sequence
            self._sequence += 1
        return self._loop.settings.in_force()

    def set(self, names: tuple[str, ...], settings: ControlSettings) -> None:
        self._loop.settings.put(names, settings)
        assert not settings.differing(self.settings())

    def kill_a_client(self, names: tuple[str, ...], message: bytes, end: str) -> None:
        """Lets a process send the message and kills it."""
        port = str(self._ports[61504 if names == TUNING else 61505])
        command = [sys.executable, "-S", "-E", "-c", CLIENT, port, end, message.hex()]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        with process.stdout:
            assert process.stdout.readline() == "sent\n"
            process.send_signal(signal.SIGKILL)
            assert process.wait() == -signal.SIGKILL


@pytest.fixture(
    scope="module",
    params=["embedded", pytest.param("forte", marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE))],
)
def device(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LoopedDevice]:
    """A device that every test leaves with the usual settings in force."""
    with forte(tmp_path_factory.mktemp("forte")) if request.param == "forte" else embedded() as address:
        device = LoopedDevice(address)
        yield device
        device.leave()


@pytest.mark.parametrize("end", ["close", "abort"])
@pytest.mark.parametrize(("names", "new"), [(TUNING, NEW), (MODEL, OTHER)], ids=["tuning", "model"])
def test_settings_are_the_old_or_the_new_ones(
    device: LoopedDevice, names: tuple[str, ...], new: ControlSettings, end: str
) -> None:
    """The message is cut anywhere from its start to its end, also within a value, or ends in rubbish."""
    old = ControlSettings()
    whole = Signature([LREAL] * len(names)).encode([new.inputs()[name] for name in names])
    half = whole[: len(whole) // 2]
    in_a_value = whole[: len(half) + 4]
    messages = {"nothing": b"", "half": half, "in a value": in_a_value, "malformed": half + b"\x41", "whole": whole}
    for cut, message in messages.items():
        device.kill_a_client(names, message, end)  # beside the bridge
        found = [device.settings()]
        device.leave()
        device.kill_a_client(names, message, end)  # before the bridge
        device.join()
        found.append(device.settings())
        for settings in found:
            assert not old.differing(settings) or (cut == "whole" and not new.differing(settings)), cut
        # the bridge's next message has to be taken from its beginning
        device.set(names, new)
        device.set(names, old)
