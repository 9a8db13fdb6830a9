"""The emulated cell as an object that runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from dtwin.api.arguments import AnyPath, Texts, checked, texts
from dtwin.api.run import Run, RunError
from dtwin.controller.bounds import check_bounds
from dtwin.controller.ports import BLOCKS
from dtwin.controller.settings import Compensation
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.encoders import NoiseKind
from dtwin.errors import DtwinError, ParameterError
from dtwin.fmu.sources import Subject, Version
from dtwin.parameters import PHYSICS_STEP, CellJoints, Gains, Law
from dtwin.run import cell
from dtwin.run.hidden import HiddenLog
from dtwin.run.options import ControlOptions, PlantOptions
from dtwin.run.settings import CellSettings


class Cell:
    """The emulated arm that sorts boxes under its function blocks.

    Arguments have the names, units and defaults of the options of `dtwin run`. Equal arguments give equal runs, byte
    by byte.

    Args:
        cell_file: cell to take what no other argument says from: a file (*.toml), or a name of the folder cells;
            None for the usual cell.
        machine: machine that the arm is: a name of `dtwin machine list`, a file (*.toml, *.json), or a number to draw
            it by; None for that of the cell, ideal.
        set: parameters of the emulated arm in SI units, `{"m1": 0.15}` or `"m1=0.15"`; the controller's model stays.
        mjcf: MJCF file of the arm, which is simulated with the values of the file.
        seed: number of the random generators of boxes and noise, at least 0.
        noise: encoder noise, rad: amplitude (uniform) or standard deviation (gaussian); None for that of the cell,
            which is 0 unless its file says otherwise.
        noise_kind: uniform adds noise * u with u in [0, 1), so it is biased by half of it; gaussian is not biased;
            None for that of the cell, uniform.
        fault: faults, each TARGET OP VALUE @ START[-END], such as `"K2*=0.1@45"`; times in s.
        step: physics step, s; the 10 ms period must be a whole multiple of it.
        target_time: duration of every motion, s; None for that of the cell, 2.
        law: control law: cascade, computed_torque or row_sum; None for that of the cell, cascade.
        gains: gains of the control law; None for those of the cell, or the usual ones of the law.
        friction: Coulomb friction of each joint that the cascade adds, N m, 0 to 5; None for that of the model.
        delay: time from a sample until its voltages act that the cascade counts on, s, 0 to 0.01.
        dead_zone: voltage lost in every amplifier that the cascade adds, V, 0 to 1.
        bandwidth: double pole of the cascade's observer, rad/s, 10 to 300.
        tuned: record of the arm that `dtwin commission` wrote: the controller takes the settings that it proposes.
        blocks: folder of the function-block library.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        DtwinError: a file, machine or fault cannot be used.
    """

    @checked
    def __init__(
        self,
        *,
        cell_file: AnyPath | None = None,
        machine: str | int | Path | None = None,
        set: Texts | Mapping[str, float] = (),
        mjcf: AnyPath = MODEL_FILE,
        seed: int = 0,
        noise: float | None = None,
        noise_kind: NoiseKind | None = None,
        fault: Texts = (),
        step: float = PHYSICS_STEP,
        target_time: float | None = None,
        law: Law | None = None,
        gains: Gains | None = None,
        friction: CellJoints | None = None,
        delay: float = Compensation().delay,
        dead_zone: float = Compensation().dead_zone,
        bandwidth: float = Compensation().bandwidth,
        tuned: AnyPath | None = None,
        blocks: AnyPath = BLOCKS,
    ) -> None:
        file = None if cell_file is None else str(cell_file)
        plant = PlantOptions(
            cell_file=file,
            machine=None if machine is None else str(machine),
            set=assignments(set),
            mjcf=Path(mjcf),
            seed=seed,
            noise=noise,
            noise_kind=noise_kind,
            fault=texts(fault),
            step=step,
        )
        control = ControlOptions(
            cell_file=file,
            target_time=target_time,
            law=law,
            friction=friction,
            delay=delay,
            dead_zone=dead_zone,
            bandwidth=bandwidth,
            tuned=None if tuned is None else Path(tuned),
        ).control()
        if gains is not None:
            if tuned is not None:
                raise ParameterError("tuned: expected no gains beside it")
            control = replace(control, gains=gains)
            check_bounds(control)
        self._settings = replace(plant.settings(), control=control, blocks=Path(blocks))

    @property
    def settings(self) -> CellSettings:
        """What the arguments stand for, frozen; its duration does not count."""
        return self._settings

    @checked
    def run(
        self,
        seconds: float = 120.0,
        *,
        realtime: bool = False,
        between: Callable[[int], bool] | None = None,
    ) -> Run:
        """Runs the cell from its first tick on, as fast as the machine allows.

        Args:
            seconds: plant time to run, s, at least 0.01.
            realtime: whether to run no faster than the wall clock.
            between: called with the number of ticks done after every second of plant time; False ends the run.

        Raises:
            RunError: the run failed on its way; it holds the run until then.
            DtwinError: the seconds, the seed, the noise or the step are out of range, or the model or the function
                blocks cannot be used.
        """
        settings = replace(self._settings, duration=seconds)
        hidden = None if settings.machine.ideal else HiddenLog()
        return finished(cell.Cell(settings, hidden=hidden), between, realtime)

    @checked
    def write_fmu(self, path: AnyPath, subject: Subject = "cell", *, fmi: Version = "3.0") -> None:
        """Writes a model of this cell for other simulators, as `dtwin fmu` does: C, which needs no Python.

        Parameters of arm and controller start with those of the cell; its machine, noise and faults do not count.

        Args:
            path: file to write, *.fmu.
            subject: twin (voltages in, angles out), controller (a sample in, voltages out) or cell (both together).
            fmi: version of FMI, 3.0 or 2.0, both for co-simulation.

        Raises:
            ParameterError: an argument is unknown or of another kind.
            NativeError: there is no C compiler, or FMI has no name for this machine.
            RecordingError: the file cannot be written.
        """
        from dtwin.fmu.archive import write_fmu  # what writes C is loaded when it is needed

        write_fmu(Path(path), subject, fmi, self._settings.arm, self._settings.control)


def finished(running: cell.Cell, between: Callable[[int], bool] | None = None, realtime: bool = False) -> Run:
    """What comes of a prepared run.

    Args:
        running: the run before its first tick.
        between: called with the number of ticks done after every second of plant time; False ends the run.
        realtime: whether to run no faster than the wall clock.

    Raises:
        RunError: the run failed on its way; it holds the run until then.
    """
    failure: DtwinError | None = None
    try:
        running.run(between, realtime)
    except DtwinError as error:
        failure = error
    log = running.log.freeze()
    run = Run(log, running.settings.model_file, running.summary(log), running.hidden)
    if failure is not None:
        raise RunError(str(failure), run) from failure
    return run


def assignments(given: Texts | Mapping[str, float]) -> tuple[str, ...]:
    """Parameters as texts, NAME=NUMBER."""
    return tuple(f"{name}={value!r}" for name, value in given.items()) if isinstance(given, Mapping) else texts(given)
