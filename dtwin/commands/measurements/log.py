"""`dtwin log show` and `dtwin log convert`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.table import Table

from dtwin.arm.chain import Arm
from dtwin.files import ensure_writable, replacing
from dtwin.measurements.checks import measurement_of
from dtwin.measurements.columns import map_text, read_map
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.page import HEAD, oddities, page, rows_of, summary
from dtwin.measurements.reading import table_of, understood
from dtwin.measurements.writing import ENDINGS, POSITIONS, write_measurement
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class LogShow:
    """Show what is in a log of any arm, what its columns are taken for, and what is odd.

    The exit status is 1 when something is odd that could not be repaired.
    """

    log: Annotated[Path, tyro.conf.Positional]
    """CSV, Parquet, NPZ, MAT or MCAP file, or the folder of a LeRobot data set or of a rosbag2."""
    columns: Path | None = None
    """TOML file that says what the columns mean; guessed if not given."""
    arm: str | None = None
    """The arm by whose joints and limits the log is checked: a name of arms/, its file (*.toml) or a model (*.urdf,
    *.xml)."""
    tip: str | None = None
    """Last link of the chain (--arm); the end of the longest chain if not given."""
    map: Path | None = None
    """Write what the columns are taken for to this TOML file, to be corrected and given as --columns."""
    page: Path | None = None
    """Write the page to this HTML file."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        for path, ending in ((self.map, ".toml"), (self.page, ".html")):
            if path is not None:
                ensure_writable(path, ending)
        arm = _arm(self.arm, self.tip)
        given = None if self.columns is None else read_map(self.columns)
        table, columns = understood(table_of(self.log, arm), given, arm)
        if self.map is not None:
            with replacing(self.map) as temporary:
                temporary.write_text(map_text(columns), encoding="utf-8")
        found = measurement_of(table, columns, arm)
        if self.page is not None:
            with replacing(self.page) as temporary:
                temporary.write_text(page(found, map_text(columns)), encoding="utf-8")
        if self.json:
            joints_rows = [dict(zip(HEAD, row, strict=True)) for row in rows_of(found)]
            print_json({"summary": summary(found), "joints": joints_rows, "odd": oddities(found)})
        else:
            self._print(found, map_text(columns))
        return 1 if any(not odd.repaired for odd in found.oddities) else 0

    def _print(self, found: Measurement, columns: str) -> None:
        console = Console(highlight=False, soft_wrap=True)
        for line in summary(found):
            console.print(as_text(line))
        table = Table(*HEAD)
        for row in rows_of(found):
            table.add_row(*row)
        print_table(table)
        for line in oddities(found) or ["nothing is odd"]:
            console.print(as_text(line))
        source = "guessed; --map FILE writes it" if self.columns is None else f"as {self.columns} says"
        console.print(as_text(f"columns, {source}:"))
        for line in columns.splitlines():
            console.print(as_text(line))


@dataclass(frozen=True)
class LogConvert:
    """Write a log of any arm as a CSV, Parquet or MCAP file, in SI units, with what could be repaired.

    The columns name their units, so that the file is read without a map. MCAP holds JointState messages of ROS 2 and
    needs the extra rosbag. The exit status is 1 when something is odd that could not be repaired.
    """

    log: Annotated[Path, tyro.conf.Positional]
    """CSV, Parquet, NPZ, MAT or MCAP file, or the folder of a LeRobot data set or of a rosbag2."""
    out: Annotated[Path, tyro.conf.Positional]
    """File to write, which ends in .csv, .parquet or .mcap."""
    columns: Path | None = None
    """TOML file that says what the columns mean; guessed if not given."""
    arm: str | None = None
    """The arm by whose joints and limits the log is checked and named: a name of arms/, its file (*.toml) or a model
    (*.urdf, *.xml)."""
    tip: str | None = None
    """Last link of the chain (--arm); the end of the longest chain if not given."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        ensure_writable(self.out, *ENDINGS)
        arm = _arm(self.arm, self.tip)
        given = None if self.columns is None else read_map(self.columns)
        table, columns = understood(table_of(self.log, arm), given, arm)
        found = measurement_of(table, columns, arm)
        unit = columns.position.unit
        write_measurement(found, self.out, unit if unit in POSITIONS else "m" if unit == "mm" else "rad")
        if self.json:
            print_json({"written": str(self.out), "summary": summary(found), "odd": oddities(found)})
        else:
            console = Console(highlight=False, soft_wrap=True)
            for line in [*summary(found), *oddities(found), f"written: {self.out}"]:
                console.print(as_text(line))
        return 1 if any(not odd.repaired for odd in found.oddities) else 0


def _arm(text: str | None, tip: str | None) -> Arm | None:
    """The arm that --arm stands for; None without it.

    Raises:
        ModelError: there is no such arm, or its files cannot be used.
    """
    if text is None:
        return None
    from dtwin.emulation.chain.arms import arm_of  # loads MuJoCo, which logs without an arm are shown without

    return arm_of(text, tip)
