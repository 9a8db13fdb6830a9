"""`dtwin identify live`: the operator's side of the identification service."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from dtwin.bus.messages import DECIDE, IDENTIFY
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import DataSource, IdentificationDecision, IdentificationRequest, IdentificationState
from dtwin.errors import CommunicationError, IdentificationError
from dtwin.identification.estimation.estimate import NINETY_FIVE
from dtwin.names import check_name
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.services.runfile import join
from dtwin.terminal import as_text, print_json, print_table, printable

_LOOK = 0.2
"""s between two looks at the progress"""


@dataclass(frozen=True, kw_only=True)
class IdentifyLive:
    """Identify the arm of a running cell, excited or at work; the model is shown, then kept or not.

    The cell must have been started with `dtwin up --identification`. The exit status is 1 when no model is kept.
    """

    free: str = IdentificationRequest().free
    """What to estimate; without a known load something must set the scale of the forces: by default K1."""
    box_mass: float | None = None
    """Mass that a box in the gripper is taken to have, kg; the middle of the cell's boxes if not given."""
    source: DataSource = "signal"
    """signal: the blocks excite the arm; motion: the arm goes on working, and its motions with an empty gripper tell
    what of the known model (dtwin up --model) has changed. Another arm than the thesis's is identified whole from its
    motion, without --free and --anew."""
    since: float = 0.0
    """Plant time from which on motion counts, s; the service remembers one minute."""
    anew: str = ""
    """Which of the free parameters are not known any more, e.g. --free D --anew D2; all if not given. For motion."""
    accept: bool = False
    """Keep the model without asking, unless it is in doubt."""
    anyway: bool = False
    """Keep an accepted model even if it is in doubt; it says so."""
    upload: bool = False
    """Upload an accepted model to the controller, too. Needs dtwin up --simulation."""
    name: str = "arm"
    """Name to keep the model under."""
    timeout: float = 60.0
    """Time to wait for the model, s."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""
    json: bool = False
    """Print one JSON object on standard output and nothing else; without --accept the model is rejected."""

    def execute(self) -> int:
        check_name(self.name, "model name")
        with join(self.cell, self.zenoh) as bus:
            request = IdentificationRequest(self.free, self.box_mass, self.source, self.since, self.anew)
            bus.ask(IDENTIFY, request, IdentificationState)
            state = self._wait(bus)
            if state.phase == "refused":
                raise IdentificationError(state.text)
            if not self.json:
                _print(state)
            decision = IdentificationDecision(self._accepts(state), self.name, self.upload, self.anyway)
            state = bus.ask(DECIDE, decision, IdentificationState)
        if self.json:
            print_json(state)
        else:
            Console().print(as_text(state.text))
        return 0 if state.phase == "accepted" else 1

    def _wait(self, bus: Bus) -> IdentificationState:
        deadline = time.monotonic() + self.timeout
        columns = (TextColumn("{task.description}", markup=False), BarColumn())
        with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
            task = bar.add_task("asking", total=None)
            while time.monotonic() < deadline:
                state = bus.ask(IDENTIFY, None, IdentificationState)
                if state.phase in ("proposed", "refused"):
                    return state
                bar.update(task, description=printable(state.text), completed=state.samples, total=state.of or None)
                time.sleep(_LOOK)
        raise CommunicationError(f"no model within {self.timeout:g} s; the identification goes on")

    def _accepts(self, state: IdentificationState) -> bool:
        if state.doubts and not self.anyway:
            if not self.json:
                Console().print("not kept: --anyway keeps it all the same")
            return False
        if self.accept or self.json:
            return self.accept
        if not sys.stdin.isatty():
            Console().print("not kept, as nobody can be asked here: --accept keeps it")
            return False
        return input("keep this model? [y/N] ").strip().lower() in ("y", "yes")


def _print(state: IdentificationState) -> None:
    table = Table("", "estimate", "95 % interval", "data sheet")
    sheet = ArmParameters()
    for name, estimated in state.parameters.items():
        half = NINETY_FIVE * estimated.standard_error
        known = f"{sheet.get(name):.6g}" if name in PARAMETER_NAMES else ""
        table.add_row(as_text(name), f"{estimated.value:.6g}", f"+- {half:.2g}", known)
    console = Console()
    print_table(table)
    console.print(as_text(state.text))
    fits = ", ".join(f"{value:.4f}" for value in state.fit or ())
    console.print(f"fit on held-out motion {fits}", highlight=False)
    if state.parameters.keys() <= set(PARAMETER_NAMES):  # of another arm they are not looked at
        white = "white" if state.residual_white else "not white: the model leaves something unexplained"
        console.print(f"residuals {white}")
    if state.doubts:
        console.print(f"[bold red]Do not use this model: {state.doubts}.[/]", soft_wrap=True)
