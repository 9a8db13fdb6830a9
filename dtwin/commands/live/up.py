"""`dtwin up`: the services of a cell, started, shown and stopped together."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from dtwin.bus.messages import ServiceSummary, Summary
from dtwin.commands.hints import warn_of_places
from dtwin.commands.live.status import news, table
from dtwin.errors import CommunicationError
from dtwin.run.without_effect import of_no_use
from dtwin.services import runfile
from dtwin.services.launch import CellOptions, launched
from dtwin.services.parts.launched import LOOK
from dtwin.services.supervisor import Supervisor
from dtwin.terminal import as_text, print_json, printable
from dtwin.view.viewer import has_gpu

if TYPE_CHECKING:
    from rich.live import Live


BEHIND: Final = (
    "this machine has no GPU: a browser here draws about a picture a second and falls behind the cell; it gets less,"
    " and the page says at its top by how much it is late (latency). The console keeps up: --console"
)


class Display:
    """Shows nothing."""

    def tell(self, line: str) -> None:
        """Shows a line that stays."""

    def show(self, summary: Summary) -> None:
        """Shows how the cell does now."""


class Lines(Display):
    """Prints a line for what has changed: the state of a service, the verdict, the last event."""

    def __init__(self) -> None:
        self._shown: dict[str, str] = {}

    def tell(self, line: str) -> None:
        print(printable(line), file=sys.stderr, flush=True)

    def show(self, summary: Summary) -> None:
        now = {name: f"{name}: {_line(service)}" for name, service in summary.services.items()} | news(summary)
        for name, line in now.items():
            if self._shown.get(name) != line:
                self.tell(line)
        self._shown = now


class TableDisplay(Display):
    """A table on the terminal that changes with the cell."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def tell(self, line: str) -> None:
        self._live.console.print(as_text(line), soft_wrap=True)

    def show(self, summary: Summary) -> None:
        self._live.update(table(summary))


@dataclass(frozen=True)
class UpCommand(CellOptions):
    """Start the services of a cell, show how they do, and stop them on Ctrl-C or after --duration."""

    detach: bool = False
    """Return when all is ready, and leave the cell running."""
    json: bool = False
    """Print one JSON object at the end and nothing else."""

    def execute(self) -> int:
        if self.detach:
            up = detached(self.cell)
            self._warn(up)
            print(f"cell {self.cell!r} is up: see it with `dtwin status`, stop it with `dtwin down`")
            for line in _addresses(up):
                print(line)
            return 0
        with launched(self) as cell:
            self._warn(cell.up)
            with self._display(cell.supervisor) as display:
                cell.await_ready(display.show)
                for line in _addresses(cell.up):
                    display.tell(line)
                while not (cell.over or cell.stop.wait(LOOK)):
                    display.show(cell.supervisor.summary())
                summary = cell.supervisor.summary()
                display.show(summary)
        if self.json:
            print_json(summary)
        return 0

    @contextmanager
    def _display(self, supervisor: Supervisor) -> Iterator[Display]:
        """What shows the cell: a table on a terminal, lines elsewhere, nothing for programs."""
        if self.json:
            yield Display()
            return
        if not sys.stderr.isatty():
            yield Lines()
            return
        from rich.console import Console  # A cell that shows nothing does without.
        from rich.live import Live

        with Live(table(supervisor.summary()), console=Console(stderr=True), refresh_per_second=4) as live:
            yield TableDisplay(live)

    def _warn(self, up: runfile.Up) -> None:
        """Tells the user of open ports, at which places the arm will do no work, and what will have no effect."""
        if up.warning:
            print(printable(f"dtwin: warning: {up.warning}"), file=sys.stderr)
        if self.other is not None:
            return
        settings = self.settings()
        warn_of_places(settings.task, settings.machine.arm(settings.arm))
        for text in of_no_use(settings, math.inf if self.duration is None else self.duration):
            print(printable(f"dtwin: warning: {text}"), file=sys.stderr)


def detached(cell: str, kind: str = "cell") -> runfile.Up:
    """Starts the same command, which shows nothing, in a session of its own and waits until it is ready.

    Args:
        cell: name of the cell or line.
        kind: what it is, in words.

    Raises:
        CommunicationError: it is up already, or does not start.
    """
    words = [word for word in sys.argv[1:] if word not in ("--detach", "--json")]
    output = runfile.output_of(cell)
    if runfile.find(cell) is not None:
        raise CommunicationError(f"{kind} {cell!r} is up already: stop it with `dtwin down`")
    with output.open("wb") as sink:
        command = [sys.executable, "-m", "dtwin", *words, "--json"]
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True
        )
    said = ""
    while process.poll() is None:
        up = runfile.find(cell)
        if up is not None and up.progress != said and not up.ready:
            said = up.progress
            print(printable(f"waits for {said}"), file=sys.stderr, flush=True)
        if up is not None and up.ready:
            return up
        time.sleep(LOOK)
    words_said = output.read_text(errors="replace").strip().splitlines()
    raise CommunicationError(words_said[-1].removeprefix("dtwin: ") if words_said else f"the {kind} did not start")


def _addresses(up: runfile.Up) -> list[str]:
    """Lines that tell where the controller is managed, where others join, and where the cell is shown, if it is."""
    join = f"joins it as the configuration in {up.zenoh} says" if up.zenoh else f"connects to {up.meet}, as a peer"
    lines = [f"the controller's device management is at {up.controller}"] if up.controller else []
    lines.append(f"a Zenoh program {join}")
    lines += [f"the cell is shown at {up.page}", *([] if has_gpu() else [BEHIND])] if up.page else []
    return [*lines, f"its operators' console is at {up.console}"] if up.console else lines


def _line(service: ServiceSummary) -> str:
    """A service in a line: how it is, what it does before it is ready, and what went wrong if anything did."""
    state = f"{service.state}: {service.doing}" if service.doing else service.state
    return f"{state} ({service.last_error})" if service.last_error else state
