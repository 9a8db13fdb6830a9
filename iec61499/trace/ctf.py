"""The Common Trace Format 1.8 (diamon.org/ctf), as far as traces of networks need it.

A trace is a folder with the text `metadata` and one stream of packets, the file `events-0`. While it is written there
may be more files, `events-1` and so on; the number of the first is not 0 when the trace has lost its beginning.
Everything is little-endian and byte-aligned. A kind of event belongs to one port, whose name it has (`PLANNER.REQ`);
its fields are values at it.
babeltrace2 and other readers of the format show the folder as it is.
"""

from __future__ import annotations

import re
import shutil
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from iec61499.errors import FunctionBlockError

Record = tuple[Any, ...]
"""The number of the kind of event, the time of the resource in ns, then the values of the fields."""

METADATA: Final = "metadata"
STREAM: Final = "events-"
FILES: Final = 8
"""Files into which a trace that is full is cut; the oldest gives way to the next."""
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
"""Magic number, stream, first and last time, bits of content and of the packet, number of the packet."""
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


def encoding(events: Sequence[tuple[EventKind, Sequence[str]]], space: dict[str, Any]) -> str:
    """A Python expression for the bytes of records, one after another.

    Args:
        events: for every record its kind, and an expression for every field; one for several values begins with `*`.
            The expression `time` is that of the resource, ns.
        space: gets the names that the expression needs.
    """
    terms: list[str] = []
    layout, values = "", list[str]()

    def end_run() -> None:
        nonlocal layout, values
        if values:
            name = f"pack{len(space)}"
            space[name] = struct.Struct("<" + layout).pack
            terms.append(f"{name}({', '.join(values)})")
        layout, values = "", []

    for kind, expressions in events:
        layout += _PREFIX.removeprefix("<")
        values += [str(kind.number), "time"]
        for field, expression in zip(kind.fields, expressions, strict=True):
            if field.kind == TEXT:
                end_run()
                terms.append(f"encode_text({expression})")
            else:
                layout += f"{field.count}{LAYOUTS[field.kind][1]}"
                values.append(expression)
    end_run()
    space["encode_text"] = encode_text
    return terms[0] if len(terms) == 1 else f"b''.join(({', '.join(terms)}))"


@lru_cache(maxsize=128)
def encode_text(text: str) -> bytes:
    """The bytes of a text; those of the last texts are kept, since texts come again."""
    return text.replace("\\", "\\\\").replace("\0", "\\0").encode("utf-8", "surrogatepass") + b"\0"


def _decode_text(data: bytes) -> str:
    text = data.decode("utf-8", "surrogatepass")
    return re.sub(r"\\(.)", lambda found: "\0" if found[1] == "0" else found[1], text)


class TraceWriter:
    """Writes a trace; when it has its size, the oldest events give way, an eighth of the trace at a time.

    Args:
        folder: the new folder of the trace.
        about: what the trace is of, by names that are identifiers.
        size: most bytes of the packets.

    Attributes:
        written: how many records were written.
        dropped: how many of them had to give way.
        begins: the time of the first record that is there, ns.

    Raises:
        FunctionBlockError: the folder is there already or cannot be made.
    """

    def __init__(self, folder: Path, about: dict[str, str], size: int) -> None:
        try:
            folder.mkdir(parents=True)
            self._stream = (folder / f"{STREAM}0").open("wb")
        except OSError as error:
            raise FunctionBlockError(f"cannot be a new trace: {error.strerror}", str(folder)) from None
        self.written = self.dropped = self.begins = 0
        self._folder = folder
        self._about = about
        self._file_size = size // FILES
        self._room = self._file_size
        self._packets = 0
        self._files = [_File(folder / f"{STREAM}0")]
        self._kinds: list[EventKind] = []
        self._is_described = False
        self._ends: list[Callable[[], None]] = []

    def end_with(self, flush: Callable[[], None]) -> None:
        """Lets something that holds records back write them before the trace is closed."""
        self._ends.append(flush)

    def kind(self, name: str, fields: tuple[Field, ...]) -> EventKind:
        """A kind of event of that name, the same for the same fields."""
        found = next((kind for kind in self._kinds if (kind.name, kind.fields) == (name, fields)), None)
        if found is None:
            found = EventKind(len(self._kinds), name, fields)
            self._kinds.append(found)
            self._is_described = False
        return found

    def write(self, records: bytes, count: int, first: int, last: int) -> None:
        """Writes a packet of records, the times of the first and last of which are given, ns."""
        self._describe()
        size = _HEAD.size + len(records)
        if size > self._room:
            self._begin_file()
        self._room -= size
        self.written += count
        if self._files[-1].records == 0:
            self._files[-1].begins = first
        self._files[-1].records += count
        bits = 8 * size
        self._stream.write(_HEAD.pack(MAGIC, 0, first, last, bits, bits, self._packets))
        self._stream.write(records)
        self._stream.flush()
        self._packets += 1

    def close(self) -> None:
        """Writes what is held back and joins the files to one.

        Readers put packets of several files in order by their times alone.
        """
        for flush in self._ends:
            flush()
        self._describe()
        self._stream.close()
        whole, *others = self._files
        with whole.path.open("ab") as stream:
            for file in others:
                with file.path.open("rb") as part:
                    shutil.copyfileobj(part, stream)
                file.path.unlink()

    def _describe(self) -> None:
        """Writes the metadata anew if there are kinds of events that it has not."""
        if not self._is_described:
            (self._folder / METADATA).write_text(_metadata(self._kinds, self._about))
            self._is_described = True

    def _begin_file(self) -> None:
        self._stream.close()
        number = int(self._files[-1].path.name.removeprefix(STREAM)) + 1
        self._files.append(_File(self._folder / f"{STREAM}{number}"))
        self._stream = self._files[-1].path.open("wb")
        self._room = self._file_size
        if len(self._files) > FILES:
            oldest = self._files.pop(0)
            oldest.path.unlink()
            self.dropped += oldest.records
            self.begins = self._files[0].begins


@dataclass(slots=True)
class _File:
    """A file of a trace: how many records are in it, and the time of the first, ns."""

    path: Path
    records: int = 0
    begins: int = 0


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
        "ulint_t packet_size; ulint_t packet_seq_num; }; event.header := struct { uint_t id; time_t timestamp; }; "
        "};\n"
        f"{events}\n"
    )


@dataclass(frozen=True, slots=True)
class Trace:
    """A trace that has been read.

    Attributes:
        about: what the trace is of.
        kinds: the kinds of events, by number.
        data: the packets, file by file.
        is_whole: whether it has the first packet.
    """

    about: dict[str, str]
    kinds: dict[int, EventKind]
    data: dict[Path, bytes]
    is_whole: bool

    def records(self) -> Iterator[Record]:
        """The records in order.

        Raises:
            FunctionBlockError: the stream is no such stream, or ends in the middle of a packet.
        """
        for file, data in self.data.items():
            yield from self._records(file, data)

    def _records(self, file: Path, data: bytes) -> Iterator[Record]:
        at = 0
        try:
            while at < len(data):
                magic, _, _, _, bits, packet, _ = _HEAD.unpack_from(data, at)
                end = at + bits // 8
                if magic != MAGIC or end > len(data) or packet < bits:
                    raise ValueError
                place = at + _HEAD.size
                while place < end:
                    number, time = struct.unpack_from(_PREFIX, data, place)
                    record, place = self.kinds[number].decode(data, place + struct.calcsize(_PREFIX), time)
                    yield record
                at += packet // 8
        except (ValueError, KeyError, struct.error, UnicodeDecodeError):
            raise FunctionBlockError(f"is no stream of events at byte {at}", str(file)) from None


def read_trace(folder: Path) -> Trace:
    """Reads a trace that `TraceWriter` has written.

    Raises:
        FunctionBlockError: the folder holds no such trace.
    """
    try:
        text = (folder / METADATA).read_text()
        numbers = sorted(int(file.name.removeprefix(STREAM)) for file in folder.glob(f"{STREAM}*"))
        data = {file: file.read_bytes() for file in (folder / f"{STREAM}{number}" for number in numbers)}
    except OSError as error:
        problem = f"holds no trace, as `dtwin fb trace` writes it: {error.strerror or error}"
        raise FunctionBlockError(problem, str(folder)) from None
    except ValueError as error:
        raise FunctionBlockError(f"holds no trace: {error}", str(folder)) from None
    kinds = {}
    for number, name, body in _KIND.findall(text):
        fields = tuple(Field(field, kind, int(count or 1)) for kind, field, count in _FIELD.findall(body))
        if any(field.kind not in LAYOUTS for field in fields):
            raise FunctionBlockError(f"event {name} has a field of an unknown kind", str(folder / METADATA))
        kinds[int(number)] = EventKind(int(number), name, fields)
    return Trace(dict(_VALUE.findall(text)), kinds, data, is_whole=numbers[:1] == [0])
