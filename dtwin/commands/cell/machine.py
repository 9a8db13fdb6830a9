"""`dtwin machine ...`: what the emulated arm has beside its equations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.emulation.machine.files import machine_of, names, toml
from dtwin.emulation.machine.sections import IDEAL
from dtwin.files import ensure_writable, replacing
from dtwin.run.settings import described
from dtwin.terminal import as_text, print_json, print_table, printable


@dataclass(frozen=True)
class MachineList(JsonOption):
    """List the named machines and what each has; every number is a machine too."""

    def execute(self) -> int:
        machines = [machine_of(name) for name in names()]
        if self.json:
            print_json([described(machine) for machine in machines])
            return 0
        table = Table("machine", "section", "what it has beside the ideal machine")
        for machine in machines:
            rows = [(section, ", ".join(found)) for section, found in machine.effects().items()] or [("", "")]
            for k, (section, found) in enumerate(rows):
                name = "" if k else machine.name
                table.add_row(as_text(name), section, as_text(found), end_section=k == len(rows) - 1)
        print_table(table)
        return 0


@dataclass(frozen=True)
class MachineShow(JsonOption):
    """Show a machine as TOML, or as JSON with --json; saved to a file, either is the same machine again."""

    machine: tyro.conf.Positional[str] = IDEAL.name
    """Name, file or number of the machine."""

    def execute(self) -> int:
        machine = machine_of(self.machine)
        if self.json:
            print_json(described(machine))
        else:
            for line in toml(machine).splitlines():
                print(printable(line))
        return 0


@dataclass(frozen=True)
class MachineDraw:
    """Write the machine of a number, drawn from the tolerances of servo arms, to a file."""

    number: Annotated[int, tyro.conf.Positional]
    """Number of the machine: the same number is the same machine everywhere."""
    out: Path | None = None
    """TOML file to write, machine-NUMBER.toml if not given."""

    def execute(self) -> int:
        from dtwin.emulation.machine.drawing import draw  # numpy's generators are loaded for drawn machines alone

        machine = draw(self.number)
        path = self.out or Path(f"machine-{self.number}.toml")
        ensure_writable(path, ".toml")
        with replacing(path) as temporary:
            temporary.write_text(toml(machine))
        print(printable(f"{path}: machine {machine.name}, for dtwin run --machine {path}"))
        return 0
