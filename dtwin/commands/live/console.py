"""`dtwin console`: the operator's page of a cell that is up, and those who may use it."""

from __future__ import annotations

import getpass
import sys
import threading
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import tyro

from dtwin.errors import RecordingError
from dtwin.services.console import NAME, ConsoleOptions
from dtwin.services.runfile import find, join
from dtwin.terminal import printable


@dataclass(frozen=True, kw_only=True)
class ConsoleCommandLine(ConsoleOptions):
    """Show a running cell to its operators on a web page, until Ctrl-C."""

    cell: str = "cell"
    """Name of the cell."""
    arm: str = "arm"
    """Name of the arm, for a cell on another machine."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        up = find(self.cell) if self.zenoh is None else None
        arm = self.arm if up is None else up.arm
        shown = self if up is None or self.cell_file else replace(self, cell_file=up.cell_file or None)
        with (
            shown.bound() as bound,
            join(self.cell, self.zenoh, NAME, self.arm) as bus,
            shown.serving(bound, bus, self.cell, arm) as web,
        ):
            bus.announce(NAME)
            print(f"the console of cell {self.cell!r} is at {web.address}; Ctrl-C ends it", flush=True)
            threading.Event().wait()
        return 0


@dataclass(frozen=True, kw_only=True)
class ConsoleUser:
    """Let somebody log in at consoles, or give them another role and password, which is asked for.

    The password is read from standard input when that is no terminal.
    """

    name: tyro.conf.Positional[str]
    """Name that the person logs in with."""
    role: str = "viewer"
    """viewer (watches), operator (also stops, releases, identifies) or engineer (also changes settings)."""
    users: Path = Path("console-users.json")
    """File of those who may log in."""

    def execute(self) -> int:
        from dtwin.console.people.users import Users

        if sys.stdin.isatty():
            password = getpass.getpass(f"password of {self.name}: ")
        else:
            password = sys.stdin.readline().rstrip("\n")
        Users(self.users).set(self.name, self.role, password)
        print(f"{self.name} may log in as {self.role}")
        return 0


@dataclass(frozen=True, kw_only=True)
class ConsoleAudit:
    """Show what was commanded from consoles, and check that nothing of it was changed or taken out.

    Every line carries a hash of itself and of the line before. The exit status is 1 when one does not fit.
    """

    file: tyro.conf.Positional[Path] = Path("console-audit.jsonl")
    """The audit file."""
    last: int = 20
    """Number of the last entries that are shown; 0 shows none."""
    hash: str = ""
    """Hash of a line that was noted elsewhere and must be there: who may write the file could make all of it anew."""

    def execute(self) -> int:
        from dtwin.console.people.audit import Audit

        audit = Audit(self.file)
        if not audit.exists:
            raise RecordingError(f"{self.file}: there is no audit yet; a console writes it")
        chain = audit.verify()
        faults = list(chain.faults)
        if self.hash and self.hash not in chain.hashes:
            faults.append(f"{self.file}: no line has the hash {self.hash}")
        for fault in faults:
            print(printable(fault))
        if faults:
            return 1
        for entry in audit.entries()[-self.last :] if self.last > 0 else []:
            at = datetime.fromtimestamp(entry.at, UTC).isoformat(" ", "seconds")
            outcome = f": {'done' if entry.done else 'refused'}, {entry.answer}" if entry.answer else ""
            who = f"{entry.user}, {entry.role}, from {entry.address}"
            print(printable(f"{at}  {entry.command} by {who}{outcome}"))
        earlier = f", {chain.unsealed} of an earlier version without hashes" if chain.unsealed else ""
        print(f"{chain.lines} lines, whole{earlier}; the last has the hash {chain.seal.hash}")
        return 0
