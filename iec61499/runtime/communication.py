"""SERVER_n_m, CLIENT_n_m, PUBLISH_n and SUBSCRIBE_n: INIT, QI, QO and STATUS as in 4diac FORTE, over any transport.

A block that is initialised with QI = TRUE asks its resource's transport for a channel to ID and confirms with INITO.
REQ or RSP sends SD_1 ... when QI holds; values that arrive are put out at RD_1 ... with CNF or IND. STATUS says what
went wrong: INVALID_ID, TERMINATED, INHIBITED (QI is FALSE), NO_SOCKET (not initialised), SEND_FAILED.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

from iec61499 import model
from iec61499.errors import CommunicationError, FunctionBlockError
from iec61499.runtime.service_interface import ServiceBehaviour
from iec61499.standard.services import COMMUNICATION
from iec61499.types import ArrayType, DataType, ElementaryType, StructType

Values = Sequence[Any]
Send = Callable[[tuple[Any, ...]], None]

_REQUESTERS: Final = ("CLIENT", "PUBLISH", "PUBL")
_LOCAL: Final = {"PUBL": "PUBLISH", "SUBL": "SUBSCRIBE"}


class Channel(Protocol):
    """A port's way to its peers, which a transport opens.

    Attributes:
        is_ready: whether the channel is usable at once; if not, the transport calls `confirm_open` of the port later.
        confirms: whether the transport says when a PUBLISH has done what it sends; if not, it has done so at once.
    """

    is_ready: bool
    confirms: bool

    def send(self, values: tuple[Any, ...]) -> None:
        """Sends the values. Raises CommunicationError when that is impossible."""

    def close(self) -> None:
        """Ends the channel; nothing is delivered afterwards."""


class Transport(Protocol):
    """Carries values between ports: in process, over TCP, ..."""

    def open(self, port: CommunicationPort) -> Channel:
        """Opens a channel to `port.id`.

        The transport calls `port.confirm_open()` once the channel is usable, after this call has returned it, then
        `port.deliver` with what arrives, and `port.terminate()` when the channel has ended by itself. A channel that
        is usable at once says so by `is_ready`. For one that is not usable yet it calls
        `port.refuse_open()` once, and goes on trying.

        Raises:
            CommunicationError: the ID is invalid.
        """


class CommunicationPort:
    """The outer side of one communication block.

    Attributes:
        name: the block's dotted name.
        kind: SERVER, CLIENT, PUBLISH or SUBSCRIBE.
        sends: the types of SD_1, ...
        receives: the types of RD_1, ...
        id: the ID that the block was initialised with, "" before; an ID without a layer is completed to
            `fbdk[].ip[...]`, or to `loc[...]` for PUBL and SUBL.
    """

    def __init__(self, instance: Any, block: model.ServiceInterfaceFBType) -> None:
        match = COMMUNICATION.fullmatch(block.header.name)
        assert match is not None
        kind = match[1] or match[4]
        self.name: str = instance.name__
        self.kind = _LOCAL.get(kind, kind)
        self._default_layer = "loc[{}]" if kind in _LOCAL else "fbdk[].ip[{}]"
        self.sends = _types(block.interface.inputs, "SD_")
        self.receives = _types(block.interface.outputs, "RD_")
        self.id = ""
        self._instance = instance
        self._assign = _assigner(self.receives)
        self._answer = f"to__{'CNF' if kind in _REQUESTERS else 'IND'}"
        self._channel: Channel | None = None
        self._attached: Send | None = None

    @property
    def is_open(self) -> bool:
        """Whether the block has been initialised and not terminated."""
        return self._instance.send__ is not None

    @property
    def is_local(self) -> bool:
        """Whether the ID names a channel inside this process."""
        return self.id.startswith("loc[")

    def attach(self, send: Send) -> None:
        """Passes what the block sends to `send` in place of the transport, from the next initialisation on.

        A block that is open already changes over at once.
        """
        self._attached = send
        if self.is_open:
            self._close_channel()
            self._instance.send__ = send

    def deliver(self, values: Values) -> None:
        """Puts values out at RD_1, ... and queues CNF or IND; the resource then has to run.

        Raises:
            CommunicationError: the block is not open, or the number of values is wrong.
        """
        instance = self._instance
        if instance.send__ is None:
            raise CommunicationError(f"{self.name} is not initialised: expected INIT with QI = TRUE first")
        try:
            self._assign(instance, values)
        except ValueError:
            raise CommunicationError(f"{self.name} got {len(values)} values, expected {len(self.receives)}") from None
        instance.extend__(getattr(instance, self._answer))

    def confirm_open(self) -> None:
        """The channel is usable: INITO with QO = TRUE; nothing if it has been closed meanwhile."""
        if self._channel is not None:
            self._instance.send__ = self._channel.send
            self._report("OK", "to__INITO")

    def refuse_open(self, status: str = "INVALID_ID") -> None:
        """The channel is not usable yet: INITO with QO = FALSE, as for an invalid ID; nothing if it is closed."""
        if self._channel is not None:
            self._report(status, "to__INITO")

    def terminate(self) -> None:
        """The channel has ended by itself: the block says so, except a server, which goes on listening."""
        if self.kind != "SERVER":
            self._close_channel()
            self._instance.send__ = None
            self._report("TERMINATED", self._answer)

    def initialise(self) -> None:
        """What the event INIT does."""
        instance = self._instance
        if not instance.QI:
            self._close_channel()
            instance.send__ = None
            self._report("TERMINATED", "to__INITO")
        elif instance.send__ is not None:
            self._report("OK", "to__INITO")
        else:
            self._close_channel()
            self._open()

    def _open(self) -> None:
        instance = self._instance
        bare = instance.ID and "]" not in instance.ID
        self.id = self._default_layer.format(instance.ID) if bare else instance.ID
        if self._attached is not None:
            instance.send__ = self._attached
            self._report("OK", "to__INITO")
            return
        try:
            if not self.id:
                raise CommunicationError(f"{self.name}: ID is empty")
            self._channel = instance.resource__.transport.open(self)
        except CommunicationError as error:
            self._report(error.status or "INVALID_ID", "to__INITO")
            return
        if self._channel.is_ready:
            self.confirm_open()

    def confirm_sent(self) -> None:
        """What a block was asked for is done, or a publisher's values are on their way: CNF with QO = TRUE."""
        self._report("OK", self._answer)

    @property
    def confirms_at_once(self) -> bool:
        """Whether a publisher's values are on their way as soon as the channel has taken them."""
        return self._channel is None or not self._channel.confirms

    def refuse(self, status: str) -> None:
        """A request was not carried out: the answering event comes with QO = FALSE."""
        self._report(status, self._answer)

    def close(self) -> None:
        """Closes the channel without an event, as when the resource stops."""
        self._close_channel()
        self._instance.send__ = None

    def _close_channel(self) -> None:
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    def _report(self, status: str, targets: str) -> None:
        instance = self._instance
        instance.STATUS = status
        instance.QO = status == "OK"
        instance.extend__(getattr(instance, targets))


def _types(variables: Sequence[model.Variable], prefix: str) -> tuple[DataType, ...]:
    types = []
    for variable in variables:
        if variable.name.startswith(prefix):
            assert not isinstance(variable.type, model.GenericType)
            types.append(variable.type)
    return tuple(types)


def _assigner(types: Sequence[DataType]) -> Callable[[Any, Values], None]:
    """`assign(s, values)`: the values to RD_1, ..., QO and STATUS as after a good message."""
    names = [f"{'s.RD_' if isinstance(kind, ElementaryType) else 'new_'}{i}" for i, kind in enumerate(types, 1)]
    lines = [
        "def assign(s, values):",
        f"    {''.join(f'{name}, ' for name in names) or '()'} = values",
        *(
            f"    s.RD_{i} = kept(types[{i - 1}], new_{i}, s.RD_{i})"
            for i, kind in enumerate(types, 1)
            if not isinstance(kind, ElementaryType)
        ),
        "    s.QO = True",
        "    s.STATUS = 'OK'",
    ]
    space: dict[str, Any] = {"kept": _kept, "types": tuple(types)}
    exec(compile("\n".join(lines), "<communication>", "exec"), space)
    assign: Callable[[Any, Values], None] = space["assign"]
    return assign


def _kept(kind: DataType, new: Any, old: Any) -> Any:
    """A value that has arrived, with the old elements of an array that arrived shorter, as in 4diac FORTE."""
    if isinstance(kind, ArrayType):
        return [_kept(kind.element, one, was) for one, was in zip(new, old, strict=False)] + old[len(new) :]
    if isinstance(kind, StructType):
        return [_kept(member.type, one, was) for member, one, was in zip(kind.members, new, old, strict=True)]
    return new


def behaviour(block: model.ServiceInterfaceFBType) -> ServiceBehaviour | None:
    """The behaviour of a communication block; None for any other block."""
    match = COMMUNICATION.fullmatch(block.header.name)
    if match is None:
        return None
    kind = match[1] or match[4]
    request = "REQ" if kind in _REQUESTERS else "RSP"

    def prepare(instance: Any) -> None:
        instance.send__ = None
        instance.port__ = CommunicationPort(instance, block)

    handlers = {"INIT": _initialise, request: _sender(len(_types(block.interface.inputs, "SD_")), kind)}
    return ServiceBehaviour(handlers, wiring=("send__", "port__"), prepare=prepare)


def _initialise(s: Any) -> None:
    s.port__.initialise()


def _sender(count: int, kind: str) -> Callable[[Any], None]:
    """The handler of REQ or RSP; a publisher confirms what it has sent, a subscriber has nothing to send."""
    values = "".join(f"s.SD_{i}, " for i in range(1, count + 1))
    sending = [] if kind in ("SUBSCRIBE", "SUBL") else [f"            s.send__(({values}))"]
    confirming = ["            if s.port__.confirms_at_once:", "                s.port__.confirm_sent()"]
    confirming = confirming if kind in ("PUBLISH", "PUBL") else []
    lines = [
        "def send(s):",
        "    if s.QI and s.send__ is not None:",
        "        try:",
        *(sending + confirming or ["            pass"]),
        "        except CommunicationError as error:",
        "            s.port__.refuse(error.status or 'SEND_FAILED')",
        "    else:",
        "        s.port__.refuse('NO_SOCKET' if s.QI else 'INHIBITED')",
    ]
    space: dict[str, Any] = {"CommunicationError": CommunicationError}
    exec(compile("\n".join(lines), "<communication>", "exec"), space)
    send: Callable[[Any], None] = space["send"]
    return send


class AttachedServer:
    """A client's view of a SERVER block in the same process: one exchange a call, without a transport.

    Args:
        port: the SERVER block's port.
        run: runs the resource until it is idle.

    Raises:
        FunctionBlockError: the block is no server.
    """

    def __init__(self, port: CommunicationPort, run: Callable[[], None]) -> None:
        if port.kind != "SERVER":
            raise FunctionBlockError(f"{port.name} is a {port.kind}: expected a SERVER")
        self.receives = port.receives
        self.sends = port.sends
        self._name = port.name
        self._answers: list[tuple[Any, ...]] = []
        self._deliver = port.deliver
        self._run = run
        port.attach(self._answers.append)

    def exchange(self, values: Values) -> tuple[Any, ...]:
        """Delivers values at RD_1, ... with IND, runs the resource, and returns what RSP sent from SD_1, ...

        Raises:
            CommunicationError: the block is not initialised, the number of values is wrong, or RSP did not come
                exactly once.
            FunctionBlockError: an error inside a block.
        """
        answers = self._answers
        answers.clear()
        self._deliver(values)
        self._run()
        if len(answers) != 1:
            raise CommunicationError(f"{self._name} answered {len(answers)} times to one request: expected one RSP")
        return answers[0]


Deliver = Callable[[Values], None]
"""Takes the values that a peer has sent."""
_LISTENERS = {"CLIENT": "SERVER", "SERVER": "CLIENT", "PUBLISH": "SUBSCRIBE", "SUBSCRIBE": ""}


class LocalTransport:
    """Connects the ports opened with one ID: a client with its server, a publisher with every subscriber.

    Several resources may share one; what is delivered waits in the receiver's queue until its resource runs.
    """

    def __init__(self) -> None:
        self._ports: dict[tuple[str, str], dict[CommunicationPort, Deliver]] = {}

    def open(self, port: CommunicationPort, deliver: Deliver | None = None) -> LocalChannel:
        """Opens a channel; as `Transport.open`.

        Args:
            port: the port that opens it.
            deliver: takes what its peers send; without it `port.deliver` does, at once.

        Raises:
            CommunicationError: a server of that ID exists already.
        """
        ports = self._ports.setdefault((port.kind, port.id), {})
        if port.kind == "SERVER" and ports:
            raise CommunicationError(f"{port.name}: {port.id} is served by {next(iter(ports)).name}")
        ports[port] = deliver or port.deliver
        return LocalChannel(self, port)

    def peers(self, port: CommunicationPort) -> tuple[Deliver, ...]:
        """What takes the values for every open port that gets what `port` sends."""
        ports = self._ports.get((_LISTENERS[port.kind], port.id), {})
        return tuple(deliver for peer, deliver in ports.items() if peer.is_open)

    def forget(self, port: CommunicationPort) -> None:
        """Removes a port: its peers reach it no longer."""
        del self._ports[port.kind, port.id][port]


class LocalChannel:
    """One port's channel to its peers in process."""

    is_ready = True
    confirms = False

    def __init__(self, transport: LocalTransport, port: CommunicationPort) -> None:
        self._transport = transport
        self._port = port

    def send(self, values: tuple[Any, ...]) -> None:
        """Delivers to the peers.

        Raises:
            CommunicationError: a client has no server, or the peers' number of values differs.
        """
        peers = self._transport.peers(self._port)
        if not peers and self._port.kind == "CLIENT":
            raise CommunicationError(f"{self._port.name}: nothing serves {self._port.id}")
        for deliver in peers:
            deliver(values)

    def close(self) -> None:
        self._transport.forget(self._port)
