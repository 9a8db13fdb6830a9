"""`dtwin console`: the operator's page of a cell that is up, and those who may use it."""

from __future__ import annotations

import getpass
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from dtwin.commands.live.audits import AuditOptions, outcome
from dtwin.services.console import NAME, ConsoleOptions
from dtwin.services.runfile import LINE, find, join


@dataclass(frozen=True, kw_only=True)
class ConsoleCommandLine(ConsoleOptions):
    """Show a running cell or line to its operators on a web page, until Ctrl-C."""

    cell: str = "cell"
    """Name of the cell or line."""
    arm: str = "arm"
    """Name of the arm, for a cell on another machine; line for a line."""
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
            what = "line" if arm == LINE else "cell"
            print(f"the console of {what} {self.cell!r} is at {web.address}; Ctrl-C ends it", flush=True)
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
class ConsoleAudit(AuditOptions):
    """Show what was commanded from consoles, and check that nothing of it was changed or taken out.

    Every line carries a hash of itself and of the line before. The exit status is 1 when one does not fit.
    """

    file: tyro.conf.Positional[Path] = Path("console-audit.jsonl")
    """The audit file."""

    def execute(self) -> int:
        return self.show(
            self.file,
            "a console",
            lambda entry: f"{entry.command} by {entry.user}, {entry.role}, from {entry.address}{outcome(entry)}",
        )
