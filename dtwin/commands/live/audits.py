"""What the commands that show an audit have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from dtwin.console.people.audit import Audit, AuditEntry
from dtwin.errors import RecordingError
from dtwin.terminal import printable


@dataclass(frozen=True, kw_only=True)
class AuditOptions:
    """An audit that is shown and checked."""

    last: int = 20
    """Number of the last entries that are shown; 0 shows none."""
    hash: str = ""
    """Hash of a line that was noted elsewhere and must be there: who may write the file could make all of it anew."""

    def show(self, path: Path, writer: str, words: Callable[[AuditEntry], str]) -> int:
        """Prints the last entries if every line fits to the one before, else what does not; the exit status.

        Args:
            path: path of the file.
            writer: who writes it, in words.
            words: gives an entry in words, without its time.

        Raises:
            RecordingError: there is no such file, or it cannot be read.
        """
        audit = Audit(path)
        if not audit.exists:
            raise RecordingError(f"{path}: there is no audit yet; {writer} writes it")
        chain = audit.verify()
        faults = list(chain.faults)
        if self.hash and self.hash not in chain.hashes:
            faults.append(f"{path}: no line has the hash {self.hash}")
        for fault in faults:
            print(printable(fault))
        if faults:
            return 1
        for entry in audit.entries()[-self.last :] if self.last > 0 else []:
            at = datetime.fromtimestamp(entry.at, UTC).isoformat(" ", "seconds")
            print(printable(f"{at}  {words(entry)}"))
        earlier = f", {chain.unsealed} of an earlier version without hashes" if chain.unsealed else ""
        print(f"{chain.lines} lines, whole{earlier}; the last has the hash {chain.seal.hash}")
        return 0


def outcome(entry: AuditEntry, longest: int | None = None) -> str:
    """What was answered, "" while it is not known, cut to so many characters if that is given."""
    return f": {'done' if entry.done else 'refused'}, {entry.answer[:longest]}" if entry.answer else ""
