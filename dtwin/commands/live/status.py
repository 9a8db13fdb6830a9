"""`dtwin status`, `dtwin down`: a cell that is up, seen and stopped; they load little, as somebody waits for them."""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from dtwin.bus.messages import SUMMARY, Summary
from dtwin.errors import CommunicationError
from dtwin.services import runfile
from dtwin.services.runfile import LINE, join
from dtwin.terminal import as_text, folding, print_json, printable

if TYPE_CHECKING:
    from rich.console import RenderableType

STOPPING: Final = 120.0
"""Time in which a cell must be down, s."""


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
            up = runfile.require(self.cell)
            where = up.controller or "the function blocks run in the bridge"
            said = f"controller: {where}" if up.arm != LINE else "how the line does tells `dtwin line status`"
            console.print(as_text(said), soft_wrap=True)
        return 0


@dataclass(frozen=True)
class DownCommand:
    """Stop a cell that was started with `dtwin up`."""

    cell: str = "cell"
    """Name of the cell."""

    def execute(self) -> int:
        up = runfile.require(self.cell)
        os.kill(up.pid, signal.SIGTERM)
        if not runfile.wait_down(self.cell, STOPPING):
            raise CommunicationError(f"cell {self.cell!r} does not stop: its supervisor is process {up.pid}")
        print(f"cell {self.cell!r} is down")
        return 0


def table(summary: Summary) -> RenderableType:
    """A summary for people."""
    from rich.console import Group
    from rich.table import Table

    grid = Table("service", "state", "rate", "restarts", "last error", title=_title(summary), title_justify="left")
    colours = {"running": "green", "safe": "red", "dead": "red", "silent": "red"}
    for name, service in summary.services.items():
        said = f"{service.state}: {service.doing}" if service.doing else service.state
        state = as_text(said, colours.get(service.state, "yellow"))
        rate = f"{service.rate_hz:.0f} Hz" if service.rate_hz else ""
        grid.add_row(as_text(name), state, rate, str(service.restarts or ""), as_text(service.last_error))
    return Group(folding(grid), *map(as_text, news(summary).values()))


def news(summary: Summary) -> dict[str, str]:
    """Lines for people with the monitor's verdict and the last event, by what they are; those that there are."""
    found = {"verdict": f"verdict: {printable(summary.verdict)}"} if summary.verdict else {}
    if summary.last_event is not None:
        found["event"] = f"last event: {summary.last_event.time:.2f} s {printable(summary.last_event.text)}"
    return found


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
