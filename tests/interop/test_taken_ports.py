"""A port of the application that another process has, on a FORTE and on the embedded runtime."""

from __future__ import annotations

import re
import socket
from contextlib import AbstractContextManager, closing
from pathlib import Path
from typing import Final

import pytest

from dtwin.controller.device import ControlLoop
from dtwin.controller.ports import ARM_MODEL, EMULATOR, VERDICT, Port
from dtwin.errors import CommunicationError
from iec61499.net.address import LOOPBACK, Address
from tests.support.devices import DeployedApplication, embedded
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.waiting import until

DEVICES: Final = ("embedded", pytest.param("forte", marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE)))


def device(kind: str, folder: Path) -> AbstractContextManager[Address]:
    return forte(folder) if kind == "forte" else embedded()


@pytest.mark.parametrize("port", [EMULATOR, ARM_MODEL, VERDICT], ids=lambda port: port.block)
@pytest.mark.parametrize("kind", DEVICES)
def test_the_message_names_block_and_port(kind: str, port: Port, tmp_path: Path) -> None:
    with device(kind, tmp_path) as management, socket.socket() as other:
        served = DeployedApplication(management)
        other.bind((LOOPBACK, served.ports[port.number]))
        other.listen()
        served.deploy()
        served.client.close()

        def used() -> str:
            try:
                with closing(ControlLoop(management)) as loop:
                    return loop.safe_stop.now()
            except CommunicationError as error:
                return str(error)

        found = re.escape(f"{port.block} does not listen: expected port {served.ports[port.number]} to be free")
        # A FORTE serves the next client of its management only when it has noticed that the last one has gone.
        until(lambda: re.search(found, used()), "it is said")
