"""The ID `opc_ua[ACTION;ENDPOINT#;PATH,NODE;...]` of a communication block, as 4diac FORTE reads it.

Without an endpoint the action concerns the device's own server. PATH is a browse path, `/Objects/1:Folder/Name`: the
namespace of the first name is 0 unless it is given, that of the others 1. NODE is `NAMESPACE:i=NUMBER`, `s=TEXT` or
`b=BYTES`, of namespace 0 unless it is given. Each of both may be left out.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal, get_args

from iec61499.errors import CommunicationError, choices

ActionName = Literal[
    "READ",
    "WRITE",
    "CREATE_METHOD",
    "CALL_METHOD",
    "SUBSCRIBE",
    "CREATE_OBJECT",
    "CREATE_VARIABLE",
    "DELETE_OBJECT",
    "DELETE_VARIABLE",
]
ACTIONS: Final[tuple[ActionName, ...]] = get_args(ActionName)
LONGEST: Final = 4096
"""Most characters of an ID."""
_ENDPOINT: Final = re.compile(r"opc\.tcp://(\[[0-9a-fA-F:.]+\]|[\w.-]+)(:[0-9]{1,5})?(/[\w./-]*)?")
_NODE: Final = re.compile(r"(?:([0-9]{1,5}):)?\s*([isb])=(.+)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class NodeName:
    """`NAMESPACE:i=NUMBER`, `NAMESPACE:s=TEXT` or `NAMESPACE:b=BYTES`."""

    namespace: int
    kind: Literal["i", "s", "b"]
    identifier: int | str


@dataclass(frozen=True, slots=True)
class Place:
    """Where a node is.

    Attributes:
        path: namespace and name of each node from the root on; empty if only the node is named.
        node: the node's identifier; None if only the path is given.
    """

    path: tuple[tuple[int, str], ...]
    node: NodeName | None

    def __str__(self) -> str:
        if self.path:
            return "/" + "/".join(name if number < 2 else f"{number}:{name}" for number, name in self.path)
        assert self.node is not None
        return f"{self.node.namespace}:{self.node.kind}={self.node.identifier}"


@dataclass(frozen=True, slots=True)
class Action:
    """What a block does over OPC UA.

    Attributes:
        name: the action.
        endpoint: address of another server; "" for the device's own.
        places: the nodes that it concerns, in the order of the block's values.
    """

    name: ActionName
    endpoint: str
    places: tuple[Place, ...]


def parse_action(text: str, kind: str, sends: int, receives: int) -> Action:
    """Reads what stands in the brackets of `opc_ua[...]`.

    Args:
        text: ACTION;ENDPOINT#;PATH,NODE;...
        kind: SERVER, CLIENT, PUBLISH or SUBSCRIBE.
        sends: how many values the block sends.
        receives: how many it receives.

    Raises:
        CommunicationError: it has another form, or no block of this kind can do it; says what was expected.
    """
    if len(text) > LONGEST:
        raise CommunicationError(f"opc_ua[...] of {len(text)} characters: expected at most {LONGEST}")
    parts = [part.strip() for part in text.split(";")]
    if len(parts) < 2:
        hint = " as of 4diac 1.11; this is the form before it" if text.lstrip().startswith(("/", "opc.tcp:")) else ""
        raise CommunicationError(f"opc_ua[{text}]: expected ACTION;ENDPOINT#;PATH,NODE{hint}")
    name, *rest = parts
    if name not in ACTIONS:
        raise CommunicationError(f"opc_ua[{name};...]: expected {choices(ACTIONS)}")
    endpoint = ""
    if rest[0].endswith("#"):
        endpoint, rest = rest[0].removesuffix("#"), rest[1:]
        if not _ENDPOINT.fullmatch(endpoint):
            raise CommunicationError(f"opc_ua[{name};{endpoint}#;...]: expected opc.tcp://HOST:PORT")
    action = Action(name, endpoint, tuple(_place(part) for part in rest))
    _check(action, kind, sends, receives)
    return action


def _place(text: str) -> Place:
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > 2 or not any(parts):
        raise CommunicationError(f"OPC UA node {text!r}: expected PATH,NODE")
    path = _path(parts[0]) if parts[0] else ()
    return Place(path, _node(parts[1]) if parts[1:] else None)


def _path(text: str) -> tuple[tuple[int, str], ...]:
    names = text.removesuffix("/").split("/")
    if names[0] or len(names) < 2:
        raise CommunicationError(f"OPC UA path {text!r}: expected /Objects/NAME")
    found = []
    for place, name in enumerate(names[1:]):
        number, colon, inner = name.strip().partition(":")
        if not colon:
            number, inner = ("0" if place == 0 else "1"), number
        if not re.fullmatch("[0-9]{1,5}", number) or int(number) > 65535 or not inner or ":" in inner:
            raise CommunicationError(f"OPC UA path {text!r}: {name!r} is no NAME or NAMESPACE:NAME")
        found.append((int(number), inner.strip()))
    return tuple(found)


def _node(text: str) -> NodeName:
    found = _NODE.fullmatch(text)
    if found is None:
        raise CommunicationError(f"OPC UA node {text!r}: expected NAMESPACE:i=NUMBER, s=TEXT or b=BYTES")
    namespace, kind, identifier = int(found[1] or 0), found[2], found[3].strip()
    if namespace > 65535:
        raise CommunicationError(f"OPC UA node {text!r}: expected a namespace from 0 to 65535")
    if kind == "s":
        return NodeName(namespace, "s", identifier)
    if kind == "b":
        return NodeName(namespace, "b", identifier)
    identifier = identifier.removesuffix("/")
    if not re.fullmatch("[0-9]{1,10}", identifier) or int(identifier) >= 1 << 32:
        raise CommunicationError(f"OPC UA node {text!r}: expected a number from 0 to 4294967295 behind i=")
    return NodeName(namespace, "i", int(identifier))


_LOCAL: Final[dict[ActionName, tuple[str, str]]] = {
    "READ": ("SUBSCRIBE", "as many nodes as it has RD"),
    "WRITE": ("PUBLISH", "as many nodes as it has SD"),
    "CREATE_METHOD": ("SERVER", "one node"),
    "CREATE_OBJECT": ("PUBLISH", "the type and the path of the object, and no SD"),
    "CREATE_VARIABLE": ("PUBLISH", "the variable type, the data type and the path of the variable, and no SD"),
    "DELETE_OBJECT": ("PUBLISH", "one node, and no SD"),
    "DELETE_VARIABLE": ("PUBLISH", "one node, and no SD"),
}
"""The block that does something on the own server, and what it must have."""
_REMOTE: Final[dict[ActionName, tuple[str, str]]] = {
    "READ": ("CLIENT", "as many nodes as it has RD, and no SD"),
    "WRITE": ("CLIENT", "as many nodes as it has SD, and no RD"),
    "CALL_METHOD": ("CLIENT", "the path of one method"),
    "SUBSCRIBE": ("SUBSCRIBE", "as many nodes as it has RD"),
}
"""The same on another server."""


def _check(action: Action, kind: str, sends: int, receives: int) -> None:
    """Raises CommunicationError when a block of this kind cannot do it."""
    known, where = (_REMOTE, "with an endpoint") if action.endpoint else (_LOCAL, "without an endpoint")
    if action.name not in known:
        raise CommunicationError(f"opc_ua[{action.name};...] {where}: expected {choices(known)}")
    block, wanted = known[action.name]
    nodes = len(action.places)
    fits = {
        "READ": nodes == receives and not (action.endpoint and sends),
        "WRITE": nodes == sends and not (action.endpoint and receives),
        "SUBSCRIBE": nodes == receives,
        "CREATE_METHOD": nodes == 1 and bool(action.places[0].path),
        "CALL_METHOD": nodes == 1 and bool(action.places[0].path),
        "CREATE_OBJECT": nodes == 2 and not sends and bool(action.places[-1].path),
        "CREATE_VARIABLE": nodes == 3 and not sends and bool(action.places[-1].path),
        "DELETE_OBJECT": nodes == 1 and not sends,
        "DELETE_VARIABLE": nodes == 1 and not sends,
    }[action.name]
    if kind != block or not fits:
        counts = f"{kind} with {nodes} nodes, {sends} SD and {receives} RD"
        raise CommunicationError(f"opc_ua[{action.name};...] {where} of a {counts}: expected a {block} with {wanted}")
