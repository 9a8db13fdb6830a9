"""The layer raw[]: texts as they are, over UDP and TCP."""

from __future__ import annotations

import socket

import pytest

from iec61499.errors import CommunicationError
from iec61499.net.address import Address
from iec61499.net.wire import RawSignature
from iec61499.types import INT, STRING
from tests.support.iec61499.served_device import PATIENCE, ServedDevice, build, wait_for


def test_a_text_goes_without_tag_and_length(served: ServedDevice) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(PATIENCE)
        steps = f"""
        HEAR SUBSCRIBE_1 QI=1 ID="raw[].ip[127.0.0.1:0]"
        T STRING2STRING
        SAY PUBLISH_1 QI=1 ID="raw[].ip[127.0.0.1:{peer.getsockname()[1]}]"
        SERVE SERVER_1_1 QI=1 ID="raw[].ip[127.0.0.1:0]"
        U STRING2STRING
        START.COLD -> SAY.INIT
        SAY.INITO -> SERVE.INIT
        SERVE.INITO -> HEAR.INIT
        HEAR.IND -> T.REQ
        T.CNF -> SAY.REQ
        HEAR.RD_1 -> T.IN
        T.OUT -> SAY.SD_1
        SERVE.IND -> U.REQ
        U.CNF -> SERVE.RSP
        SERVE.RD_1 -> U.IN
        U.OUT -> SERVE.SD_1
        """
        with served.client() as client:
            build(client, "R", steps)
            client.start("R")
            wait_for(client, "R", "HEAR.QO", lambda value: value == "TRUE")
        heard, serves = (served.device.addresses()[name] for name in ("HEAR", "SERVE"))
        assert isinstance(heard, Address)
        assert isinstance(serves, Address)
        peer.sendto("Öl".encode(), heard)
        assert peer.recv(100) == "Öl".encode()
        with socket.create_connection(serves, PATIENCE) as stream:
            stream.sendall(b"GET /")
            assert stream.recv(100) == b"GET /"


def test_raw_carries_one_text_and_no_longer_one_than_others() -> None:
    with pytest.raises(CommunicationError, match=r"raw\[\] carries one STRING, not INT"):
        RawSignature([INT])
    with pytest.raises(CommunicationError, match="expected at most 16384"):
        RawSignature([STRING]).decode(b"x" * 16385)
    with pytest.raises(CommunicationError, match="is no STRING"):
        RawSignature([STRING]).encode(["\u20ac"])
