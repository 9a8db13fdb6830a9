"""`dtwin mcp`: the interface to an AI; its audit; and what people decide about its proposals."""

from __future__ import annotations

import getpass
import os
import secrets
import socket
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import tyro

from dtwin.ai.profiles import Limits, Profile, role_of
from dtwin.bus.messages import LOOK, SUMMARY, Summary
from dtwin.bus.proposals.deciding import DOORS, decide, find, have_answered
from dtwin.bus.proposals.messages import Look, Proposal, ProposalDecision
from dtwin.commands.live.audits import AuditOptions, outcome
from dtwin.errors import ParameterError
from dtwin.files import replacing
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.names import check_name
from dtwin.run.options import CellFileOption
from dtwin.services import runfile
from dtwin.services.runfile import join, kept
from dtwin.simulation.history import HISTORY
from dtwin.simulation.proposals.book import RECOVERY
from dtwin.terminal import print_json, printable

AUDIT: Final = Path("ai-audit.jsonl")
MISSING: Final = "the interface to an AI needs packages that are not installed: pip install 'dtwin[mcp]'"


@dataclass(frozen=True, kw_only=True)
class McpCommand(CellFileOption):
    """Serve a running cell to an AI by the Model Context Protocol, on standard input and output.

    The AI can look and ask. With --profile propose it can propose, and a person approves at the console or with
    `dtwin mcp approve`; with --profile act it changes settings itself, within limits.
    """

    cell: str = "cell"
    """Name of the cell."""
    arm: str = "arm"
    """Name of the arm, for a cell on another machine."""
    zenoh: Path | None = None
    """Zenoh configuration folder, for a cell on another machine; the file is that of the profile."""
    profile: Profile = "observe"
    """observe (changes nothing), propose (a person approves) or act (within limits)."""
    who: str = "ai"
    """Name of the AI, for proposals, histories and events."""
    http: bool = False
    """Serve on a port of the loopback interface instead, to clients with the token that is written to a file."""
    port: int = 0
    """That port, a free one if not given."""
    audit: Path = AUDIT
    """File that every call is appended to."""
    alarms: Path = Path("console-alarms.jsonl")
    """Journal of the alarms, which a console keeps."""
    recordings: Path | None = None
    """Folder of the logs that may be drawn."""
    store: Path | None = None
    """Folder of the identified models; that of the cell if not given."""
    model: str | None = None
    """Identified model of the healthy arm, for answers to findings; the controller's model if not given."""
    hourly: int = Limits().hourly
    """With --profile act: largest number of changes in an hour."""
    pause: float = Limits().pause
    """With --profile act: least time between two changes, s."""
    factor: float = Limits().factor
    """With --profile act: largest factor by which a gain, the target time or a mass may change at a time."""

    def execute(self) -> int:
        try:
            from dtwin.ai.serving import STDIO, Place, serve_http, served
        except ImportError:
            raise ParameterError(MISSING) from None
        from dtwin.console.commands import Files
        from dtwin.console.hub import Clocks

        check_name(self.who, "who")
        if self.who == RECOVERY:
            raise ParameterError(f"--who {self.who}: the recovery service proposes under it: expected another name")
        limits = Limits(self.hourly, self.pause, self.factor)
        up = runfile.find(self.cell) if self.zenoh is None else None
        cell = self if up is None or self.cell_file else replace(self, cell_file=up.cell_file or None)
        store = self.store or kept(self.cell, "store", STORE)
        healthy = None if self.model is None else open_model(self.model, ModelStore(store)).arm
        clocks = Clocks(time.monotonic, time.time)
        with join(self.cell, self.zenoh, role_of(self.profile), self.arm) as bus, socket.socket() as sock:
            if self.http:
                _listen(sock, self.port)
            address = f"127.0.0.1:{sock.getsockname()[1]}" if self.http else STDIO
            place = Place(
                self.cell,
                self.arm if up is None else up.arm,
                self.profile,
                self.who,
                Files(store, kept(self.cell, "history", HISTORY), self.recordings),
                self.alarms,
                self.audit,
                limits,
                healthy,
                cell.task(),
                address,
            )
            with served(bus, place, clocks) as found:
                if self.http:
                    token = _write_token(self.cell)
                    print(f"http://{address}/mcp, profile {self.profile}; the token is in {token[0]}", flush=True)
                    serve_http(found.server, sock, token[1])
                else:
                    found.server.run("stdio")
        return 0


@dataclass(frozen=True, kw_only=True)
class McpAudit(AuditOptions):
    """Show what an AI has called and what it was answered, and check that nothing of it was changed or taken out.

    Every line carries a hash of itself and of the line before. The exit status is 1 when one does not fit.
    """

    file: tyro.conf.Positional[Path] = AUDIT
    """The audit file."""

    def execute(self) -> int:
        return self.show(
            self.file,
            "`dtwin mcp`",
            lambda entry: f"{entry.command} {entry.content} by {entry.user}, {entry.role}{outcome(entry, 200)}",
        )


@dataclass(frozen=True, kw_only=True)
class _AtCell:
    """The cell whose proposals are meant."""

    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""


@dataclass(frozen=True, kw_only=True)
class McpProposals(_AtCell):
    """Show what an AI has proposed, what the twin expects of it, and what became of it."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        with join(self.cell, self.zenoh) as bus:
            told = bus.ask(LOOK, None, Look).proposals
        if self.json:
            print_json({"proposals": told})
            return 0
        for each in told:
            _show(each)
        print(f"{sum(each.state == 'open' for each in told)} wait for a person")
        return 0


@dataclass(frozen=True, kw_only=True)
class _Decision(_AtCell):
    """Whose decision it is, about what."""

    number: tyro.conf.Positional[int]
    """Number of the proposal."""
    digest: str = ""
    """Digest of the proposal as it was seen before; what is shown now counts if not given."""
    who: str = ""
    """Name, for the history; the login name if not given."""


@dataclass(frozen=True, kw_only=True)
class McpApprove(_Decision):
    """Approve a proposal of an AI: what is shown is carried out in your name, and checked and tried as usual."""

    yes: bool = False
    """Do not ask."""
    model: str | None = None
    """Identified model of the healthy arm, for answers to findings; the controller's model if not given.
    The recovery service of a cell that has one answers with what it knows itself."""
    store: Path | None = None
    """Folder of the identified models; that of the cell if not given."""

    def execute(self) -> int:
        from dtwin.ai.approving import answering_door

        store = self.store or kept(self.cell, "store", STORE)
        healthy = None if self.model is None else open_model(self.model, ModelStore(store)).arm
        with join(self.cell, self.zenoh) as bus:
            seen = find(bus, self.number)
            _show(seen)
            if not (self.yes or _agreed()):
                print("not approved; it stays open")
                return 1
            decision = ProposalDecision(
                seen.number, self.digest or seen.digest, self.who or getpass.getuser(), "approve"
            )
            there = "recovery" in bus.ask(SUMMARY, None, Summary).services
            answers = have_answered if there else answering_door(healthy)
            _show(decide(bus, decision, {**DOORS, "answer": answers}))
        return 0


@dataclass(frozen=True, kw_only=True)
class McpDecline(_Decision):
    """Decline a proposal of an AI."""

    why: str = ""
    """Reason, which the AI is told."""

    def execute(self) -> int:
        with join(self.cell, self.zenoh) as bus:
            seen = find(bus, self.number)
            who = self.who or getpass.getuser()
            _show(
                decide(bus, ProposalDecision(seen.number, self.digest or seen.digest, who, "decline", self.why), {})
            )
        return 0


def _agreed() -> bool:
    """Whether a person at the terminal says yes.

    Raises:
        ParameterError: there is nobody to ask.
    """
    if not sys.stdin.isatty():
        raise ParameterError("nobody can be asked, since standard input is no terminal: expected --yes")
    try:
        return input("approve this? yes or no: ").strip() == "yes"
    except EOFError:
        return False


def _show(proposal: Proposal) -> None:
    asked, effect = proposal.request, proposal.effect
    what = f"{asked.kind} {' '.join(asked.parameters)}".strip()
    became = ", ".join(part for part in (proposal.state, proposal.by, proposal.outcome) if part)
    print(printable(f"{proposal.number:4}  {proposal.time:.2f} s  {what} by {asked.who}: {became}"))
    print(printable(f"      because: {asked.why}"))
    if asked.text:
        print(printable(f"      says: {asked.text}"))
    if effect is not None:
        for line in effect.difference:
            print(printable(f"      {line}"))
        now = "refused" if effect.tracking_now is None else _list(effect.tracking_now)
        print(f"      farthest from the path {_list(effect.tracking)} mrad, in force {now}")
        print(f"      disk margin {effect.disk_margin:.2f}, in force {effect.disk_margin_now:.2f}")


def _list(values: tuple[float, ...]) -> str:
    return "/".join(f"{1e3 * value:.1f}" for value in values)


def _listen(sock: socket.socket, port: int) -> None:
    """Takes a port of the loopback interface. Raises ParameterError."""
    try:
        sock.bind(("127.0.0.1", port))
        sock.listen()
    except (OSError, OverflowError) as error:
        raise ParameterError(f"--port {port}: expected a free port: {error}") from None


def _write_token(cell: str) -> tuple[Path, str]:
    """A new token, in a file that this user alone can read."""
    path, token = runfile.folder() / f"{check_name(cell, 'cell')}.mcp-token", secrets.token_urlsafe(32)
    with replacing(path) as temporary:
        descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w") as file:
            os.fchmod(descriptor, 0o600)
            print(token, file=file)
    return path, token
