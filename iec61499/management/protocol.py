"""Requests and responses of IEC 61499 device management, as 4diac IDE and 4diac FORTE write them.

A request goes to the device or to one of its resources; on the wire it is two STRINGs, the resource's name ("" for
the device) and `<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>`; the answer is one STRING,
`<Response ID="1" />` or `<Response ID="1" Reason="UNSUPPORTED_TYPE" />`. The order of the attributes matters:
FORTE reads by position.

A FORTE carries out only the last of several requests that it receives together. So a client sends one after the
other, unless the device says how many it takes, when asked by `<Request ID="1" Action="QUERY"><Window/></Request>`,
which a FORTE refuses as INVALID_OBJECT. Such a device also minds `After="1"` behind the action: the request is
carried out only if the one before it has that ID and was fulfilled, and refused as NOT_READY otherwise. A client that
has asked so is told in words why a request is refused, in `Detail="..."` behind the reason.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, get_args

from iec61499.errors import CommunicationError, FunctionBlockError, choices
from iec61499.files.xml import XmlElement, parse_xml
from iec61499.net.wire import Signature
from iec61499.types import STRING

RequestAction = Literal["CREATE", "DELETE", "START", "STOP", "KILL", "RESET", "READ", "WRITE", "QUERY"]
Reason = Literal[
    "BAD_PARAMS",
    "LOCAL_TERMINATION",
    "SYSTEM_TERMINATION",
    "NOT_READY",
    "UNSUPPORTED_CMD",
    "UNSUPPORTED_TYPE",
    "NO_SUCH_OBJECT",
    "INVALID_OBJECT",
    "INVALID_OPERATION",
    "INVALID_STATE",
    "OVERFLOW",
    "INVALID_DST",
]
"""Why a request was not fulfilled."""
_ACTIONS: Final[tuple[RequestAction, ...]] = get_args(RequestAction)
_REASONS: Final[tuple[Reason, ...]] = get_args(Reason)

REQUESTS: Final = Signature([STRING, STRING], string_limit=65535)
RESPONSES: Final = Signature([STRING], string_limit=65535)
REQUEST_LIMIT: Final = 19_000
"""Bytes of a message that a FORTE with its standard settings takes; a longer one hangs the connection."""
WINDOW: Final = 64
"""Most requests of one client that are under way at once."""
ANY: Final = "*"
EVENT: Final = "$e"
"""Source of a WRITE that triggers the event at its destination."""
EVENT_COUNT: Final = "$er"
"""Source of a WRITE that sets the count of the watched event at its destination to zero."""
_BARE: Final = re.compile(r"&(?!(?:amp|lt|gt|quot|apos|#\d{1,7}|#x[0-9a-fA-F]{1,6});)")
"""An ampersand that begins no escape, as 4diac IDE sends it in texts."""
_SIZE: Final = re.compile("[0-9]{1,5}")
_PLAIN: Final = re.compile(r"[\w.+*:\- ]*", re.ASCII)
"""What needs no escape, as nearly all texts."""
_UNFIT: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to write."""
_ESCAPES: Final = str.maketrans(
    {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&apos;"}  # the five FORTE resolves
)


class ManagementError(CommunicationError):
    """A device refused a request.

    Attributes:
        reason: the device's reason for the refusal.
    """

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class ManagedBlock:
    """`<FB Name Type>`: a block, or a resource when the device is asked; "*" stands for any in queries."""

    name: str
    type_name: str

    def xml(self) -> str:
        return f'<FB Name="{_escape(self.name)}" Type="{_escape(self.type_name)}" />'


@dataclass(frozen=True, slots=True)
class ManagedConnection:
    """`<Connection Source Destination>`: two ports; WRITE has a literal as source, READ "*" as destination.

    Attributes:
        force: whether a WRITE forces the port ("true") or takes that back ("false"); "" for a value that may change.
    """

    source: str
    destination: str
    force: str = ""

    def xml(self) -> str:
        force = f' force="{_escape(self.force)}"' if self.force else ""
        return f'<Connection Source="{_escape(self.source)}" Destination="{_escape(self.destination)}"{force} />'


@dataclass(frozen=True, slots=True)
class ManagedType:
    """`<FBType Name>`, `<AdapterType Name>` or `<DataType Name>`: a type, for CREATE with its Lua text."""

    name: str
    text: str = ""
    tag: str = "FBType"

    def xml(self) -> str:
        if not self.text:
            return f'<{self.tag} Name="{_escape(self.name)}" />'
        return f'<{self.tag} Name="{_escape(self.name)}">{_escape(self.text)}</{self.tag}>'


@dataclass(frozen=True, slots=True)
class Watch:
    """`<Watch Source>`: a port that is watched; without a source `<Watches/>`: all watched ports, for READ."""

    source: str = ""

    def xml(self) -> str:
        return f'<Watch Source="{_escape(self.source)}" Destination="*" />' if self.source else "<Watches/>"


@dataclass(frozen=True, slots=True)
class Watched:
    """What is watched at a port: a value, or how often an event has come."""

    value: str
    forced: bool = False
    is_event: bool = False

    def xml(self) -> str:
        if self.is_event:
            return f'<Data value="{self.value}" time="0"/>'
        return f'<Data value="{_escape(self.value)}" forced="{str(self.forced).lower()}"/>'


@dataclass(frozen=True, slots=True)
class Window:
    """`<Window/>`: how many requests may be under way at once, for QUERY."""

    def xml(self) -> str:
        return "<Window/>"


@dataclass(frozen=True, slots=True)
class Change:
    """`<Change/>`: requests to a resource that take effect all at once, between two events, or not at all.

    CREATE begins to gather them, START puts them in force, DELETE forgets them. A FORTE knows none of this.
    """

    def xml(self) -> str:
        return "<Change/>"


Subject = ManagedBlock | ManagedConnection | ManagedType | Watch | Window | Change
_TYPES: Final = ("FBType", "AdapterType", "DataType")


@dataclass(frozen=True, slots=True)
class Request:
    """What a device or resource is asked to do; without a subject the action concerns it as a whole.

    Attributes:
        after: the ID of the request before it, without which it shall not be carried out; "" if it stands alone.
    """

    id: str
    action: RequestAction
    subject: Subject | None = None
    after: str = ""

    def xml(self) -> str:
        after = f' After="{_escape(self.after)}"' if self.after else ""
        opening = f'<Request ID="{_escape(self.id)}" Action="{self.action}"{after}'
        return f"{opening}/>" if self.subject is None else f"{opening}>{self.subject.xml()}</Request>"

    def __str__(self) -> str:
        subject = self.subject
        if isinstance(subject, ManagedBlock):
            return f"{self.action} block {subject.name} of type {subject.type_name}"
        if isinstance(subject, ManagedConnection):
            arrow = {"READ": f"{subject.source}", "WRITE": f"{subject.source} to {subject.destination}"}
            return f"{self.action} {arrow.get(self.action, f'{subject.source} -> {subject.destination}')}"
        if isinstance(subject, Watch):
            return f"{self.action} watch {subject.source}".rstrip()
        if isinstance(subject, ManagedType):
            return f"{self.action} {subject.tag} {subject.name}"
        return self.action if subject is None else f"{self.action} {type(subject).__name__.lower()}"


@dataclass(frozen=True, slots=True)
class Response:
    """The answer to a request.

    Attributes:
        reason: None when the request was fulfilled.
        value: what READ has read.
        blocks: what a QUERY of blocks has found.
        connections: what a QUERY of connections has found.
        names: what a QUERY of types has found.
        watches: what is watched, by resource and `BLOCK.PORT`.
        interface: the `<InterfaceList>` of the type that a QUERY asks for, as XML.
        window: how many requests may be under way at once; None when the device does not say.
        detail: why a request was refused, in words.
    """

    id: str
    reason: Reason | None = None
    value: str | None = None
    blocks: tuple[ManagedBlock, ...] | None = None
    connections: tuple[ManagedConnection, ...] | None = None
    names: tuple[str, ...] | None = None
    watches: dict[str, dict[str, Watched]] | None = None
    interface: str = ""
    window: int | None = None
    detail: str = ""

    def xml(self) -> str:
        opening = f'<Response ID="{_escape(self.id)}"'
        if self.reason is not None:
            detail = f' Detail="{_escape(self.detail)}"' if self.detail else ""
            return f'{opening} Reason="{self.reason}"{detail} />'
        body = self._body()
        return f"{opening}>\n  {body}\n</Response>" if body else f"{opening} />"

    def _body(self) -> str:
        if self.value is not None:
            return ManagedConnection(ANY, self.value).xml()
        if self.blocks is not None:
            rows = (f'<FB name="{_escape(block.name)}" type="{_escape(block.type_name)}"/>' for block in self.blocks)
            return "<FBList>\n    " + "\n".join(rows) + "\n  </FBList>"
        if self.connections is not None:
            return (
                "<EndpointList>\n    "
                + "\n".join(connection.xml() for connection in self.connections)
                + "\n  </EndpointList>"
            )
        if self.names is not None:
            return "<NameList>\n    " + _escape(", ".join(self.names)) + "\n  </NameList>"
        if self.watches is not None:
            resources = (
                f'<Resource name="{_escape(name)}">{_ports(ports)}</Resource>'
                for name, ports in self.watches.items()
                if ports
            )
            return f"<Watches>\n    {''.join(resources)}\n  </Watches>"
        return self.interface if self.window is None else f'<Window Size="{self.window}"/>'


def parse_request(text: str) -> Request:
    """Reads a request.

    Raises:
        ManagementError: the text is no request; the reason is that of a FORTE: UNSUPPORTED_CMD for another element or
            action, INVALID_OBJECT for a subject that does not belong to the action.
    """
    try:
        root = parse_xml(_BARE.sub("&amp;", text).encode(errors="replace"), "request")
    except FunctionBlockError as error:
        raise ManagementError("INVALID_OBJECT", str(error)) from None
    action = root.get("Action")
    if root.tag != "Request" or action not in _ACTIONS:
        expected = f"<Request> with the Action {choices(_ACTIONS)}"
        raise ManagementError("UNSUPPORTED_CMD", f"expected {expected}, got <{root.tag}> with {action!r}")
    children = list(root.children())
    if len(children) > 1:
        raise ManagementError("INVALID_OBJECT", f"{action}: expected one element, got {len(children)}")
    subject = _read_subject(action, children[0]) if children else None
    if subject is None and action not in ("START", "STOP", "KILL", "RESET"):
        raise ManagementError("INVALID_OBJECT", f"{action}: expected an element inside")
    return Request(root.get("ID"), action, subject, root.get("After"))


def request_id(text: str) -> str:
    """The ID of a request that may be wrong otherwise, "" when there is none."""
    _, found, rest = text[:100].partition('ID="')
    return rest.partition('"')[0] if found and '"' in rest else ""


def parse_response(text: str) -> Response:
    """Reads a response.

    Raises:
        CommunicationError: the text is no response.
    """
    try:
        root = parse_xml(text.encode(), "response")
    except FunctionBlockError as error:
        raise CommunicationError(str(error)) from None
    if root.tag != "Response":
        raise CommunicationError(f"expected <Response>, got <{root.tag}>")
    reason = root.get("Reason") or None
    if reason is not None and reason not in _REASONS:
        raise CommunicationError(f"unknown Reason {reason!r}: expected {choices(_REASONS)}")
    value = blocks = connections = names = watches = window = None
    for child in root.children():
        if child.tag == "Connection":
            value = child.get("Destination")
        elif child.tag == "FBList":
            blocks = tuple(ManagedBlock(block.get("name"), block.get("type")) for block in child.children("FB"))
        elif child.tag == "EndpointList":
            found = child.children("Connection")
            connections = tuple(ManagedConnection(c.get("Source"), c.get("Destination")) for c in found)
        elif child.tag == "NameList":
            names = tuple(name.strip() for name in child.text.split(",") if name.strip())
        elif child.tag == "Watches":
            watches = {r.get("name"): dict(_watched(r)) for r in child.children("Resource")}
        elif child.tag == "Window":
            size = child.get("Size")
            window = int(size) if _SIZE.fullmatch(size) else None
    found_parts = (value, blocks, connections, names, watches)
    return Response(root.get("ID"), reason, *found_parts, window=window, detail=root.get("Detail"))


def _watched(resource: XmlElement) -> Iterator[tuple[str, Watched]]:
    for data in resource.descendants("Data"):
        port = data.parent
        watched = Watched(data.get("value"), data.get("forced") == "true", bool(data.get("time")))
        yield f"{port.parent.get('name')}.{port.get('name')}", watched


def _ports(watches: dict[str, Watched]) -> str:
    blocks: dict[str, list[str]] = {}
    for name, watched in watches.items():
        block, _, port = name.rpartition(".")
        blocks.setdefault(block, []).append(f'<Port name="{_escape(port)}">{watched.xml()}</Port>')
    return "".join(f'<FB name="{_escape(block)}">{"".join(ports)}</FB>' for block, ports in blocks.items())


def _read_subject(action: str, element: XmlElement) -> Subject:
    if element.tag == "FB":
        return ManagedBlock(element.get("Name"), element.get("Type"))
    if element.tag == "Connection":
        return ManagedConnection(element.get("Source"), element.get("Destination"), element.get("force"))
    if element.tag == "Watches" or (element.tag == "Watch" and element.get("Source")):
        return Watch(element.get("Source") if element.tag == "Watch" else "")
    if element.tag == "Window" and action == "QUERY":
        return Window()
    if element.tag == "Change" and action in ("CREATE", "START", "DELETE"):
        return Change()
    if element.tag in _TYPES:
        return ManagedType(element.get("Name"), element.text.strip(), element.tag)
    expected = choices(("<FB>", "<Connection>", "<Watch>", *(f"<{tag}>" for tag in _TYPES)))
    raise ManagementError("INVALID_OBJECT", f"expected {expected}, got <{element.tag}>")


def _escape(text: str) -> str:
    if _PLAIN.fullmatch(text):
        return text
    return _UNFIT.sub("\N{REPLACEMENT CHARACTER}", text.translate(_ESCAPES))
