"""Where a device's own OPC UA server listens, and how it proves to peers who it is: a file of TOML.

```toml
[opcua]
listen = "127.0.0.1:4840"
certificate = "own.der"
key = "own.pem"
trusted = ["trusted"]

[[peer]]
endpoint = "opc.tcp://10.0.0.5:4840"
username = "press"
password = "..."
certificate = "own.der"
key = "own.pem"
server_certificate = "their.der"
```
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Final, Literal, TypeVar

import msgspec

from iec61499.errors import CommunicationError, ToolError
from iec61499.net.address import Address, parse_numeric_address

LISTEN: Final = "127.0.0.1:4840"
"""Where the own server listens unless it is told otherwise: the port of OPC UA, for this machine alone."""


class OwnServer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The device's own OPC UA server.

    Attributes:
        listen: HOST:PORT.
        certificate: file (DER or PEM); with it and the key only encrypted connections are taken.
        key: file of the private key (PEM or DER).
        trusted: folders of certificates; with one only clients that have one of them are taken.
    """

    listen: str = LISTEN
    certificate: str = ""
    key: str = ""
    trusted: tuple[str, ...] = ()

    @property
    def address(self) -> Address:
        """Raises CommunicationError for one that is none."""
        return parse_numeric_address(self.listen)


class Peer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A server or broker that asks who comes.

    Attributes:
        endpoint: what the IDs of the blocks call it: `opc.tcp://HOST:PORT`, `tcp://HOST:PORT` or `ssl://HOST:PORT`.
        username: name to log in by; "" for none.
        password: its password.
        certificate: file of the own certificate; encrypts the connection.
        key: file of its private key.
        server_certificate: file of the certificate that the server must have; of the authority, for a broker.
        mode: whether messages are signed alone, for OPC UA.
    """

    endpoint: str
    username: str = ""
    password: str = ""
    certificate: str = ""
    key: str = ""
    server_certificate: str = ""
    mode: Literal["Sign", "SignAndEncrypt"] = "SignAndEncrypt"


class Connections(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that a device needs to know for the protocols beyond sockets."""

    opcua: OwnServer = OwnServer()
    peer: tuple[Peer, ...] = ()

    def peer_at(self, endpoint: str) -> Peer:
        """How to reach an endpoint: as the settings say, or without any."""
        return next((peer for peer in self.peer if peer.endpoint == endpoint), Peer(endpoint))


def read_connections(file: Path) -> Connections:
    """Reads such a file; names of files in it are relative to it.

    Raises:
        ToolError: it cannot be read, or says what is not known.
    """
    try:
        text = file.read_text(encoding="utf-8")
        found = msgspec.convert(tomllib.loads(text), Connections)
        _ = found.opcua.address
    except OSError as error:
        raise ToolError(f"{file}: cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, msgspec.ValidationError, CommunicationError) as error:
        raise ToolError(f"{file}: {error}") from None
    own = _located(found.opcua, file.parent)
    if bool(own.certificate) != bool(own.key):
        raise ToolError(f"{file}: opcua: expected a certificate and its key, or none of both")
    if own.trusted and not own.certificate:
        raise ToolError(f"{file}: opcua: trusted needs a certificate and its key, with which clients are encrypted")
    for peer in found.peer:
        secured = peer.certificate, peer.key, peer.server_certificate
        if peer.endpoint.startswith("opc.tcp:") and any(secured) and not all(secured):
            wanted = "certificate, key and server_certificate"
            raise ToolError(f"{file}: peer {peer.endpoint}: expected {wanted}, or none of them")
    return Connections(own, tuple(_located(peer, file.parent) for peer in found.peer))


_Settings = TypeVar("_Settings", OwnServer, Peer)


def _located(settings: _Settings, folder: Path) -> _Settings:
    """The same with the files' names as seen from here. Raises ToolError for a file that is not there."""
    changed: dict[str, str | tuple[str, ...]] = {}
    for name in ("certificate", "key", "server_certificate", "trusted"):
        given = getattr(settings, name, "")
        if not given:
            continue
        paths = [folder / one for one in ((given,) if isinstance(given, str) else given)]
        for path in paths:
            if not path.exists():
                raise ToolError(f"{path}: no such file, which {name} names")
        changed[name] = str(paths[0]) if isinstance(given, str) else tuple(map(str, paths))
    return msgspec.structs.replace(settings, **changed)
