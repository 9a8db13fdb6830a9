"""`dtwin commission`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from dtwin.files import ensure_writable
from dtwin.identification.machine.judged import identify_machine, record_of
from dtwin.identification.machine.record import MachineRecord, write_record
from dtwin.monitoring.calibration import watched
from dtwin.monitoring.offline import stream
from dtwin.parameters import ArmParameters, load_arm
from dtwin.run.recording import read_log
from dtwin.terminal import as_text, print_json, print_table

_NINETY_FIVE: Final = 1.959964


@dataclass(frozen=True)
class Commission:
    """Identify a real arm from a log of its healthy work: parameters, drives, friction, structure and encoders.

    The monitor is calibrated on the same log, the longer the better: `dtwin monitor` and `dtwin up --monitoring` take
    the record with `--commissioned`.

    The log needs two minutes of work with encoder readings, voltages and box_gripped; truth is not looked at. What
    the data do not tell keeps the value and the tolerance of the data sheet. The exit status is 1 unless the fit of
    every joint on motion that was held out is at least 0.98.
    """

    log: tyro.conf.Positional[Path]
    """Parquet log of ordinary work."""
    known: Path | None = None
    """JSON file with the parameters of the arm as it was designed; the data sheet's arm if not given."""
    out: Path | None = None
    """File that the record is written to, JSON."""
    json: bool = False
    """Print the record as one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.out is not None:
            ensure_writable(self.out)
        arm = load_arm(self.known) if self.known is not None else ArmParameters()
        log = read_log(self.log)
        began = time.perf_counter()
        with Console(stderr=True).status("fitting the motion") as status:
            judged = identify_machine(log, arm, status.update)
            record = watched(record_of(judged, arm, str(self.log)), stream(log), status.update)
        if self.out is not None:
            write_record(record, self.out)
        if self.json:
            print_json(msgspec.to_builtins(record))
        else:
            _print(record, time.perf_counter() - began, self.out)
        return 0 if record.grade == "identified" else 1


def _print(record: MachineRecord, seconds: float, file: Path | None) -> None:
    table = Table("", "identified", "95 % interval", "data sheet", "its interval")
    for name, number in record.numbers.items():
        if number.deviation:
            table.add_row(
                name,
                f"{number.value:.4g}" if number.told else "not told",
                f"+- {_NINETY_FIVE * number.deviation:.2g}" if number.told else "",
                f"{number.expected:.4g}",
                f"+- {_NINETY_FIVE * number.tolerance:.2g}",
            )
    print_table(table)
    console = Console(highlight=False, soft_wrap=True)
    fits = ", ".join(f"{value:.4f}" for value in record.fit)
    console.print(f"{record.grade}: fit on held-out motion {fits}; {record.segments} segments, {seconds:.0f} s")
    for remark in record.remarks:
        console.print(as_text(remark))
    if file is not None:
        console.print(as_text(f"written to {file}"))
