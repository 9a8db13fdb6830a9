"""`dtwin mcp`: the interface to an AI; its audit; and what people decide about its proposals."""

from __future__ import annotations

import getpass
import os
import secrets
import socket
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import tyro

from dtwin.ai.profiles import Limits, Profile, role_of
from dtwin.bus.line.messages import FlowEffect
from dtwin.bus.messages import SUMMARY, Summary
from dtwin.bus.proposals.deciding import ARM, CELL, DOORS, LINE, LINE_DOORS, Door, Kept, decide, find, have_answered
from dtwin.bus.proposals.messages import Kind, Proposal, ProposalDecision
from dtwin.bus.session import Bus
from dtwin.commands.live.audits import AuditOptions, outcome
from dtwin.errors import ParameterError
from dtwin.files import replacing
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.names import check_name
from dtwin.parameters import ArmParameters
from dtwin.run.options import CellFileOption
from dtwin.services import runfile
from dtwin.services.runfile import has_other_arm, join, join_line, kept
from dtwin.simulation.history import HISTORY
from dtwin.simulation.proposals.book import OWN
from dtwin.terminal import print_json, printable

if TYPE_CHECKING:
    from dtwin.ai.server import NotedServer
    from dtwin.console.clocks import Clocks

AUDIT: Final = Path("ai-audit.jsonl")
MISSING: Final = "the interface to an AI needs packages that are not installed: pip install 'dtwin[mcp]'"


@dataclass(frozen=True, kw_only=True)
class McpCommand(CellFileOption):
    """Serve a running cell or line to an AI by the Model Context Protocol, on standard input and output.

    The AI can look and ask. With --profile propose it can propose, and a person approves at the console or with
    `dtwin mcp approve`; with --profile act it changes settings itself, within limits.
    """

    cell: str = "cell"
    """Name of the cell."""
    arm: str = "arm"
    """Name of the arm, for a cell on another machine."""
    line: str | None = None
    """Name of a line, which is served in the place of a cell; see `dtwin line up`."""
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
    """With --profile act: largest factor by which a gain, the target time or a mass may change at a time, and by
    which the boxes an hour of a line may fall."""

    def execute(self) -> int:
        try:
            from dtwin.ai.serving import Place, served
        except ImportError:
            raise ParameterError(MISSING) from None
        from dtwin.console.commands import Files

        check_name(self.who, "who")
        if self.who in OWN:
            raise ParameterError(f"--who {self.who}: a service proposes under it: expected another name")
        limits = Limits(self.hourly, self.pause, self.factor)
        if self.line is not None:
            return self._serve_line(self.line, limits)
        up = runfile.find(self.cell) if self.zenoh is None else None
        cell = self if up is None or self.cell_file else replace(self, cell_file=up.cell_file or None)
        store = self.store or kept(self.cell, "store", STORE)
        healthy = None if self.model is None else open_model(self.model, ModelStore(store)).arm
        with join(self.cell, self.zenoh, role_of(self.profile), self.arm) as bus, socket.socket() as sock:
            address = self._address(sock)
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
            with served(bus, place, _clocks()) as found:
                self._serve(found.server, sock, address, self.cell)
        return 0

    def _serve_line(self, line: str, limits: Limits) -> int:
        from dtwin.ai.lines.serving import LinePlace, line_server

        with join_line(line, self.zenoh, role_of(self.profile)) as bus, socket.socket() as sock:
            address = self._address(sock)
            place = LinePlace(self.profile, self.who, self.audit, address, limits)
            self._serve(line_server(bus, place, _clocks()), sock, address, line)
        return 0

    def _address(self, sock: socket.socket) -> str:
        """Where the clients are. Raises ParameterError when the port is not free."""
        if not self.http:
            return "stdio"
        _listen(sock, self.port)
        return f"127.0.0.1:{sock.getsockname()[1]}"

    def _serve(self, server: NotedServer, sock: socket.socket, address: str, name: str) -> None:
        from dtwin.ai.serving import serve_http

        if self.http:
            token = _write_token(name)
            print(f"http://{address}/mcp, profile {self.profile}; the token is in {token[0]}", flush=True)
            serve_http(server, sock, token[1])
        else:
            server.run("stdio")


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
    """The cell or line whose proposals are meant."""

    cell: str = "cell"
    """Name of the cell."""
    line: str | None = None
    """Name of a line, in the place of a cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell or line on another machine."""

    @property
    def proposals_kept(self) -> Kept:
        """Who keeps the proposals."""
        if self.line is not None:
            return LINE
        return ARM if has_other_arm(self.cell, self.zenoh) else CELL

    def joined(self) -> Bus:
        """Its bus. Raises CommunicationError when it is not up."""
        return join(self.cell, self.zenoh) if self.line is None else join_line(self.line, self.zenoh)


@dataclass(frozen=True, kw_only=True)
class McpProposals(_AtCell):
    """Show what an AI has proposed, what the twin expects of it, and what became of it."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        with self.joined() as bus:
            told = self.proposals_kept.proposals(bus)
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
        store = self.store or kept(self.cell, "store", STORE)
        healthy = None if self.model is None else open_model(self.model, ModelStore(store)).arm
        with self.joined() as bus:
            seen = find(bus, self.number, self.proposals_kept)
            _show(seen)
            if not (self.yes or _agreed()):
                print("not approved; it stays open")
                return 1
            decision = ProposalDecision(
                seen.number, self.digest or seen.digest, self.who or getpass.getuser(), "approve"
            )
            _show(decide(bus, decision, self._doors(bus, healthy), self.proposals_kept))
        return 0

    def _doors(self, bus: Bus, healthy: ArmParameters | None) -> Mapping[Kind, Door]:
        """What carries out what is approved."""
        from dtwin.ai.approving import answering_door

        if self.line is not None:
            return LINE_DOORS
        there = "recovery" in bus.ask(SUMMARY, None, Summary).services
        return {**DOORS, "answer": have_answered if there else answering_door(healthy)}


@dataclass(frozen=True, kw_only=True)
class McpDecline(_Decision):
    """Decline a proposal of an AI."""

    why: str = ""
    """Reason, which the AI is told."""

    def execute(self) -> int:
        with self.joined() as bus:
            seen = find(bus, self.number, self.proposals_kept)
            who = self.who or getpass.getuser()
            decision = ProposalDecision(seen.number, self.digest or seen.digest, who, "decline", self.why)
            _show(decide(bus, decision, {}, self.proposals_kept))
        return 0


def _clocks() -> Clocks:
    from dtwin.console.clocks import Clocks

    return Clocks(time.monotonic, time.time)


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
    if proposal.flow is not None:
        _show_flow(proposal.flow)
    if asked.text:
        print(printable(f"      says: {asked.text}"))
    if effect is not None:
        for line in effect.difference:
            print(printable(f"      {line}"))
        now = "refused" if effect.tracking_now is None else _list(effect.tracking_now)
        print(f"      farthest from the path {_list(effect.tracking)} mrad, in force {now}")
        print(f"      disk margin {effect.disk_margin:.2f}, in force {effect.disk_margin_now:.2f}")


def _show_flow(flow: FlowEffect) -> None:
    for line in flow.difference:
        print(printable(f"      {line}"))
    print(f"      {flow.rate:.1f} boxes/h expected, in force {flow.rate_now:.1f}")
    for zone in flow.zones:
        print(printable(f"      zone {zone.zone}: {zone.rate:.1f} boxes/h, in force {zone.rate_now:.1f}"))


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
