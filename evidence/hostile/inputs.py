"""Management requests and datagrams that are nearly right, drawn at random.

Most are requests as 4diac IDE sends them, with names, literals and actions drawn from those that exist and from those
that have made trouble somewhere; a part of them is then damaged byte by byte.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Final, get_args
from xml.sax.saxutils import quoteattr

from dtwin.errors import CommunicationError
from iec61499.management.protocol import ManagementError, RequestAction, parse_request
from iec61499.net.wire import Signature
from iec61499.types import BOOL, DINT, LREAL, STRING, WSTRING, ArrayType, DataType

TARGETS: Final = ("T", "U", "V")
"""Resources that requests may do anything with."""
DATAGRAMS: Final[tuple[tuple[DataType, ...], ...]] = (
    (STRING,),
    (WSTRING, STRING),
    (LREAL, DINT, BOOL),
    (ArrayType(LREAL, 0, 3),),
)
"""What the SUBSCRIBE blocks of a target receive."""
_BLOCKS: Final = ("A", "B", "C", "D", "START", "U0", "U1", "U2", "U3", "F0", "F1", "F2", "X.Y", "", "*", "A" * 300)
_TYPES: Final = (
    *("E_CTU", "E_CYCLE", "E_DELAY", "E_SPLIT", "E_MERGE", "E_SR", "E_TABLE", "E_TRAIN", "E_RESTART", "EMB_RES"),
    *("F_ADD", "F_CONCAT", "F_STRING_TO_INT", "F_STRING_TO_TIME", "F_STRING_TO_LREAL", "F_INT_TO_STRING", "F_MUX"),
    *("PUBL_1", "SUBL_1", "SERVER_1_1", "CLIENT_1_1", "SUBSCRIBE_1", "PUBLISH_1", "EVENT_COUNTER", "DIGITAL_TWIN"),
    *("COMPUTED_TORQUE_CONTROL_3", "PATH_PLANNER", "PICK_AND_PLACE"),
    *("E_SPLIT_254", "E_SPLIT_999", "SERVER_101", "NOPE", "", "*", "X::E_SR"),
)
_PORTS: Final = (
    *(
        "EI",
        "EO",
        "EO1",
        "EO2",
        "CU",
        "CUO",
        "CV",
        "PV",
        "Q",
        "DT",
        "START",
        "STOP",
        "COLD",
        "REQ",
        "CNF",
        "IN",
        "IN1",
    ),
    *("IN2", "OUT", "QI", "QO", "ID", "STATUS", "INIT", "INITO", "SD_1", "RD_1", "RSP", "IND", "K", "N", "$ECC", ""),
)
_LITERALS: Final = (
    *("0", "1", "-1", "65535", "65536", "TRUE", "FALSE", "16#FF", "2#102", "1e400", "1.5", "INT#5", "LREAL#nan"),
    *("9" * 5000, "-" + "9" * 400, "1_000", "T#1ms", "T#0s", "T#1ns", f"T#{'9' * 400}s", "T#-5s", "LTIME#1s", "$e"),
    *(
        "$er",
        "$E",
        "''",
        "'a & b'",
        "'$00$FF'",
        '"$D800"',
        '"$D83D$DE00"',
        "'" * 7,
        "[1, 2]",
        f"[{'9' * 5000}(T#1s)]",
    ),
    *("[4(T#1s)]", "[" * 900, "(" * 900, "x" * 20_000, "localhost:0", "loc[a]", "127.0.0.1:99999", "fbdk[].ip[a]"),
    *("\u20ac", "\u00e4\u00f6\u00fc", "\ud800".encode("utf-8", "surrogatepass").decode("latin-1"), "NaN", "*", ""),
)
_STATES: Final = ("START", "STOP", "KILL", "RESET")


class Inputs:
    """Draws requests and datagrams.

    Args:
        generator: the random numbers.
        share: part of the inputs that are damaged.
    """

    def __init__(self, generator: random.Random, share: float = 0.3) -> None:
        self._random = generator
        self._share = share
        self._signatures = [Signature(types) for types in DATAGRAMS]

    def request(self) -> tuple[bytes, bytes]:
        """The name of a resource and a request; never one that may concern other resources than TARGETS."""
        while True:
            resource, text = self._request()
            if not _concerns_others(resource, text):
                return resource, text

    def datagram(self) -> tuple[int, bytes]:
        """The number of a kind of DATAGRAMS and the datagram."""
        number = self._random.randrange(len(DATAGRAMS))
        values = [self._value(kind) for kind in DATAGRAMS[number]]
        try:
            data = self._signatures[number].encode(values)
        except CommunicationError:
            data = bytes((0x50, 0xFF))
        return number, self._maybe_damaged(data)

    def damaged(self, data: bytes) -> bytes:
        """The data with bytes changed, cut, doubled or put in."""
        rng = self._random
        broken = bytearray(data)
        for _ in range(rng.choice((1, 1, 2, 5))):
            at = rng.randrange(len(broken) + 1)
            end = min(len(broken), at + rng.choice((1, 2, 8, 64)))
            match rng.randrange(4):
                case 0:
                    broken[at:end] = rng.randbytes(end - at)
                case 1:
                    del broken[at:end]
                case 2:
                    broken[at:at] = broken[at:end] * rng.choice((1, 2, 50))
                case _:
                    broken[at:at] = rng.choice((b"&", b"<", b'"', b"\0", b"\xff", b"]]>", b"<!DOCTYPE a>", b"&#0;"))
        return bytes(broken[:60_000])

    def _maybe_damaged(self, data: bytes) -> bytes:
        return self.damaged(data) if self._random.random() < self._share else data

    def _request(self) -> tuple[bytes, bytes]:
        rng = self._random
        action = rng.choice(get_args(RequestAction))
        resource = rng.choice((*TARGETS, *TARGETS, *TARGETS, "", "NONE", "\u20ac", "T" * 300))
        if rng.random() < 0.05:
            subject = ""
            action = rng.choice(_STATES)
        else:
            subject = self._subject(action, resource)
        text = f'<Request ID="{rng.randrange(10**6)}" Action="{action}">{subject}</Request>'
        return resource.encode(), self._maybe_damaged(text.encode("utf-8", "surrogatepass"))

    def _subject(self, action: str, resource: str) -> str:
        rng = self._random
        if not resource:
            name = rng.choice((*TARGETS, "NONE"))
            return f'<FB Name="{name}" Type="{rng.choice(("EMB_RES", "EMB_RES", "NOPE"))}" />'
        match rng.randrange(8):
            case 0 | 1:
                return f"<FB Name={_attribute(rng.choice(_BLOCKS))} Type={_attribute(rng.choice(_TYPES))} />"
            case 2:
                return (
                    f"<Watch Source={_attribute(self._port())} Destination='*' />"
                    if rng.random() < 0.8
                    else "<Watches/>"
                )
            case 3:
                tag = rng.choice(("FBType", "AdapterType", "DataType"))
                return f"<{tag} Name={_attribute(rng.choice(_TYPES))}>{rng.choice(('', 'x', 'x' * 9000))}</{tag}>"
        source = rng.choice(_LITERALS) if action == "WRITE" else self._port()
        destination = "*" if action == "READ" else self._port()
        force = rng.choice(("", "", ' force="true"', ' force="false"', ' force="?"'))
        return f"<Connection Source={_attribute(source)} Destination={_attribute(destination)}{force} />"

    def _port(self) -> str:
        return f"{self._random.choice(_BLOCKS)}.{self._random.choice(_PORTS)}"

    def _value(self, kind: DataType) -> object:
        rng = self._random
        if isinstance(kind, ArrayType):
            return [self._value(kind.element) for _ in range(kind.length)]
        numbers: Sequence[float] = (0.0, -0.0, 1e308, float("nan"), float("-inf"), 5e-324, 2.0**63)
        match kind.kind:
            case "bool":
                return rng.random() < 0.5
            case "real":
                return rng.choice(numbers)
            case "string":
                return rng.choice(_LITERALS)[:16_000]
        return rng.choice((0, -1, 2**31 - 1, -(2**31)))


def _attribute(text: str) -> str:
    return quoteattr(text.replace("\0", ""))


def _concerns_others(resource: bytes, text: bytes) -> bool:
    """Whether the request is one to the device as a whole, or to a resource that is no target."""
    if resource:
        return False
    try:
        subject = parse_request(text.decode("utf-8", "replace")).subject
    except ManagementError:
        return False
    return subject is None or getattr(subject, "name", "") not in (*TARGETS, "NONE")
