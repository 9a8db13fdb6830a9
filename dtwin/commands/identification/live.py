"""`dtwin identify live`: the operator's side of the identification service."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn
from rich.table import Table

from dtwin.api.live import LiveCell, connect
from dtwin.bus.twin_messages import DataSource, IdentificationRequest, IdentificationState
from dtwin.identification.estimation.estimate import NINETY_FIVE
from dtwin.names import check_name
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.terminal import as_text, print_json, print_table, printable


@dataclass(frozen=True, kw_only=True)
class IdentifyLive:
    """Identify the arm of a running cell, excited or at work; the model is shown, then kept or not.

    The cell must have been started with `dtwin up --identification`. The exit status is 1 when no model is kept.
    """

    free: str = IdentificationRequest().free
    """What to estimate; without a known load something must set the scale of the forces: by default K1."""
    box_mass: float | None = None
    """Mass that a box in the gripper is taken to have, kg; the middle of the cell's boxes if not given."""
    source: DataSource = "usual"
    """signal: the blocks excite the arm; motion: the arm goes on working, and its motions with an empty gripper tell
    what of the known model (dtwin up --model) has changed. Another arm than the thesis's is identified whole from its
    motion, without --free and --anew. usual: the signal, and motion for such an arm."""
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
        with connect(self.cell, zenoh=self.zenoh) as cell:
            state = self._identified(cell)
            if not self.json:
                _print(state)
            state = cell.decide(self._accepts(state), name=self.name, upload=self.upload, anyway=self.anyway)
        if self.json:
            print_json(state)
        else:
            Console().print(as_text(state.text))
        return 0 if state.phase == "accepted" else 1

    def _identified(self, cell: LiveCell) -> IdentificationState:
        columns = (TextColumn("{task.description}", markup=False), BarColumn())
        with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
            task = bar.add_task("asking", total=None)

            def progress(state: IdentificationState) -> None:
                bar.update(task, description=printable(state.text), completed=state.samples, total=state.of or None)

            return cell.identify(
                free=self.free,
                box_mass=self.box_mass,
                source=self.source,
                since=self.since,
                anew=self.anew,
                patience=self.timeout,
                progress=progress,
            )

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
