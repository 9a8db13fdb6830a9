"""Command-line options of the emulated cell and of its controller, declared once for all who start one."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path

from dtwin.controller.bounds import check_bounds
from dtwin.controller.proposed import read_settings
from dtwin.controller.settings import USUAL_GAINS, Compensation, ControlSettings
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import is_file, machine_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.errors import ParameterError
from dtwin.parameters import PHYSICS_STEP, ArmParameters, CellJoints, Law, assignment
from dtwin.run.cell_file import CellFile, cell_of
from dtwin.run.cell_file import is_file as is_cell_file
from dtwin.run.settings import CellSettings
from dtwin.task import Task


@dataclass(frozen=True, kw_only=True)
class MachineOption:
    """The machine that an emulated arm is."""

    machine: str = IDEAL.name
    """Machine that the arm is: a name of `dtwin machine list`, a file (*.toml, *.json), or a number to draw it by."""

    def __post_init__(self) -> None:
        if is_file(self.machine):
            # Services are started with the same options, and may be in another folder.
            object.__setattr__(self, "machine", str(Path(self.machine).resolve()))


@dataclass(frozen=True, kw_only=True)
class CellFileOption:
    """The cell in which an arm works."""

    cell_file: str | None = None
    """Cell to take what no other option says from: a file (*.toml), or a name of the folder cells, such as default;
    docs/cells.md explains it."""

    def __post_init__(self) -> None:
        if self.cell_file is not None and is_cell_file(self.cell_file):
            # Services are started with the same options, and may be in another folder.
            object.__setattr__(self, "cell_file", str(Path(self.cell_file).resolve()))

    def cell_of_file(self) -> CellFile:
        """What the file says, or the usual cell without one.

        Raises:
            DtwinError: the file cannot be read, or a value in it is out of range.
        """
        return CellFile() if self.cell_file is None else cell_of(self.cell_file)

    def task(self) -> Task:
        """Where boxes wait, where those of each colour belong, and how they come.

        Raises:
            DtwinError: the file cannot be read, or a value in it is out of range.
        """
        return self.cell_of_file().task


@dataclass(frozen=True, kw_only=True)
class ArmOptions(CellFileOption):
    """The emulated arm, as it is simulated and drawn."""

    machine: str | None = None
    """Machine that the arm is: a name of `dtwin machine list`, a file (*.toml, *.json), or a number to draw it by;
    ideal if not given."""
    set: tuple[str, ...] = ()
    """A parameter of the emulated arm, e.g. m1=0.15; repeatable. The controller's model stays as it is."""
    mjcf: Path = MODEL_FILE
    """MJCF file of the arm, which is simulated with the values of the file. The controller's model stays as it is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.machine is not None and is_file(self.machine):
            object.__setattr__(self, "machine", str(Path(self.machine).resolve()))

    def machine_in_use(self) -> Machine:
        """The machine that the arm is.

        Raises:
            DtwinError: the machine or the file of the cell is unknown or out of range.
        """
        return machine_of(self.cell_of_file().machine if self.machine is None else self.machine)

    def parameters(self) -> ArmParameters:
        """The parameters of the emulated arm.

        Raises:
            ParameterError: a parameter is unknown or out of range.
            ModelError: the file cannot be used.
        """
        arm = ArmParameters()
        if self.mjcf != MODEL_FILE:
            from dtwin.emulation.arm_file import read_arm  # loads MuJoCo, which who starts a cell does without

            arm = read_arm(self.mjcf)
        values = {**dict(self.cell_of_file().arm), **dict(assignment(text) for text in self.set)}
        return arm.with_values(values)

    def made(self) -> ArmParameters:
        """The parameters of the emulated arm with the tolerances of its machine.

        Raises:
            DtwinError: a parameter or the machine is unknown or out of range.
        """
        return self.machine_in_use().arm(self.parameters())


@dataclass(frozen=True, kw_only=True)
class PlantOptions(ArmOptions):
    """The emulated cell: arm, boxes and encoders."""

    seed: int = 0
    """Number of the random generators of boxes and noise; equal seeds give equal logs."""
    noise: float | None = None
    """Encoder noise, rad: amplitude (uniform) or standard deviation (gaussian); 0 if not given."""
    noise_kind: NoiseKind | None = None
    """uniform adds noise * u with u in [0, 1), so it is biased by half of it; gaussian is not biased; uniform if not
    given."""
    fault: tuple[str, ...] = ()
    """TARGET OP VALUE @ START[-END], e.g. K2*=0.1@45 or freeze3@30-40; repeatable, beside those of the cell."""
    step: float = PHYSICS_STEP
    """Physics step, s; the 10 ms period must be a whole multiple of it."""

    def settings(self) -> CellSettings:
        """The cell that the options stand for, under a controller with its usual settings.

        Raises:
            DtwinError: an option is out of range or cannot be read.
        """
        cell = self.cell_of_file()
        return CellSettings(
            seed=self.seed,
            noise=cell.noise if self.noise is None else self.noise,
            noise_kind=self.noise_kind or cell.noise_kind,
            faults=(*cell.faults, *map(parse_fault, self.fault)),
            arm=self.parameters(),
            machine=self.machine_in_use(),
            task=cell.task,
            step=self.step,
            model_file=self.mjcf,
        )


@dataclass(frozen=True, kw_only=True)
class CompensationOptions:
    """What the cascade takes into account of the arm's drives, joints and encoders."""

    delay: float = Compensation().delay
    """Time from a sample until its voltages act, s, 0 to 0.01; of the cascade alone."""
    dead_zone: float = Compensation().dead_zone
    """Voltage lost in every amplifier, V, 0 to 1; the cascade adds it."""
    bandwidth: float = Compensation().bandwidth
    """Double pole of the cascade's observer, rad/s, 10 to 300."""
    friction: CellJoints | None = None
    """Coulomb friction of each joint that the cascade adds, N m, 0 to 5; that of the model if not given."""

    def compensation(self) -> Compensation:
        """What the options say of drives and encoders.

        Raises:
            ParameterError: an option is out of range.
        """
        return Compensation(self.delay, self.dead_zone, self.bandwidth)

    def believed(self, model: ArmParameters) -> ArmParameters:
        """A model with the friction that the options say.

        Raises:
            ParameterError: a friction is out of range.
        """
        return model if self.friction is None else replace(model, coulomb=self.friction)


@dataclass(frozen=True, kw_only=True)
class ControlOptions(CompensationOptions, CellFileOption):
    """What the controller is set to."""

    target_time: float | None = None
    """Duration of every motion, s; 2 if not given."""
    law: Law | None = None
    """Control law, cascade if not given. cascade: position over velocity with an observer, on smooth paths;
    computed_torque: the thesis's, with a held box as a point mass; row_sum: the thesis's form with row sums, without
    damping term and with the box's weight alone."""
    tuned: Path | None = None
    """Record of the arm that `dtwin commission` wrote: the controller takes the settings that it proposes, and no
    other option but the target time."""

    def control(self) -> ControlSettings:
        """The settings of the controller that the options stand for.

        Raises:
            DtwinError: an option is out of range, or the record has no settings that may be used.
        """
        cell = self.cell_of_file()
        target_time = cell.target_time if self.target_time is None else self.target_time
        if self.tuned is not None:
            free = ("tuned", "target_time", "cell_file")
            others = [field for field in fields(ControlOptions) if field.name not in free]
            if given := [field.name for field in others if getattr(self, field.name) != field.default]:
                raise ParameterError(f"--tuned: expected no --{given[0].replace('_', '-')} beside it")
            settings = replace(read_settings(self.tuned), target_time=target_time)
            check_bounds(settings)
            return settings
        law = self.law or cell.law
        settings = ControlSettings(
            target_time,
            cell.gains if cell.gains is not None and law == cell.law else USUAL_GAINS[law],
            law,
            self.believed(ArmParameters()),
            cell.payload,
            compensation=self.compensation(),
        )
        check_bounds(settings)
        return settings
