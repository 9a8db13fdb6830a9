"""Any serial arm under its function blocks, in the emulation and on its twin, from Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from dtwin.api.arguments import AnyPath, checked
from dtwin.arm.chain import Arm, Friction
from dtwin.arm.model import ArmModel
from dtwin.campaign.spread import Workforce
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import NOMINAL, machine_of
from dtwin.errors import ParameterError
from dtwin.fmu.sources import Subject, Version
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainRun, run
from dtwin.simulation.chain import optimise as search
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange, ArmOutcome

_LIMITS: Final = search.ArmLimits()
_SHORT: Final = 10.0
"""Length of the run whose settings the controller of an FMU gets, s; it has none of its own."""
_ROUND: Final = 60.0
"""Length of the run that a cell is read for, s; a search goes once through its poses, however long that takes."""


@checked
def run_arm(
    arm: AnyPath,
    seconds: float = 60.0,
    *,
    machine: str = "ideal",
    poses: AnyPath | None = None,
    path: AnyPath | None = None,
    sort: AnyPath | None = None,
    seed: int = 0,
    late: int = 0,
) -> ChainRun:
    """Runs an arm under its function blocks, as fast as the machine allows.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        seconds: longest plant time, s; the run ends earlier when nothing is left to do.
        machine: ideal, nominal or a number.
        poses: TOML file of the poses that the arm takes.
        path: CSV file of a path that it follows.
        sort: TOML file of a sorting task; without any of the three it goes through poses that are drawn by the seed.
        seed: number of the generators of noise, boxes and poses.
        late: ticks from a command until it acts.

    Returns:
        The run: t (N,), q, target, command and true (N, n), `score()`, `save(path)` and `measurement()` for
        `identify_chain`.

    Raises:
        DtwinError: a file cannot be used, a value is out of range, or the tool does not reach a point.
    """
    cell = ArmCell(arm=str(arm), machine=machine, poses=_file(poses), path=_file(path), sort=_file(sort), late=late)
    return run(cell.settings(seconds, seed))


@checked
def simulate_arm(
    arm: AnyPath,
    seconds: float = 8.0,
    *,
    pole: float | None = None,
    observer: float | None = None,
    speed: float | None = None,
    payload: float = 0.0,
    poses: AnyPath | None = None,
    path: AnyPath | None = None,
    sort: AnyPath | None = None,
    seed: int = 0,
    late: int = 0,
) -> ArmOutcome:
    """Lets the twin of an arm do its work under its function blocks, with other settings, from its first pose on.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        seconds: plant time, s.
        pole: triple pole of the errors of every joint, rad/s; None for the usual one.
        observer: double pole of the observers, rad/s; None for the usual one.
        speed: speeds of paths in parts of the data sheet's, whose square their accelerations follow; None for 1.
        payload: mass on the tool that the blocks do not know of, kg.
        poses: TOML file of the poses that the arm takes.
        path: CSV file of a path that it follows.
        sort: TOML file of a sorting task; without any of the three it goes through poses that are drawn by the seed.
        seed: number of the generator of poses.
        late: ticks from a command until it acts.

    Returns:
        The work: t (N,), q, target, error and command (N, n), the last in parts of what the drives take, saturated
        (n,), s, stop and reached.

    Raises:
        DtwinError: a file cannot be used, a value is out of range, or the motion is not finite.
    """
    cell = ArmCell(arm=str(arm), poses=_file(poses), path=_file(path), sort=_file(sort), late=late)
    return ArmAtWork(cell, seconds, seed).under(ArmChange(pole, observer, speed, payload))


class ArmAtWork:
    """The twin of an arm that does its work as often as it is asked to, prepared once.

    Args:
        cell: the arm and its work.
        seconds: plant time of the work, s.
        seed: number of the generator of poses.

    Raises:
        DtwinError: a file cannot be used, or a value is out of range.
    """

    def __init__(self, cell: ArmCell, seconds: float, seed: int) -> None:
        self._settings = settings = cell.settings(seconds, seed)
        self._twin = ArmSimulator(settings, ArmModel.of(settings.arm))

    @property
    def arm(self) -> Arm:
        """The arm."""
        return self._settings.arm

    def under(self, change: ArmChange) -> ArmOutcome:
        """Does the work from its first pose on. Raises DtwinError: a value is out of range, or the motion is lost."""
        settings = self._settings
        return self._twin.run(settings.poses.positions[0], change, settings.duration)


@checked
def optimise_arm(
    arm: AnyPath,
    *,
    cost: Mapping[str, float] | None = None,
    arms: int = 2,
    box: tuple[float, float] | None = None,
    saturated: float = _LIMITS.saturated,
    tracking: float = _LIMITS.tracking,
    candidates: int = 1000,
    workers: int | None = 1,
    scheduler: str | None = None,
    poses: AnyPath | None = None,
    path: AnyPath | None = None,
    sort: AnyPath | None = None,
    late: int = 0,
    seed: int = 0,
    between: Callable[[int, float], None] = lambda done, best: None,
) -> search.ArmOptimum:
    """Searches pole, observer and speed of paths of least cost on the twin, as `dtwin optimise --arm` does.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        cost: weights of the terms of the cost: time, tracking, energy and command; None for `{"time": 1.0}`.
        arms: number of machines, drawn from the tolerances, that must keep the limits too.
        box: least and largest mass on the tool that the blocks do not know of, kg; None for none.
        saturated: largest share of the samples with a drive at its limit.
        tracking: largest distance of a joint from its path, rad or m.
        candidates: number of settings to judge.
        workers: number of processes that share the work; None for one for each core, which a script must guard by
            `if __name__ == "__main__"`.
        scheduler: address of a Dask scheduler whose workers share the work instead, such as `"tcp://127.0.0.1:8786"`.
        poses: TOML file of the poses that the arm takes.
        path: CSV file of a path that it follows.
        sort: TOML file of a sorting task; without any of the three it goes through poses that are drawn by the seed.
        late: ticks from a command until it acts.
        seed: number of the generators of poses, machines and candidates.
        between: called after every generation with the number of candidates judged and the least cost.

    Returns:
        The search: best and reference with pole, observer, speed, terms and cost, and the scores of all candidates.

    Raises:
        DtwinError: a file cannot be used, a value is out of range, or the settings in use cannot be compared with.
    """
    cell = ArmCell(arm=str(arm), poses=_file(poses), path=_file(path), sort=_file(sort), late=late)
    objective = search.ArmObjective(
        cell.settings(_ROUND, seed),
        dict(cost or {"time": 1.0}),
        search.ArmLimits(saturated=saturated, tracking=tracking),
        tuple(range(seed + 1, seed + 1 + arms)),
        (0.0,) if box is None else tuple(dict.fromkeys(sorted(box))),
    )
    return search.optimise_arm(
        objective,
        candidates=candidates,
        workforce=Workforce(workers if scheduler is None else None, scheduler),
        seed=seed,
        between=between,
    )


@checked
def write_fmu_arm(
    file: AnyPath,
    arm: AnyPath | None = None,
    subject: Subject = "cell",
    *,
    fmi: Version = "3.0",
    cell_file: AnyPath | None = None,
    machine: str | None = None,
    poses: AnyPath | None = None,
    path: AnyPath | None = None,
    sort: AnyPath | None = None,
) -> None:
    """Writes a model of an arm for other simulators, as `dtwin fmu --arm` does: C, which needs no Python.

    Args:
        file: file to write, *.fmu.
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml); None for that of the cell.
        subject: twin (commands in, positions out), controller (positions in, commands out) or cell (both together).
        fmi: version of FMI, 3.0 or 2.0, both for co-simulation.
        cell_file: cell of another arm that is written if no arm is given: a file (*.toml), or a name of cells/.
        machine: what the arm of twin and cell is: ideal without dry friction, nominal as its file says, or a number
            to draw it by; None for that of the cell, or nominal.
        poses: TOML file of the poses that the arm takes.
        path: CSV file of a path that it follows.
        sort: TOML file of a sorting task; without any of the three it goes through poses that are drawn.

    Raises:
        ParameterError: an argument is unknown or of another kind, there is no arm, its gears yield, or the cell has
            what an FMU cannot have.
        ModelError: the file of the arm or of the cell cannot be used.
        NativeError: there is no C compiler.
        RecordingError: the file cannot be written.
    """
    from dtwin.fmu.chain import write_chain_fmu  # what writes C is loaded when it is needed

    cell = _cell(arm, cell_file)
    if any(each is not None for each in (poses, path, sort)):
        cell = replace(cell, poses=_file(poses), path=_file(path), sort=_file(sort))
    if subject == "twin":
        write_chain_fmu(Path(file), "twin", fmi, _for_fmu(arm_of(cell.arm), machine or cell.machine))
        return
    if cell.late or cell.faults:
        raise ParameterError("late, faults: expected none of them, as an FMU has neither")
    settings = cell.settings(_SHORT)
    real = settings.arm if subject == "controller" else _for_fmu(settings.arm, machine or cell.machine)
    write_chain_fmu(
        Path(file), subject, fmi, real, known=settings.arm, poses=settings.poses, control=settings.control
    )


def _cell(arm: AnyPath | None, cell_file: AnyPath | None) -> ArmCell:
    """The cell of an arm, or that of a file.

    Raises:
        ParameterError: there is neither, or the file is that of the thesis's arm.
    """
    if arm is not None:
        return ArmCell(arm=str(arm), machine=NOMINAL)
    cell = None if cell_file is None else arm_cell_of(str(cell_file))
    if cell is None:
        raise ParameterError("arm: expected an arm, or the cell file of one")
    return cell


def _for_fmu(arm: Arm, machine: str) -> Arm:
    """What an arm really is, without dry friction where it is ideal.

    Raises:
        ParameterError: its gears yield.
    """
    found = machine_of(machine, arm)
    if yielding := [joint.name for joint in found.arm.joints if joint.transmission is not None]:
        raise ParameterError(
            f"`machine` {machine}: the gears of {' and '.join(yielding)} yield, and an FMU takes motor and joint for "
            "one: expected `machine` ideal, or one without gear_stiffness"
        )
    if found.friction:
        return found.arm
    joints = (replace(joint, friction=Friction(joint.friction.viscous)) for joint in found.arm.joints)
    return replace(found.arm, joints=tuple(joints))


def _file(path: AnyPath | None) -> Path | None:
    return None if path is None else Path(path)
