"""Protocols whose libraries are extras of an installation: what a device opens by them, and what an ID needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iec61499.errors import CommunicationError, choices
from iec61499.net.address import parse_numeric_address
from iec61499.net.inlet import Inlet
from iec61499.net.layers import STACKS, Layer, parse_layers, require
from iec61499.net.opcua.identifiers import parse_action
from iec61499.net.settings import Connections
from iec61499.net.wire import RawSignature, Signature
from iec61499.runtime.communication import Channel
from iec61499.types import DataType

if TYPE_CHECKING:
    from iec61499.net.mqtt import Mqtt
    from iec61499.net.opcua.device import OpcUa


class Protocols:
    """What the blocks of one device share: an OPC UA server, connections to others, clients at brokers.

    Args:
        settings: where the own server listens, and how to log in elsewhere.
    """

    def __init__(self, settings: Connections | None = None) -> None:
        self._settings = settings or Connections()
        self._opcua: OpcUa | None = None
        self._mqtt: Mqtt | None = None

    def open(self, inlet: Inlet, layers: tuple[Layer, ...]) -> Channel:
        """Opens a channel whose lowest layer is `opc_ua` or `mqtt`.

        Raises:
            CommunicationError: the library is not installed, or the ID has another form.
        """
        lowest = layers[-1]
        require(lowest.name)
        if lowest.name == "opc_ua":
            return self._for_opcua().open(inlet, lowest.parameters)
        sends, receives = signatures(layers, inlet.port.kind, inlet.port.sends, inlet.port.receives)
        return self._for_mqtt().open(inlet, lowest.parameters, sends, receives)

    @property
    def opcua_port(self) -> int:
        """The port where the own OPC UA server listens; 0 before a block has needed it."""
        return self._opcua.port if self._opcua is not None else 0

    def close(self) -> None:
        """Ends all of it."""
        for each in (self._opcua, self._mqtt):
            if each is not None:
                each.close()
        self._opcua = self._mqtt = None

    def _for_opcua(self) -> OpcUa:
        from iec61499.net.opcua.device import OpcUa

        if self._opcua is None:
            self._opcua = OpcUa(self._settings)
        return self._opcua

    def _for_mqtt(self) -> Mqtt:
        from iec61499.net.mqtt import Mqtt

        if self._mqtt is None:
            self._mqtt = Mqtt(self._settings)
        return self._mqtt


def needs_library(layers: tuple[Layer, ...]) -> bool:
    """Whether the lowest layer is one of an extra."""
    return layers[-1].name in ("opc_ua", "mqtt")


def signatures(
    layers: tuple[Layer, ...], kind: str, sends: tuple[DataType, ...], receives: tuple[DataType, ...]
) -> tuple[Signature, Signature]:
    """The messages that a block sends and receives, as the upper layer writes them.

    Args:
        layers: `fbdk` or `raw`, and what carries it.
        kind: SERVER, CLIENT, PUBLISH or SUBSCRIBE.
        sends: the types of SD_1, ...
        receives: the types of RD_1, ...

    Raises:
        CommunicationError: the layers are other ones, or a type cannot be sent.
    """
    names = [layer.name for layer in layers]
    if len(names) != 2 or names[0] not in ("fbdk", "raw") or names[1] not in ("ip", "mqtt"):
        given = ".".join(f"{name}[...]" for name in names)
        raise CommunicationError(f"layers {given}: expected {choices(STACKS)}")
    if names[0] == "fbdk":
        return Signature(sends), Signature(receives)
    asked = sends if kind in ("CLIENT", "PUBLISH") else receives
    if len(asked) != 1:
        wanted = "SD" if kind in ("CLIENT", "PUBLISH") else "RD"
        raise CommunicationError(f"raw[] of a {kind}: expected one {wanted}, a STRING", "TERMINATED")
    return RawSignature(sends), RawSignature(receives)


def check_id(text: str, kind: str, sends: int, receives: int) -> None:
    """Looks whether a block can run here with an ID.

    Args:
        text: the ID.
        kind: SERVER, CLIENT, PUBLISH or SUBSCRIBE.
        sends: how many values it sends.
        receives: how many it receives.

    Raises:
        CommunicationError: it cannot; says why.
    """
    if "]" not in text:
        parse_numeric_address(text)
        return
    layers = parse_layers(text)
    names = tuple(layer.name for layer in layers)
    if names == ("loc",):
        return
    if names == ("opc_ua",):
        parse_action(layers[0].parameters, kind, sends, receives)
        require("opc_ua")
        return
    if names not in {(upper, lower) for upper in ("fbdk", "raw") for lower in ("ip", "mqtt")}:
        raise CommunicationError(f"layers {'.'.join(f'{name}[...]' for name in names)}: expected {choices(STACKS)}")
    if names[1] == "ip":
        parse_numeric_address(layers[1].parameters)
        return
    require("mqtt")
    from iec61499.net.mqtt import parse_topic

    parse_topic(layers[1].parameters, kind)
