"""MQTT for PUBLISH and SUBSCRIBE: `raw[].mqtt[tcp://HOST:PORT, CLIENT, TOPIC]`, as in 4diac FORTE.

`fbdk[].mqtt[...]` sends the values with their tags. A client of one name at one broker is shared by the blocks of the
device; its library connects, and again when the connection is lost, in a thread of its own. Messages go with the
quality of service 0, and none is kept for later.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

from paho.mqtt.client import CallbackAPIVersion, Client, MQTTErrorCode, MQTTMessageInfo, topic_matches_sub

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.settings import Connections, Peer
from iec61499.net.wire import Signature

KEEP_ALIVE: Final = 20
"""Longest silence on a connection, s, as in 4diac FORTE."""
RETRY: Final = 1
"""Time after which a broker is asked for again, s."""
UNSENT: Final = 1000
"""Most messages of a block that wait for a slow broker."""
CLIENTS: Final = 64
"""Most clients of a device."""
_BROKER: Final = re.compile(r"(tcp|ssl)://(\[[0-9a-fA-F:.]+\]|[\w.-]+)(?::([0-9]{1,5}))?/?")
_PORTS: Final = {"tcp": 1883, "ssl": 8883}


@dataclass(frozen=True, slots=True)
class Topic:
    """Where messages go: broker, the client's name there, topic."""

    broker: str
    client: str
    name: str

    @property
    def address(self) -> tuple[str, str, int]:
        """Scheme, host and port of the broker."""
        found = _BROKER.fullmatch(self.broker)
        assert found is not None
        return found[1], found[2].strip("[]"), int(found[3] or _PORTS[found[1]])


def parse_topic(text: str, kind: str) -> Topic:
    """Reads what stands in the brackets of `mqtt[...]`.

    Args:
        text: BROKER, CLIENT, TOPIC.
        kind: PUBLISH or SUBSCRIBE.

    Raises:
        CommunicationError: it has another form, or the block is no PUBLISH and no SUBSCRIBE.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3 or not all(parts):
        raise CommunicationError(f"mqtt[{text}]: expected tcp://HOST:PORT, CLIENT, TOPIC")
    found = _BROKER.fullmatch(parts[0])
    if found is None or int(found[3] or 1) > 65535:
        raise CommunicationError(f"mqtt[{parts[0]}, ...]: expected tcp://HOST:PORT or ssl://HOST:PORT")
    if kind not in ("PUBLISH", "SUBSCRIBE"):
        raise CommunicationError(f"mqtt[...] of a {kind}: expected a PUBLISH or a SUBSCRIBE", "TERMINATED")
    if kind == "PUBLISH" and any(sign in parts[2] for sign in "+#"):
        raise CommunicationError(f"topic {parts[2]!r}: expected one without + and # to publish to")
    return Topic(*parts)


class Mqtt:
    """Opens channels.

    Args:
        settings: how to log in to brokers.
    """

    def __init__(self, settings: Connections) -> None:
        self._settings = settings
        self._clients: dict[tuple[str, str], SharedClient] = {}

    def open(self, inlet: Inlet, parameters: str, sends: Signature, receives: Signature) -> MqttChannel:
        """Opens the channel of a block.

        Args:
            inlet: the way to the block.
            parameters: what stands in the brackets of `mqtt[...]`.
            sends: the message of a PUBLISH.
            receives: the message of a SUBSCRIBE.

        Raises:
            CommunicationError: the parameters have another form, or there are too many clients.
        """
        topic = parse_topic(parameters, inlet.port.kind)
        key = topic.broker, topic.client
        if key not in self._clients:
            if len(self._clients) >= CLIENTS:
                raise CommunicationError(f"{topic.broker}: expected at most {CLIENTS} clients")
            self._clients[key] = SharedClient(topic, self._settings.peer_at(topic.broker))
        return MqttChannel(self._clients[key], topic.name, inlet, sends, receives)

    def close(self) -> None:
        """Ends all clients."""
        for client in self._clients.values():
            client.disconnect()
        for client in self._clients.values():
            client.join()
        self._clients.clear()


class SharedClient:
    """A client at a broker, and the blocks that it serves.

    Raises:
        CommunicationError: a certificate cannot be read.
    """

    def __init__(self, topic: Topic, peer: Peer) -> None:
        self.broker = topic.broker
        self._readers: list[MqttChannel] = []
        self._client = Client(CallbackAPIVersion.VERSION2, topic.client, clean_session=True)
        self._client.reconnect_delay_set(RETRY, RETRY)
        self._client.on_connect = self._connected
        self._client.on_message = self._received
        if peer.username:
            self._client.username_pw_set(peer.username, peer.password or None)
        scheme, host, port = topic.address
        if scheme == "ssl":
            try:
                self._client.tls_set(peer.server_certificate or None, peer.certificate or None, peer.key or None)
            except (OSError, ValueError) as error:
                raise CommunicationError(f"{topic.broker}: certificates: {error}") from None
        self._client.connect_async(host, port, KEEP_ALIVE)
        self._client.loop_start()

    def add(self, channel: MqttChannel) -> None:
        """Tells a block what comes for its topic."""
        self._readers = [*self._readers, channel]
        if self._client.is_connected():
            self._client.subscribe(channel.topic)

    def remove(self, channel: MqttChannel) -> None:
        """Tells a block nothing more."""
        self._readers = [each for each in self._readers if each is not channel]
        if all(each.topic != channel.topic for each in self._readers) and self._client.is_connected():
            self._client.unsubscribe(channel.topic)

    def publish(self, topic: str, data: bytes) -> MQTTMessageInfo:
        """Sends a message. Raises CommunicationError when the broker is not connected."""
        sent = self._client.publish(topic, data)
        if sent.rc != MQTTErrorCode.MQTT_ERR_SUCCESS:
            raise CommunicationError(f"{self.broker} is not connected")
        return sent

    def disconnect(self) -> None:
        """Begins to end."""
        self._client.disconnect()

    def join(self) -> None:
        """Waits for the end."""
        self._client.loop_stop()

    def _connected(self, client: Client, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        if reason.is_failure:
            for channel in self._readers:
                channel.complain(f"{self.broker} refuses the connection: {reason}")
        else:
            for topic in {channel.topic for channel in self._readers}:
                client.subscribe(topic)

    def _received(self, client: Client, data: Any, message: Any) -> None:
        for channel in self._readers:
            if topic_matches_sub(channel.topic, message.topic):
                channel.receive(message.payload)


class MqttChannel:
    """The channel of a PUBLISH or a SUBSCRIBE. The block is confirmed at once, as in 4diac FORTE."""

    is_ready = True
    confirms = False

    def __init__(self, client: SharedClient, topic: str, inlet: Inlet, sends: Signature, receives: Signature) -> None:
        self.topic = topic
        self._client = client
        self._inlet = inlet
        self._sends = sends
        self._receives = receives
        self._unsent: deque[MQTTMessageInfo] = deque()
        if inlet.port.kind == "SUBSCRIBE":
            client.add(self)

    def send(self, values: tuple[Any, ...]) -> None:
        """Publishes. Raises CommunicationError when that cannot be: no broker, or too many messages wait for it."""
        while self._unsent and _is_over(self._unsent[0]):
            self._unsent.popleft()
        if len(self._unsent) >= UNSENT:
            raise CommunicationError(f"{UNSENT} messages wait for {self._client.broker}")
        self._unsent.append(self._client.publish(self.topic, self._sends.encode(values)))

    def receive(self, data: bytes) -> None:
        """Delivers a message; called by the library's thread."""
        try:
            values = self._receives.decode(data)
        except CommunicationError as error:
            self._inlet.refuse("RECV_FAILED", f"topic {self.topic}: {error}")
        else:
            self._inlet.deliver(values)

    def complain(self, reason: str) -> None:
        """Lets a SUBSCRIBE say that nothing will come."""
        self._inlet.refuse("RECV_FAILED", reason)

    def close(self) -> None:
        self._inlet.close()
        self._client.remove(self)


def _is_over(sent: MQTTMessageInfo) -> bool:
    """Whether a message waits no more: it was published, or was lost with its connection."""
    try:
        return bool(sent.is_published())
    except (RuntimeError, ValueError):
        return True
