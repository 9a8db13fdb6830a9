"""Files of JSON lines to which entries are only ever appended, each of them whole, checked and chained to the last.

A line is an entry as a JSON object whose last two fields are the number of the line and its hash: BLAKE2b (RFC 7693,
16 bytes) over the hash of the line before and over the line without its hash. So a line that was changed, and lines
that were taken out, are seen. Lines of earlier versions have neither; they are read, and the first numbered line is
chained to the last of them.

A write counts when all of it is on disk, otherwise nothing of it is in the file. What a killed process or a lost disk
left behind the last whole line is kept in a file of its own, and writing goes on. A file that has reached its size
becomes the newest of a few older ones.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Generic, NamedTuple, TypeVar

import msgspec

from dtwin.errors import RecordingError
from dtwin.files import append_whole, reason_of, replacing, writing

log = logging.getLogger(__name__)

T = TypeVar("T", bound=msgspec.Struct)
LARGEST: Final = 8 << 20
"""Size from which on a file is an older one, bytes."""
OLDER: Final = 4
"""Number of older files that are kept."""
PATIENCE: Final = 1.0
"""Longest wait for another process that writes, s."""
_LOOK: Final = 0.01
"""Time between two looks whether the other process has finished, s."""
_BLOCK: Final = 4096
"""Length of the end of a file that is read first for its last line, bytes."""
_SEALED: Final = re.compile(rb'(.*,"line":(\d+))(?:,"hash":"([0-9a-f]{32})")\}', re.DOTALL)


class Seal(NamedTuple):
    """Number and hash of a line; number 0 before the first."""

    line: int = 0
    hash: str = ""


@dataclass(frozen=True)
class Chain:
    """What a check of all lines has found.

    Attributes:
        lines: number of lines.
        unsealed: number of those without a hash, which an earlier version has written.
        seal: seal of the last line.
        hashes: hashes of all lines.
        faults: what is wrong, in words; none for a file that is as it was written.
    """

    lines: int
    unsealed: int
    seal: Seal
    hashes: frozenset[str]
    faults: tuple[str, ...]


class _Line(NamedTuple):
    """A line as it was found: where, its text, and what is wrong with it, "" for nothing."""

    where: str
    text: bytes
    seal: Seal | None
    fault: str


class LineFile(Generic[T]):
    """A file of entries; several processes may append to it.

    Args:
        path: path of the file, which is made with the first entry. Older ones lie beside it as PATH.1, the newest, to
            PATH.4; what was found damaged as PATH.damaged.
        kind: type of the entries.
        what: an entry in words, for messages.
        mode: rights of the file.
        largest: size from which on it becomes an older one, bytes.
        older: number of older files that are kept.
        sync: whether an entry is on disk, and not only in the system's memory, when `append` returns.
        marked: whether PATH.end tells the last line, so that lines that were cut off at the end are missed, too.
        carry: gives the entries with which a file begins that follows a full one.
    """

    def __init__(
        self,
        path: Path,
        kind: type[T],
        what: str,
        *,
        mode: int = 0o644,
        largest: int = LARGEST,
        older: int = OLDER,
        sync: bool = True,
        marked: bool = False,
        carry: Callable[[], Iterable[T]] = tuple,
    ) -> None:
        self.path = path
        self._decode = msgspec.json.Decoder(kind).decode
        self._what = what
        self._mode = mode
        self._largest = largest
        self._older = older
        self._sync = sync
        self._carry = carry
        self._end = path.with_name(f"{path.name}.end") if marked else None

    @property
    def exists(self) -> bool:
        """Whether anything was ever written, as far as can be told."""
        return self.path.exists() or (self._end is not None and self._end.exists())

    def entries(self) -> list[T]:
        """All entries, oldest first; none when there is no file. Lines that were cut off are told and do not count.

        Raises:
            RecordingError: a file cannot be read, or a line is no entry or is not as it was written.
        """
        found = []
        for line in self._lines():
            try:
                found.append(self._decode(line.text))
            except msgspec.MsgspecError as error:
                raise RecordingError(f"{line.where}: expected {self._what}: {error}") from None
            if line.fault:
                raise RecordingError(f"{line.where}: expected {self._what} as it was written: {line.fault}")
        return found

    def last(self) -> T | None:
        """The newest entry, or None when there is no entry.

        Raises:
            RecordingError: a file cannot be read, or a line is no entry or is not as it was written.
        """
        found = self.entries()
        return found[-1] if found else None

    def verify(self) -> Chain:
        """Checks all lines.

        Raises:
            RecordingError: a file cannot be read.
        """
        lines = list(self._lines())
        seals = [line.seal for line in lines if line.seal is not None]
        last = seals[-1] if seals else Seal(len(lines))
        faults = [f"{line.where}: {line.fault}" for line in lines if line.fault]
        end = self._marked()
        if end.line > last.line:
            faults.append(f"{self.path}: {_missing(last.line + 1, end.line)} at its end")
        elif end.line and end not in seals and len(seals) == len(lines):
            faults.append(f"{self.path}: line {end.line} is not the one that {self._end} tells of")
        return Chain(len(lines), len(lines) - len(seals), last, frozenset(each.hash for each in seals), tuple(faults))

    def append(self, *entries: T) -> None:
        """Appends entries, all or none of them, which are down when the call returns.

        Raises:
            NoSpaceError: there is no room for them.
            RecordingError: the file cannot be written.
        """
        with writing(self.path), self._locked(os.O_RDWR | os.O_CREAT | os.O_APPEND) as file:
            seal = self._mended(file)
            if os.fstat(file).st_size >= self._largest:
                self._begin_anew(seal, entries)
                return
            data, seal = _sealed(entries, seal)
            append_whole(file, data, sync=self._sync)
            self._mark(seal)

    def renew(self) -> None:
        """Makes the file an older one, whatever its size.

        Raises:
            NoSpaceError: there is no room for a new one.
            RecordingError: it cannot be written.
        """
        with writing(self.path), self._locked(os.O_RDWR | os.O_CREAT | os.O_APPEND) as file:
            self._begin_anew(self._mended(file), ())

    def _begin_anew(self, seal: Seal, entries: Iterable[T]) -> None:
        """Makes the file the newest of the older ones, and begins a new one, all at once."""
        data, seal = _sealed([*self._carry(), *entries], seal)
        with replacing(self.path) as temporary:
            file = os.open(temporary, os.O_WRONLY)
            try:
                os.fchmod(file, self._mode)
                append_whole(file, data, sync=self._sync)
            finally:
                os.close(file)
            for number in range(self._older, 1, -1):
                with suppress(FileNotFoundError):
                    os.replace(self._numbered(number - 1), self._numbered(number))
            # A second name, and not a new one: there is no moment without a file, in which others would begin one.
            spare = self._numbered(0)
            spare.unlink(missing_ok=True)
            os.link(self.path, spare)
            os.replace(spare, self._numbered(1))
        self._mark(seal)

    def _numbered(self, number: int) -> Path:
        return self.path.with_name(f"{self.path.name}.{number}")

    @contextmanager
    def _locked(self, flags: int) -> Iterator[int]:
        """Opens the file, which nobody else may write meanwhile, and which is not an older one yet."""
        deadline = time.monotonic() + PATIENCE
        while True:
            file = os.open(self.path, flags, self._mode)
            try:
                _lock(file, fcntl.LOCK_SH if flags == os.O_RDONLY else fcntl.LOCK_EX, deadline, self.path)
                if _is_at(file, self.path):
                    yield file
                    return
            finally:
                os.close(file)

    def _mended(self, file: int) -> Seal:
        """The seal of the last line; what stands behind the last whole line is kept aside and told."""
        size = os.fstat(file).st_size
        end, last = _last_line(file, size)
        if end < size:
            aside = self.path.with_name(f"{self.path.name}.damaged")
            with aside.open("ab") as kept:
                kept.write(os.pread(file, size - end, end) + b"\n")
            os.ftruncate(file, end)
            log.warning("%s: its last line was cut off: %d bytes are kept in %s", self.path, size - end, aside.name)
        seal = _seal_of(last)
        if seal is None:  # nothing, or a line of an earlier version
            seal = Seal(os.pread(file, end, 0).count(b"\n"), _digest("", last)) if last else self._of_older()
        marked = self._marked()
        if marked.line > seal.line:
            log.warning("%s: %s at its end", self.path, _missing(seal.line + 1, marked.line))
        return max(seal, marked, key=lambda each: each.line)

    def _of_older(self) -> Seal:
        """The seal of the last line of the newest older file."""
        try:
            with self._numbered(1).open("rb") as file:
                _, last = _last_line(file.fileno(), os.fstat(file.fileno()).st_size)
        except FileNotFoundError:
            return Seal()
        return _seal_of(last) or Seal()

    def _marked(self) -> Seal:
        """The seal that the mark of the end tells; the one before the first line without such a mark."""
        if self._end is None:
            return Seal()
        try:
            return msgspec.json.decode(self._end.read_bytes(), type=Seal)
        except (OSError, msgspec.MsgspecError):
            return Seal()

    def _mark(self, seal: Seal) -> None:
        """Tells the last line. The mark keeps its length, so that it is written where it is, also on a full disk."""
        if self._end is None:
            return
        text = msgspec.json.encode(seal).ljust(63) + b"\n"
        file = os.open(self._end, os.O_WRONLY | os.O_CREAT, self._mode)
        try:
            os.pwrite(file, text, 0)
        finally:
            os.close(file)

    def _lines(self) -> Iterator[_Line]:
        """All lines, oldest first, each checked against the one before."""
        before, sealed = Seal(), False
        for path, content in self._contents():
            *texts, rest = content.split(b"\n")
            whole = len(texts)
            while texts and not _is_json(texts[-1]):
                texts.pop()
            if rest or len(texts) < whole:
                log.warning("%s:%d: this line was cut off, it does not count", path, len(texts) + 1)
            for number, text in enumerate(texts, 1):
                seal = _seal_of(text)
                if seal is None:
                    fault = "it has no hash, though a line before it has one" if sealed else ""
                    before = Seal(before.line + 1, _digest("", text))
                elif before.line == 0 and path == self._numbered(self._older):
                    fault, before, sealed = "", seal, True  # Files before this one have been given up.
                else:
                    fault, before, sealed = _fault(text, seal, before), seal, True
                yield _Line(f"{path}:{number}", text, seal, fault)

    def _contents(self) -> Iterator[tuple[Path, bytes]]:
        """The files, oldest first, and what they hold, while nobody writes."""
        try:
            with self._locked(os.O_RDONLY) as file:
                for number in range(self._older, 0, -1):
                    older = self._numbered(number)
                    if older.exists() and not _is_at(file, older):
                        yield older, older.read_bytes()
                yield self.path, os.pread(file, os.fstat(file).st_size, 0)
        except FileNotFoundError:
            return
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {reason_of(error)}") from None


def _lock(file: int, kind: int, deadline: float, path: Path) -> None:
    """Locks a file; waits for other processes no longer than until a time of the monotonic clock, s."""
    while True:
        try:
            fcntl.flock(file, kind | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise RecordingError(f"{path}: cannot be used: another process has locked it") from None
            time.sleep(_LOOK)


def _is_at(file: int, path: Path) -> bool:
    """Whether an open file is the one at a path."""
    try:
        return os.path.samestat(os.fstat(file), path.stat())
    except FileNotFoundError:
        return False


def _last_line(file: int, size: int) -> tuple[int, bytes]:
    """Where the last whole line of a file ends, and its text; the file is read from its end on."""
    length = _BLOCK
    while True:
        start = max(0, size - length)
        lines = os.pread(file, size - start, start).split(b"\n")
        end = size - len(lines.pop())
        while lines[1 if start else 0 :]:  # The first line may have begun earlier.
            if _is_json(lines[-1]):
                return end, lines[-1]
            end -= len(lines.pop()) + 1
        if not start:
            return end, b""
        length *= 4


def _sealed(entries: Iterable[msgspec.Struct], seal: Seal) -> tuple[bytes, Seal]:
    """Entries as lines that follow a line, and the seal of the last of them."""
    data = b""
    for entry in entries:
        text = msgspec.json.encode(entry)[:-1] + b',"line":%d' % (seal.line + 1)
        seal = Seal(seal.line + 1, _digest(seal.hash, text))
        data += text + b',"hash":"%s"}\n' % seal.hash.encode()
    return data, seal


def _seal_of(text: bytes) -> Seal | None:
    match = _SEALED.fullmatch(text)
    return None if match is None else Seal(int(match[2]), match[3].decode())


def _digest(before: str, text: bytes) -> str:
    return hashlib.blake2b(before.encode() + text, digest_size=16).hexdigest()


def _fault(text: bytes, seal: Seal, before: Seal) -> str:
    """What is wrong with a line that follows another one, "" for nothing."""
    if seal.line > before.line + 1:
        return _missing(before.line + 1, seal.line - 1)
    if seal.line <= before.line:
        return f"line {seal.line} stands after line {before.line}"
    right = seal.hash == _digest(before.hash, text[: text.rindex(b',"hash":')])
    return "" if right else "it was changed, or the line before it was"


def _missing(first: int, last: int) -> str:
    return f"line {first} is missing" if first == last else f"lines {first} to {last} are missing"


def _is_json(text: bytes) -> bool:
    try:
        msgspec.json.decode(text, type=dict[str, msgspec.Raw])
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return False
    return True
