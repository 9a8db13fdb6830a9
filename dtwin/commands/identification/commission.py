"""`dtwin commission`."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from dtwin import __version__
from dtwin.commissioning.procedure import commission
from dtwin.commissioning.stages import Stages
from dtwin.commissioning.words import NINETY_FIVE
from dtwin.errors import RecordingError
from dtwin.files import ensure_writable, reason_of, replacing
from dtwin.identification.machine.record import MachineRecord, write_record
from dtwin.parameters import ArmParameters, load_arm
from dtwin.run.recording import read_log
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class Commission:
    """Commission a real arm from a log of its healthy work: sensors, parameters, drives, friction, structure.

    The monitor is calibrated on the same log, the longer the better: `dtwin monitor` and `dtwin up --monitoring` take
    the record with `--commissioned`.

    The log needs two minutes of work with encoder readings, voltages and box_gripped; truth is not looked at. What
    the data do not tell keeps the value and the tolerance of the data sheet. With --out, what is done is kept beside
    that file: the same command goes on where it was interrupted. The exit status is 1 unless the fit of every joint
    on motion that was held out is at least 0.98.
    """

    log: tyro.conf.Positional[Path]
    """Parquet log of ordinary work."""
    known: Path | None = None
    """JSON file with the parameters of the arm as it was designed; the data sheet's arm if not given."""
    out: Path | None = None
    """File that the record is written to, JSON; until then the stages are kept in a folder of its name and .parts."""
    report: Path | None = None
    """Page that the report is written to, HTML."""
    json: bool = False
    """Print the record as one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        for path in (self.out, self.report):
            if path is not None:
                ensure_writable(path)
        arm = load_arm(self.known) if self.known is not None else ArmParameters()
        log = read_log(self.log)
        folder = None if self.out is None else self.out.with_name(f"{self.out.name}.parts")
        console = Console(stderr=True, highlight=False)
        with console.status("reading the log") as status:
            inputs = msgspec.json.encode([__version__, str(self.log), _digest(self.log), arm]).decode()
            stages = Stages(folder, inputs, lambda text: console.print(as_text(text)))
            found = commission(stages, log, lambda: log, arm, str(self.log), status.update)
            if self.out is not None:
                write_record(found.record, self.out)
            if self.report is not None:
                from dtwin.commissioning.page import report  # Matplotlib takes half a second to load.

                status.update("drawing the report")
                with replacing(self.report) as temporary:
                    temporary.write_text(report(found), encoding="utf-8")
        stages.discard()
        if self.json:
            print_json(msgspec.to_builtins(found.record))
        else:
            _print(found.record, [path for path in (self.out, self.report) if path is not None])
        return 0 if found.record.grade == "identified" else 1


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None


def _print(record: MachineRecord, files: list[Path]) -> None:
    table = Table("", "identified", "95 % interval", "data sheet", "its interval")
    for name, number in record.numbers.items():
        if number.deviation:
            table.add_row(
                name,
                f"{number.value:.4g}" if number.told else "not told",
                f"+- {NINETY_FIVE * number.deviation:.2g}" if number.told else "",
                f"{number.expected:.4g}",
                f"+- {NINETY_FIVE * number.tolerance:.2g}",
            )
    print_table(table)
    console = Console(highlight=False, soft_wrap=True)
    fits = ", ".join(f"{value:.4f}" for value in record.fit)
    console.print(f"{record.grade}: fit on held-out motion {fits}; {record.segments} segments")
    for remark in record.remarks:
        console.print(as_text(remark))
    for file in files:
        console.print(as_text(f"written to {file}"))
