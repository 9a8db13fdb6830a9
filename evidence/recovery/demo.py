"""`dtwin demo recovery`: a fault found and answered over the services."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption, at_least, progress_bar
from dtwin.files import LOG, PICTURE, RECORDING, ensure_writable
from dtwin.run.options import MachineOption
from dtwin.services.emulator import Pace
from dtwin.services.launch import CellOptions
from dtwin.terminal import as_text, print_json, print_table
from evidence.recovery.cases import RecoveryCase
from evidence.recovery.demonstration import LIMIT, LONGEST, parse_faults, recover
from evidence.recovery.outcome import Recovery, fault_text
from evidence.recovery.picture import draw


@dataclass(frozen=True)
class DemoRecovery(JsonOption, MachineOption):
    """Make a fault while the cell works; its services find it, and the operator answers it as a table says.

    A cell with all services is started, and stopped at the end. The exit status is 1 unless every run gets the right
    answer within 60 s of plant time: the arm tracks as well as the healthy one, at its target time or at a longer
    one, or it stands with its box held and a person is told what to do, where physics allows no more.
    """

    seed: int = 0
    """Number of the first run's random generators of boxes, noise and fault; each further run takes the next one."""
    runs: int = 1
    """Number of runs."""
    fault: tuple[str, ...] = ()
    """Fault as `dtwin run --fault` takes it, without its time: K2*=0.8, freeze2, slip; repeatable, or several with
    commas between them, which begin together. Without it the friction of a joint grows, which the seed draws."""
    noise: float = 0.002
    """Magnitude of the encoder noise, rad, uniform."""
    pace: Pace = "lockstep"
    """Pace of the cell: lockstep (as fast as every tick has its answer), realtime, or free (no tick waits)."""
    controller: str = "embedded"
    """Controller of the cell: embedded, or forte://HOST:PORT, the 4diac FORTE to deploy to."""
    commissioned: Path | None = None
    """Record of `dtwin commission --out` of this arm, from which it is known; without it the arm is identified first,
    an ideal one by an experiment, any other one from its work."""
    record: Path | None = None
    """File for a recording of the first run for the Rerun viewer, with the time line among its events."""
    log: Path | None = None
    """File for the Parquet log of the first run."""
    plot: Path | None = None
    """Draw the first run's distance from the path, with the time line, to this PNG file."""

    def execute(self) -> int:
        at_least("--runs", self.runs, 1)
        at_least("--seed", self.seed, 0)
        parse_faults(self.fault)
        for path, ending in ((self.record, RECORDING), (self.log, LOG), (self.plot, PICTURE)):
            if path is not None:
                ensure_writable(path, ending)
        runs = [self._run(seed) for seed in range(self.seed, self.seed + self.runs)]
        if self.plot is not None:
            draw(runs[0], self.plot)
        if self.json:
            recovered = sum(run.succeeded for run in runs)
            print_json({"recovered": recovered, "runs": [_as_json(run) for run in runs]})
        else:
            _print(runs)
        return 0 if all(run.succeeded for run in runs) else 1

    def _run(self, seed: int) -> Recovery:
        first = seed == self.seed
        options = CellOptions(
            controller=self.controller,
            pace=self.pace,
            seed=seed,
            noise=self.noise,
            machine=self.machine,
            commissioned=self.commissioned,
            log=self.log if first else None,
            record=self.record if first else None,
            cell=f"recovery-{os.getpid()}",
        )
        faults = parse_faults(self.fault)
        case = RecoveryCase(faults) if faults else None
        with progress_bar(f"seed {seed}") as progress:
            return recover(options, case, lambda time: progress(round(time), round(LONGEST + LIMIT)))


def _as_json(run: Recovery) -> dict[str, Any]:
    story = run.story
    return {
        "seed": run.seed,
        "fault": fault_text(run),
        "fault_s": story.fault,
        "found": [
            {
                "parameter": unit.parameter,
                "cause": unit.cause,
                "size": unit.size,
                "detected_after_s": _since(unit.detected, run),
            }
            for unit in story.findings
        ],
        "answers": [
            {
                "measure": step.measure,
                "parameters": step.parameters,
                "after_s": _since(step.time, run),
                "values": step.taken.values,
            }
            for step in story.steps
        ],
        "expected": sorted(run.expected.measures),
        "right": run.right,
        "outcome": run.outcome,
        "works": run.works,
        "box_lost": run.box_lost,
        "voltage_jump_v": run.jump,
        "usual_voltage_jump_v": run.usual_jump,
        "uploaded_after_s": _since(story.uploaded, run),
        "recovered_after_s": _since(run.recovered, run),
        "recovered": run.succeeded,
        "trouble": story.trouble,
        "motions": [
            {
                "after_s": _since(one.motion.stop, run),
                "way": one.motion.way,
                "carries": one.motion.carries,
                "error_rad": one.motion.error,
                "healthy_rad": one.healthy,
            }
            for one in run.motions
        ],
        "moments": [{"time": m.time, "who": m.who, "text": m.text} for m in run.moments],
    }


def _print(runs: Sequence[Recovery]) -> None:
    console = Console()
    first = runs[0]
    lines = Table("since the fault", "who", "what", title=f"time line of seed {first.seed}")
    for moment in first.moments:
        lines.add_row(_after(moment.time, first), as_text(moment.who), as_text(moment.text))
    print_table(lines)
    table = Table("seed", "fault", "noticed", "named", "answer", "recovered", "worst since", "")
    for run in runs:
        findings = run.story.findings
        since = [one.ratio for one in run.motions if run.recovered is not None and one.motion.stop >= run.recovered]
        table.add_row(
            str(run.seed),
            as_text(fault_text(run)),
            _after(findings[0].detected if findings else None, run),
            as_text(", ".join(unit.parameter for unit in findings)),
            as_text(", ".join(step.measure for step in run.story.steps)),
            _after(run.recovered, run),
            f"{100 * max(since):.0f} %" if since else "",
            f"[green]{run.outcome}[/]" if run.succeeded else f"[bold red]{_wrong(run)}[/]",
        )
    print_table(table)
    console.print(
        "Times since the fault; worst: distance from the path in any motion since, 100 % is the healthy arm's."
    )
    for run in runs:
        if run.story.trouble:
            console.print(as_text(f"seed {run.seed}: {run.story.trouble}"))


def _wrong(run: Recovery) -> str:
    if not run.right:
        return f"WRONG ANSWER, expected {', '.join(sorted(run.expected.measures))}"
    return "BOX LOST" if run.box_lost else "NOT RECOVERED"


def _since(time: float | None, run: Recovery) -> float | None:
    return None if time is None or run.story.fault is None else time - run.story.fault


def _after(time: float | None, run: Recovery) -> str:
    seconds = _since(time, run)
    return "never" if seconds is None else f"{seconds:.2f} s"
