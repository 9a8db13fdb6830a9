"""`dtwin identify LOG --arm FILE`: any serial arm, from logs of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from dtwin.arm.chain import Arm
from dtwin.arm.file import ArmFile
from dtwin.emulation.chain.overlay import write_mjcf
from dtwin.errors import ParameterError
from dtwin.files import ensure_writable
from dtwin.identification.chain.delay import delays, said_of
from dtwin.identification.chain.gears import gears
from dtwin.identification.chain.gears import said_of as said_of_gears
from dtwin.identification.chain.identify import Identification, Sample
from dtwin.identification.chain.overlay import overlaid, write_urdf
from dtwin.identification.chain.result import as_object, doubts, numbers, write_toml
from dtwin.identification.live.kept import write_beside
from dtwin.measurements.columns import ColumnMap
from dtwin.measurements.page import oddities
from dtwin.measurements.reading import read_measurement
from dtwin.terminal import as_text, print_json, print_table

UNKNOWN = "?"
"""Stands for the mass of a load that is to be found."""


def samples_of(
    arm: Arm, logs: Sequence[Path], loads: Sequence[str], columns: ColumnMap | None
) -> tuple[list[Sample], dict[str, float]]:
    """The measurements with what was held, and the masses that are known.

    Args:
        arm: the arm.
        logs: files.
        loads: what was held, FILE=KG or FILE=?.
        columns: what the columns mean; None for a guess.

    Raises:
        ParameterError: a load is not told so, or of no log.
        RecordingError: a log cannot be read.
    """
    held: dict[str, str] = {}
    masses: dict[str, float] = {}
    names = [str(log) for log in logs]
    for text in loads:
        file, equals, mass = text.rpartition("=")
        if not equals or file not in names:
            raise ParameterError(
                f"--load {text!r}: expected FILE=KG or FILE={UNKNOWN}, FILE one of {', '.join(names)}"
            )
        # Files of one name in several folders are several loads.
        alike = [name for name in names if Path(name).stem == Path(file).stem]
        held[file] = Path(file).stem if len(alike) == 1 else file
        if mass != UNKNOWN:
            masses[held[file]] = _mass(text, mass)
    samples = [Sample(read_measurement(log, columns, arm), held.get(str(log), "")) for log in logs]
    return samples, masses


def _mass(text: str, mass: str) -> float:
    try:
        value = float(mass)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < 1e4:
        raise ParameterError(f"--load {text!r}: expected a mass above 0 kg, or {UNKNOWN}")
    return value


class Written(NamedTuple):
    """Files that an identified arm is written to; None for those that nobody asked for.

    Attributes:
        out: all numbers, *.toml.
        urdf: the description with what was found.
        mjcf: the same as MJCF.
        arm: the file of the arm, *.toml, with its model of the same name beside it.
    """

    out: Path | None = None
    urdf: Path | None = None
    mjcf: Path | None = None
    arm: Path | None = None

    def check(self, model: Path) -> None:
        """Checks that all can be written before anything is estimated.

        Args:
            model: the arm's model file.

        Raises:
            ParameterError: a URDF is asked for of an arm that has none.
            RecordingError: a path cannot be written.
        """
        if self.urdf is not None and model.suffix.lower() != ".urdf":
            raise ParameterError(f"--urdf: expected an arm whose model is a URDF file, got {model}")
        beside = self._beside(model)
        endings = ((self.out, ".toml"), (self.urdf, ".urdf"), (self.mjcf, ".xml"), (self.arm, ".toml"))
        for path, ending in (*endings, (beside, model.suffix.lower())):
            if path is not None:
                ensure_writable(path, ending)
        if self.arm is not None and self.arm == self.out:
            raise ParameterError(f"--arm-out: expected another file than --out, got {self.arm}")
        if beside is not None and beside.resolve() == model.resolve():
            raise ParameterError(f"--arm-out: expected another name than that of the arm's model, got {self.arm}")

    def write(self, found: Identification, known: ArmFile) -> None:
        """Writes what was found.

        Args:
            found: what was found.
            known: what the arm's file says.
        """
        model = known.model
        template = None if model.suffix.lower() == ".urdf" else model
        if self.out is not None:
            write_toml(found, self.out)
        if self.urdf is not None:
            write_urdf(found, model, self.urdf)
        if self.mjcf is not None:
            write_mjcf(overlaid(found), template, self.mjcf)
        if self.arm is not None:
            write_beside(found, known, self.arm)

    def _beside(self, model: Path) -> Path | None:
        return None if self.arm is None else self.arm.with_suffix(model.suffix.lower())


def report(found: Identification, samples: Sequence[Sample], json: bool) -> None:
    """Prints what was found, for people or for programs."""
    odd = [f"{s.measurement.source}: {line}" for s in samples for line in oddities(s.measurement)]
    if json:
        late = {n.name: {"value": n.value, "half": n.half, "told": n.told} for n in delays(found)}
        yielding = [row for gear in gears(found, samples).each for row in (gear.compliance, gear.play)]
        sides = {n.name: {"value": n.value, "half": n.half, "told": n.told} for n in yielding}
        print_json({**as_object(found), "delays": late, "gears": sides, "oddities": odd})
        return
    table = Table("", "value, SI units", "95 % interval")
    rows = list(numbers(found))
    for row in rows:
        if row.told:
            table.add_row(row.name, f"{row.value:.4g}", f"+- {row.half:.2g}")
    print_table(table)
    console = Console(highlight=False, soft_wrap=True)
    for line in [*odd, *found.arm.remarks]:
        console.print(as_text(line))
    console.print(as_text(f"friction: basic, {', '.join(found.groups) or 'nothing else proved itself'}"))
    errors = found.held_out.get(found.groups)
    if errors is not None:
        told = ", ".join(f"{100 * error:.1f} %" for error in errors)
        console.print(as_text(f"effort that is not explained on motion that was held out, by joint: {told}"))
    for line in doubts(found):
        console.print(as_text(line))
    if late_words := said_of(delays(found)):
        console.print(as_text(late_words))
    for line in said_of_gears(gears(found, samples)):
        console.print(as_text(line))
    silent = [row.name for row in rows if not row.told]
    console.print(as_text(f"not told by the data, as it was known: {', '.join(silent) or 'nothing'}"))
