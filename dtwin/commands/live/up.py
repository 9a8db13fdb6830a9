"""`dtwin up`, `dtwin status`, `dtwin down`: the services of a cell, started, seen and stopped together."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dtwin.bus.messages import SUMMARY, Summary
from dtwin.errors import CommunicationError
from dtwin.services import runfile
from dtwin.services.launch import LOOK, READY_TIMEOUT, CellOptions, launched
from dtwin.services.runfile import join
from dtwin.services.supervisor import Supervisor
from dtwin.terminal import as_text, folding, print_json, printable

if TYPE_CHECKING:
    from rich.live import Live
    from rich.table import Table


@dataclass(frozen=True)
class UpCommand(CellOptions):
    """Start the services of a cell, show how they do, and stop them on Ctrl-C or after --duration."""

    detach: bool = False
    """Return when all is ready, and leave the cell running."""
    json: bool = False
    """Print one JSON object at the end and nothing else."""

    def execute(self) -> int:
        if self.detach:
            return self._detach()
        with launched(self) as cell:
            _warn(cell.up)
            with self._table(cell.supervisor) as live:
                cell.await_ready()
                if live is not None:
                    for line in _addresses(cell.up):
                        live.console.print(line, highlight=False, soft_wrap=True)
                while not (cell.over or cell.stop.wait(LOOK)):
                    if live is not None:
                        live.update(table(cell.supervisor.summary()))
            summary = cell.supervisor.summary()
        if self.json:
            print_json(summary)
        return 0

    @contextmanager
    def _table(self, supervisor: Supervisor) -> Iterator[Live | None]:
        if self.json:
            yield None
            return
        from rich.console import Console  # A cell that shows nothing does without.
        from rich.live import Live

        with Live(table(supervisor.summary()), console=Console(stderr=True), refresh_per_second=4) as live:
            yield live

    def _detach(self) -> int:
        """Starts the same command, which shows nothing, in a session of its own and waits until it is ready."""
        words = [word for word in sys.argv[1:] if word not in ("--detach", "--json")]
        output = runfile.folder() / f"{self.cell}.log"
        if runfile.find(self.cell) is not None:
            raise CommunicationError(f"cell {self.cell!r} is up already: stop it with `dtwin down`")
        with output.open("wb") as sink:
            command = [sys.executable, "-m", "dtwin", *words, "--json"]
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True
            )
        while process.poll() is None:
            up = runfile.find(self.cell)
            if up is not None and up.ready:
                _warn(up)
                print(f"cell {self.cell!r} is up: see it with `dtwin status`, stop it with `dtwin down`")
                for line in _addresses(up):
                    print(line)
                return 0
            time.sleep(LOOK)
        words_said = output.read_text(errors="replace").strip().splitlines()
        raise CommunicationError(words_said[-1].removeprefix("dtwin: ") if words_said else "the cell did not start")


@dataclass(frozen=True)
class StatusCommand:
    """Show how the services of a cell do that was started with `dtwin up`."""

    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        from rich.console import Console

        with join(self.cell) as bus:
            summary = bus.ask(SUMMARY, None, Summary)
        if self.json:
            print_json(summary)
        else:
            console = Console()
            console.print(table(summary))
            console.print(as_text(f"controller: {runfile.require(self.cell).controller}"), soft_wrap=True)
        return 0


@dataclass(frozen=True)
class DownCommand:
    """Stop a cell that was started with `dtwin up`."""

    cell: str = "cell"
    """Name of the cell."""

    def execute(self) -> int:
        up = runfile.require(self.cell)
        os.kill(up.pid, signal.SIGTERM)
        if not runfile.wait_down(self.cell, READY_TIMEOUT):
            raise CommunicationError(f"cell {self.cell!r} does not stop: its supervisor is process {up.pid}")
        print(f"cell {self.cell!r} is down")
        return 0


def table(summary: Summary) -> Table:
    """A summary for people."""
    from rich.table import Table

    grid = Table("service", "state", "rate", "restarts", "last error", title=_title(summary), title_justify="left")
    colours = {"running": "green", "safe": "red", "dead": "red", "silent": "red"}
    for name, service in summary.services.items():
        state = as_text(service.state, colours.get(service.state, "yellow"))
        rate = f"{service.rate_hz:.0f} Hz" if service.rate_hz else ""
        grid.add_row(as_text(name), state, rate, str(service.restarts or ""), as_text(service.last_error))
    return folding(grid)


def _title(summary: Summary) -> str:
    parts = [f"{summary.ticks} ticks, {summary.late_ticks} late"]
    if summary.real_time_factor:
        parts.append(f"{summary.real_time_factor:.2f} x real time")
    if summary.latency_ms is not None:
        latency = summary.latency_ms
        parts.append(f"latency {latency.p50:.2f} ms (99 %: {latency.p99:.2f}, most: {latency.max:.2f})")
    if summary.boxes is not None:
        parts.append(f"boxes: {summary.boxes.arrived} arrived, {summary.boxes.delivered} delivered")
    return "; ".join(parts)


def _warn(up: runfile.Up) -> None:
    """Tells the user of open ports."""
    if up.warning:
        print(printable(f"dtwin: warning: {up.warning}"), file=sys.stderr)


def _addresses(up: runfile.Up) -> list[str]:
    """Lines that tell where the controller is managed, where others join, and where the cell is shown, if it is."""
    join = f"joins it as the configuration in {up.zenoh} says" if up.zenoh else f"connects to {up.meet}, as a peer"
    lines = [f"the controller's device management is at {up.controller}", f"a Zenoh program {join}"]
    lines += [f"the cell is shown at {up.page}"] if up.page else []
    return [*lines, f"its operators' console is at {up.console}"] if up.console else lines
