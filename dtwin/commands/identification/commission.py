"""`dtwin commission`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import tyro
from rich.console import Console
from rich.table import Table

from dtwin.api.commissioning import commission, commission_live
from dtwin.commands.cell.chain import THESIS
from dtwin.commands.frame import arguments_as_options
from dtwin.commands.hints import warn
from dtwin.commissioning.words import NINETY_FIVE, load, steps
from dtwin.errors import ParameterError
from dtwin.identification.machine.record import MachineRecord
from dtwin.options import refuse_others
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class Commission:
    """Commission a real arm at its healthy work: sensors, identification, settings of the controller, monitor.

    The work comes from a log, or with --live from a running cell. `dtwin monitor` and `dtwin up --monitoring` take
    the record with --commissioned, `dtwin run` and `dtwin up` take the settings with --tuned.

    It takes two minutes of work with encoder readings, voltages and box_gripped, the longer the better; truth is not
    looked at. What the data do not tell keeps the value and the tolerance of the data sheet. With --out, every stage
    that is done is kept beside that file: the same command goes on where it was interrupted. The exit status is 1
    unless the fit of every joint on motion that was held out is at least 0.98.

    With --arm it takes a log of any other serial arm, and keeps what its drives and encoders show while it is
    healthy, for `dtwin monitor --arm` and `up --arm`. A log whose first half does not foretell its second is refused.
    """

    log: Annotated[Path | None, tyro.conf.Positional] = None
    """Parquet log of ordinary work."""
    arm: str | None = None
    """Another arm, a serial chain of any number of joints: a name of arms/, its file (*.toml), or a model (*.urdf,
    *.xml), whose log `dtwin run --arm` or `up --arm` wrote."""
    live: bool = False
    """Collect the work from a running cell (dtwin up); needs --out. What was collected stays in a folder of its name
    and .data."""
    motion: float = 300.0
    """Plant time of the work from which the arm is identified, s (--live)."""
    watch: float = 600.0
    """Plant time of the work after that on which the monitor is calibrated, s (--live)."""
    excite: bool = False
    """Let the identification service excite the arm once while its motion is collected (--live, dtwin up
    --identification); its own model is not kept."""
    cell: str = "cell"
    """Name of the cell (--live)."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine (--live)."""
    cell_file: str | None = None
    """Cell whose places the arm works at, as for `dtwin up`: a file (*.toml), or a name of the folder cells (--live);
    a log says it itself."""
    known: Path | None = None
    """JSON file with the parameters of the arm as it was designed; the data sheet's arm if not given."""
    out: Path | None = None
    """File that the record is written to, JSON; until then the stages are kept in a folder of its name and .parts."""
    report: Path | None = None
    """Page that the report is written to, HTML."""
    json: bool = False
    """Print the record as one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.arm is not None and self.arm != THESIS:
            return self._of_other_arm(self.arm)
        if (self.log is None) != self.live:
            raise ParameterError("expected either a log or --live")
        if not self.live and self.cell_file is not None:
            raise ParameterError("--cell-file: expected --live beside it, since a log says where its boxes were")
        if self.live and self.out is None:
            raise ParameterError("--live: expected --out, beside which the collected work is kept")
        console = Console(stderr=True, highlight=False)
        with console.status("beginning") as status, arguments_as_options(self):
            shared: Any = {
                "known": self.known,
                "report": self.report,
                "tell": lambda text: console.print(as_text(text)),
                "warn": warn,
                "progress": status.update,
            }
            if self.log is not None:
                found = commission(self.log, out=self.out, **shared)
            else:
                assert self.out is not None
                found = commission_live(
                    self.out,
                    cell=self.cell,
                    motion=self.motion,
                    watch=self.watch,
                    excite=self.excite,
                    zenoh=self.zenoh,
                    cell_file=self.cell_file,
                    **shared,
                )
        if self.json:
            print_json(msgspec.to_builtins(found.record))
        else:
            _print(found.record, [path for path in (self.out, self.report) if path is not None])
        return 0 if found.record.grade == "identified" else 1

    def _of_other_arm(self, arm: str) -> int:
        refuse_others(self, ("log", "arm", "out", "json"))
        if self.log is None:
            raise ParameterError("expected a log, which dtwin run --arm or dtwin up --arm writes with --log")
        from dtwin.commands.identification.commission_arm import print_commissioned  # only other arms need MuJoCo

        return print_commissioned(self.log, arm, self.out, self.json)


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
    for joint, encoder in enumerate(record.sensors.encoders, 1):
        noise = f"noise {1e3 * encoder.noise:.2g} mrad"
        console.print(f"encoder {joint}: step {steps(encoder.step)}, {noise}, {encoder.spikes:.0f} spikes an hour")
    if record.load is not None:
        console.print(load(record.load))
    if record.settings is not None and record.settings.refused:
        console.print(as_text(f"the settings must not be used: {record.settings.refused}"))
    elif record.settings is not None:
        (kp, *_), (ki, *_), (kd, *_) = (getattr(record.settings.control.gains, name) for name in ("kp", "ki", "kd"))
        found = record.settings.places
        console.print(
            f"settings: Kp {kp:.0f}, Ki {ki:.0f}, Kd {kd:.0f}; least margins at the places: disk {found.disk:.2f},"
            f" {found.gain:.1f} dB, {found.phase:.0f} degrees, {found.delay:.2f} ticks"
        )
    for file in files:
        console.print(as_text(f"written to {file}"))
