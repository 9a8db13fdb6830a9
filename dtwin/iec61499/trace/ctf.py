"""The Common Trace Format 1.8 (diamon.org/ctf), as far as traces of networks need it.

A trace is a folder with the text `metadata` and one stream of packets, `events`. Everything is little-endian and
byte-aligned. A kind of event belongs to one port, whose name it has (`PLANNER.REQ`); its fields are values at it.
babeltrace2 and other readers of the format show the folder as it is.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dtwin.errors import FunctionBlockError

Record = tuple[Any, ...]
"""The number of the kind of event, the time of the resource in ns, then the values of the fields."""

METADATA: Final = "metadata"
STREAM: Final = "events"
MAGIC: Final = 0xC1FC1FC1
TEXT: Final = "text_t"
LAYOUTS: Final = {
    "bool_t": ("integer { size = 8; align = 8; signed = false; }", "?"),
    "sint_t": ("integer { size = 8; align = 8; signed = true; }", "b"),
    "int_t": ("integer { size = 16; align = 8; signed = true; }", "h"),
    "dint_t": ("integer { size = 32; align = 8; signed = true; }", "i"),
    "lint_t": ("integer { size = 64; align = 8; signed = true; }", "q"),
    "usint_t": ("integer { size = 8; align = 8; signed = false; }", "B"),
    "uint_t": ("integer { size = 16; align = 8; signed = false; }", "H"),
    "udint_t": ("integer { size = 32; align = 8; signed = false; }", "I"),
    "ulint_t": ("integer { size = 64; align = 8; signed = false; }", "Q"),
    "real_t": ("floating_point { exp_dig = 8; mant_dig = 24; align = 8; }", "f"),
    "lreal_t": ("floating_point { exp_dig = 11; mant_dig = 53; align = 8; }", "d"),
    TEXT: ("string { encoding = UTF8; }", ""),
}
"""The declaration of every kind of field, and its code for `struct`."""
_HEAD: Final = struct.Struct("<IIQQQQQ")
"""Magic number, stream, first and last time, bits of content and of the packet, events left out."""
_PREFIX: Final = "<Hq"
_KIND: Final = re.compile(r'event \{ id = (\d+); name = "([^"]*)"; fields := struct \{([^}]*)\}; \};')
_FIELD: Final = re.compile(r"(\w+) _(\w+?)(?:\[(\d+)\])?;")
_VALUE: Final = re.compile(r'^\t(\w+) = "([^"]*)";$', re.M)


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a kind of event: its name, its kind (a key of LAYOUTS), and how many values it has."""

    name: str
    kind: str
    count: int = 1


@dataclass(frozen=True, slots=True)
class EventKind:
    """A kind of event and its fields."""

    number: int
    name: str
    fields: tuple[Field, ...]

    def encoder(self) -> Callable[..., bytes]:
        """A function that gives the bytes of a record, whose items are its arguments."""
        runs: list[tuple[str, list[str]]] = [(_PREFIX, ["v0", "v1"])]
        at = 2
        for field in self.fields:
            for _ in range(field.count):
                if field.kind == TEXT:
                    runs.append(("", [f"v{at}"]))
                else:
                    if not runs[-1][0]:
                        runs.append(("<", []))
                    runs[-1] = (runs[-1][0] + LAYOUTS[field.kind][1], [*runs[-1][1], f"v{at}"])
                at += 1
        space: dict[str, Any] = {"encode_text": _encode_text}
        if len(runs) == 1:
            return struct.Struct(runs[0][0]).pack
        terms = []
        for number, (layout, places) in enumerate(runs):
            if layout:
                space[f"pack{number}"] = struct.Struct(layout).pack
                terms.append(f"pack{number}({', '.join(places)})")
            else:
                terms.append(f"encode_text({places[0]})")
        arguments = ", ".join(f"v{number}" for number in range(at))
        encode: Callable[..., bytes] = eval(f"lambda {arguments}: {' + '.join(terms)}", space)
        return encode

    def decode(self, data: bytes, at: int, time: int) -> tuple[Record, int]:
        """The record whose fields begin at a place in the data, and the place behind it."""
        values: list[Any] = [self.number, time]
        for field in self.fields:
            for _ in range(field.count):
                if field.kind == TEXT:
                    end = data.index(b"\0", at)
                    values.append(_decode_text(data[at:end]))
                    at = end + 1
                else:
                    layout = "<" + LAYOUTS[field.kind][1]
                    values.append(struct.unpack_from(layout, data, at)[0])
                    at += struct.calcsize(layout)
        return tuple(values), at


def _encode_text(text: str) -> bytes:
    return text.replace("\\", "\\\\").replace("\0", "\\0").encode("utf-8", "surrogatepass") + b"\0"


def _decode_text(data: bytes) -> str:
    text = data.decode("utf-8", "surrogatepass")
    return re.sub(r"\\(.)", lambda found: "\0" if found[1] == "0" else found[1], text)


class TraceWriter:
    """Writes a trace; what does not fit into its size any more is left out and counted.

    Args:
        folder: the new folder of the trace.
        about: what the trace is of, by names that are identifiers.
        size: most bytes of the stream.

    Attributes:
        written: how many records were written.
        left_out: how many were not, since they did not fit.
        full: the time from which on records were left out, ns; None when none was.

    Raises:
        FunctionBlockError: the folder is there already or cannot be made.
    """

    def __init__(self, folder: Path, about: dict[str, str], size: int) -> None:
        try:
            folder.mkdir(parents=True)
            self._stream = (folder / STREAM).open("wb")
        except OSError as error:
            raise FunctionBlockError(f"cannot be a new trace: {error.strerror}", str(folder)) from None
        self.written = self.left_out = 0
        self.full: int | None = None
        self._folder = folder
        self._about = about
        self._room = size
        self._kinds: list[EventKind] = []
        self._encoders: list[Callable[..., bytes]] = []

    def kind(self, name: str, fields: tuple[Field, ...]) -> EventKind:
        """A kind of event of that name, the same for the same fields."""
        found = next((kind for kind in self._kinds if (kind.name, kind.fields) == (name, fields)), None)
        if found is None:
            found = EventKind(len(self._kinds), name, fields)
            self._kinds.append(found)
            self._encoders.append(found.encoder())
            (self._folder / METADATA).write_text(_metadata(self._kinds, self._about))
        return found

    def write(self, records: Sequence[Record]) -> None:
        """Writes records as one packet."""
        if not records:
            return
        encoders = self._encoders
        body = b"".join([encoders[record[0]](*record) for record in records])
        size = _HEAD.size + len(body)
        if size > self._room:
            self._room = 0
            self.full = records[0][1] if self.full is None else self.full
            self.left_out += len(records)
            return
        self._room -= size
        self.written += len(records)
        bits = 8 * size
        self._stream.write(_HEAD.pack(MAGIC, 0, records[0][1], records[-1][1], bits, bits, self.left_out))
        self._stream.write(body)
        self._stream.flush()

    def close(self) -> None:
        self._stream.close()


def _metadata(kinds: Sequence[EventKind], about: dict[str, str]) -> str:
    aliases = "\n".join(f"typealias {text} := {name};" for name, (text, _) in LAYOUTS.items())
    env = "".join(f'\t{name} = "{value}";\n' for name, value in about.items())
    events = "\n".join(
        f'event {{ id = {kind.number}; name = "{kind.name}"; fields := struct {{ '
        + " ".join(f"{f.kind} _{f.name}{f'[{f.count}]' * (f.count != 1)};" for f in kind.fields)
        + " }; };"
        for kind in kinds
    )
    return (
        "/* CTF 1.8 */\n"
        f"{aliases}\n"
        "trace { major = 1; minor = 8; byte_order = le; packet.header := struct { udint_t magic; udint_t stream_id; "
        "}; };\n"
        f"env {{\n{env}}};\n"
        "clock { name = resource; freq = 1000000000; };\n"
        "typealias integer { size = 64; align = 8; signed = false; map = clock.resource.value; } := time_t;\n"
        "stream { packet.context := struct { time_t timestamp_begin; time_t timestamp_end; ulint_t content_size; "
        "ulint_t packet_size; ulint_t events_discarded; }; event.header := struct { uint_t id; time_t timestamp; }; "
        "};\n"
        f"{events}\n"
    )


@dataclass(frozen=True, slots=True)
class Trace:
    """A trace that has been read.

    Attributes:
        about: what the trace is of.
        kinds: the kinds of events, by number.
        data: the packets.
        file: the stream's file, for errors.
    """

    about: dict[str, str]
    kinds: dict[int, EventKind]
    data: bytes
    file: str

    def records(self) -> Iterator[Record]:
        """The records in order.

        Raises:
            FunctionBlockError: the stream is no such stream, or ends in the middle of a packet.
        """
        at = 0
        try:
            while at < len(self.data):
                magic, _, _, _, bits, packet, _ = _HEAD.unpack_from(self.data, at)
                end = at + bits // 8
                if magic != MAGIC or end > len(self.data) or packet < bits:
                    raise ValueError
                place = at + _HEAD.size
                while place < end:
                    number, time = struct.unpack_from(_PREFIX, self.data, place)
                    record, place = self.kinds[number].decode(self.data, place + struct.calcsize(_PREFIX), time)
                    yield record
                at += packet // 8
        except (ValueError, KeyError, struct.error, UnicodeDecodeError):
            raise FunctionBlockError(f"is no stream of events at byte {at}", self.file) from None


def read_trace(folder: Path) -> Trace:
    """Reads a trace that `TraceWriter` has written.

    Raises:
        FunctionBlockError: the folder holds no such trace.
    """
    try:
        text = (folder / METADATA).read_text()
        data = (folder / STREAM).read_bytes()
    except (OSError, UnicodeDecodeError) as error:
        raise FunctionBlockError(f"holds no trace: {error}", str(folder)) from None
    kinds = {}
    for number, name, body in _KIND.findall(text):
        fields = tuple(Field(field, kind, int(count or 1)) for kind, field, count in _FIELD.findall(body))
        if any(field.kind not in LAYOUTS for field in fields):
            raise FunctionBlockError(f"event {name} has a field of an unknown kind", str(folder / METADATA))
        kinds[int(number)] = EventKind(int(number), name, fields)
    return Trace(dict(_VALUE.findall(text)), kinds, data, str(folder / STREAM))
