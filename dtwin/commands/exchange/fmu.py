"""`dtwin fmu twin`, `controller` and `cell`: models for other simulators, with C inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import tyro

from dtwin.commands.cell.chain import THESIS
from dtwin.commands.exchange.chain import write_arm
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.fmu.archive import write_fmu
from dtwin.fmu.sources import Subject, Version
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.parameters import ArmParameters, assignment
from dtwin.run.options import ControlOptions
from dtwin.terminal import printable


@dataclass(frozen=True, kw_only=True)
class _Fmu:
    """What the commands share."""

    subject: ClassVar[Subject]

    file: tyro.conf.Positional[Path]
    """File to write, OUT.fmu."""
    fmi: Version = "3.0"
    """Version of FMI, both for co-simulation."""
    store: Path = STORE
    """Folder of the kept models."""
    arm: str = THESIS
    """Another arm: a name of arms/, its file (*.toml), which may be one that was identified, or a model (*.urdf,
    *.xml)."""

    def execute(self) -> int:
        if not write_arm(self):
            write_fmu(self.file, self.subject, self.fmi, self.simulated(), self.settings())
        print(printable(str(self.file)))
        return 0

    def simulated(self) -> ArmParameters:
        """The arm that is simulated at first."""
        return ArmParameters()

    def settings(self) -> ControlSettings:
        """The settings of the controller at first."""
        return ControlSettings()

    def known(self, reference: str | None) -> ArmParameters | None:
        """The arm of an identified model: a file or a name in the store."""
        return None if reference is None else open_model(reference, ModelStore(self.store)).arm


@dataclass(frozen=True, kw_only=True)
class _Arm(_Fmu):
    """What the commands share whose model has an arm."""

    model: str | None = None
    """Identified model with whose parameters the arm starts: a file or a name in --store; the data sheet if not
    given."""
    set: tuple[str, ...] = ()
    """A parameter with which the arm starts, e.g. D2=0.1 or mu1=0.02; repeatable."""
    machine: str | None = None
    """What the arm of --arm is: ideal without dry friction, nominal as its file says, which is the usual one, or a
    number to draw it by."""

    def simulated(self) -> ArmParameters:
        return (self.known(self.model) or ArmParameters()).with_values(dict(map(assignment, self.set)))


@dataclass(frozen=True, kw_only=True)
class _Controlled(ControlOptions, _Fmu):
    """What the commands share whose model has a controller."""

    controller_model: str | None = None
    """Identified model of the controller: a file or a name in --store."""
    poses: Path | None = None
    """TOML file of the poses that the arm of --arm takes; some that are drawn if not given (docs/arms.md)."""
    path: Path | None = None
    """CSV file of a path that the arm of --arm follows (docs/arms.md)."""
    sort: Path | None = None
    """TOML file of a sorting task for the arm of --arm (docs/arms.md)."""

    def settings(self) -> ControlSettings:
        """The settings of the controller at first.

        Raises:
            ParameterError: the cell is another one than the usual one.
        """
        if self.cell_file is not None:
            raise ParameterError(f"--cell-file {self.cell_file}: expected none, as an FMU has the usual places")
        settings, known = self.control(), self.known(self.controller_model)
        return settings if known is None else replace(settings, model=self.believed(known))


@dataclass(frozen=True, kw_only=True)
class FmuTwin(_Arm):
    """Write the analytic twin as an FMU: voltages in, angles out.

    The file holds a binary for this machine and all sources in C; nothing of it needs Python. docs/fmu.md explains
    its variables. The options say with what values the parameters start.
    """

    subject = "twin"


@dataclass(frozen=True, kw_only=True)
class FmuController(_Controlled):
    """Write the control application as an FMU: a sample in, voltages out, every 10 ms.

    The file holds a binary for this machine and all sources in C; nothing of it needs Python. docs/fmu.md explains
    its variables. The options say with what values the parameters start.
    """

    subject = "controller"


@dataclass(frozen=True, kw_only=True)
class FmuCell(_Controlled, _Arm):
    """Write the arm under its control application as an FMU.

    The file holds a binary for this machine and all sources in C; nothing of it needs Python. docs/fmu.md explains
    its variables. The options say with what values the parameters start.
    """

    subject = "cell"
