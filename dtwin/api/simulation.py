"""What if the arm were controlled otherwise: one motion on the twin."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from dtwin.api.arguments import AnyPath, Texts, checked, pairs
from dtwin.api.identification import Identified
from dtwin.api.live import LiveCell
from dtwin.api.monitoring import model_of
from dtwin.api.run import Run, log_of
from dtwin.controller.settings import APPLICATION_LAW, Compensation, ControlSettings, usual_gains
from dtwin.emulation.encoders import NoiseKind
from dtwin.errors import ParameterError
from dtwin.identification.machine.record import read_record
from dtwin.identification.store import STORE
from dtwin.logs.belonging import check_belonging
from dtwin.parameters import ArmParameters, CellJoints, Gains, Law
from dtwin.run.cell_file import cell_of
from dtwin.simulation.candidates import vary as varied
from dtwin.simulation.measured import MotionComparison, compare, find, settings_of
from dtwin.simulation.places import parse_goal, parse_start
from dtwin.simulation.proposal import controllable
from dtwin.simulation.whatif import MotionCase, Outcome, Simulator
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, Task, task_of
from dtwin.twin.effects import NO_EFFECTS, Effects

_COMPENSATION: Final = Compensation()

Model = Identified | ArmParameters | str | Path
"""what `identify` returned, parameters, a file, or a name in a folder of models"""


@checked
def simulate(
    start: str = "pickup",
    goal: str = "red",
    *,
    target_time: float = 2.0,
    law: Law = APPLICATION_LAW,
    gains: Gains | None = None,
    friction: CellJoints | None = None,
    delay: float = _COMPENSATION.delay,
    dead_zone: float = _COMPENSATION.dead_zone,
    bandwidth: float = _COMPENSATION.bandwidth,
    payload: float | None = None,
    box: float | None = None,
    noise: float = 0.0,
    noise_kind: NoiseKind = "uniform",
    seed: int = 0,
    duration: float | None = None,
    set: Texts | Mapping[str, float] = (),
    model: Model | None = None,
    commissioned: AnyPath | None = None,
    controller_model: Model | None = None,
    store: AnyPath = STORE,
    cell_file: AnyPath | None = None,
    live: LiveCell | None = None,
) -> Outcome:
    """Simulates one motion on the analytic twin with the real function blocks, as `dtwin simulate` does.

    Equal arguments give equal motions.

    Args:
        start: where the motion starts: a place (pickup, blue, red, green, or those of the cell file, home, hanging),
            coordinates of the tip
            `"X,Y"` in m, or joint angles `"Q1,Q2,Q3"` in rad.
        goal: where it goes to, in the same forms.
        target_time: duration of the path, s.
        law: control law: cascade, computed_torque or row_sum.
        gains: gains of the control law; None for its usual ones.
        friction: Coulomb friction of each joint that the cascade adds, N m, 0 to 5; None for that of the model.
        delay: time from a sample until its voltages act that the cascade counts on, s, 0 to 0.01.
        dead_zone: voltage lost in every amplifier that the cascade adds, V, 0 to 1.
        bandwidth: double pole of the cascade's observer, rad/s, 10 to 300.
        payload: mass at the tip, kg; None for what the cell carries on this motion.
        box: mass that the controller takes a box to have, kg; None for the middle of those of the cell.
        noise: encoder noise, rad: amplitude (uniform) or standard deviation (gaussian).
        noise_kind: kind of the encoder noise; uniform noise is biased by half of its amplitude.
        seed: number of the random generator of the noise, at least 0.
        duration: how long to look at the motion, s; None for the target time and 2 s more.
        set: parameters of the simulated arm in SI units, `{"D2": 0.1}` or `"D2=0.1"`; the controller's model stays.
        model: identified model that is simulated; None for the data sheet.
        commissioned: record of `dtwin commission` instead of a model: its arm is simulated, with all that it has.
        controller_model: identified model that the controller uses; None for that of `model` or of the record.
        store: folder of the kept models.
        cell_file: cell whose places there are: a file (*.toml), or a name of the folder cells; None for the usual.
        live: what `connect` returned of a cell of `dtwin up --simulation`: the motion starts from the state of its
            arm, with its gains, target time, law and model, and with what it holds if there is no `payload`.

    Raises:
        CommunicationError: the live cell does not answer.
        ParameterError: an argument is unknown, of another kind or out of range, or there is no such place.
        UnreachableError: the coordinates are out of the arm's reach.
        ModelError: there is no such model.
        DivergenceError: the motion has left the finite numbers.
    """
    task = DEFAULT_TASK if cell_file is None else cell_of(str(cell_file)).task
    simulated = simulated_arm(model, commissioned, store)
    believed = arm_of_model(controller_model, store, simulated.believed)
    control = ControlSettings(
        target_time,
        gains or usual_gains(law),
        law,
        believed if friction is None else replace(believed, coulomb=friction),
        task.boxes.middle if box is None else box,
        compensation=Compensation(delay, dead_zone, bandwidth),
    )
    case = motion_case(start, goal, control, simulated.arm, payload, task)
    disturbed = replace(case, noise=noise, noise_kind=noise_kind, seed=seed, duration=duration)
    case = simulated.put_into(disturbed, set)
    if live is not None:
        own = model is not None or commissioned is not None or bool(set)
        case = _from_live(live, case, goal, task, payload, own)
    return simulator_of(task).run(case)


@checked
def vary(outcome: Outcome, changes: str, *, cell_file: AnyPath | None = None) -> Outcome:
    """Simulates a motion again with something changed, as `dtwin simulate --candidate` does.

    Args:
        outcome: what `simulate` returned.
        changes: changes such as `"T=1.5 kp=300,600,400 D2=0.1 law=row_sum"`; "" for none.
        cell_file: cell of the motion, as for `simulate`.

    Raises:
        ParameterError: a name is unknown, or a value is of the wrong kind or out of range.
        DivergenceError: the motion has left the finite numbers.
    """
    task = DEFAULT_TASK if cell_file is None else cell_of(str(cell_file)).task
    return simulator_of(task).run(varied(outcome.case, changes))


@checked
def simulate_log(
    log: AnyPath | Run,
    at: float = 0.0,
    *,
    payload: float | None = None,
    set: Texts | Mapping[str, float] = (),
    model: Model | None = None,
    commissioned: AnyPath | None = None,
    store: AnyPath = STORE,
) -> MotionComparison:
    """Predicts a motion of a log from its first sample on, with the log's settings, as `dtwin simulate --log` does.

    Args:
        log: a run, or the Parquet file of one.
        at: plant time from which the first motion of the log is taken, s.
        payload: mass at the tip while a box is carried, kg; None for what the controller counts on.
        set: parameters of the simulated arm in SI units, `{"D2": 0.1}` or `"D2=0.1"`.
        model: identified model that is simulated; None for that of the controller.
        commissioned: record of `dtwin commission` instead of a model: its arm is simulated, with all that it has.
        store: folder of the kept models.

    Returns:
        The motion, its figures, what was predicted, and how well that fits (1 is perfect), by joint.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range, or there is no such motion.
        RecordingError: the file is no log, or what is in it does not belong together.
        ModelError: there is no such model.
    """
    rows = log_of(log)
    check_belonging(log.source if isinstance(log, Run) else str(log), rows, ArmParameters())
    settings = settings_of(rows)
    simulated = simulated_arm(model, commissioned, store, settings.model)
    arm = simulated.arm.with_values(pairs(set))
    mass = settings.payload if payload is None else payload
    simulator = simulator_of(task_of(rows.metadata))
    return compare(rows, find(rows, at), settings, arm, mass, simulator, simulated.effects)


def motion_case(
    start: str,
    goal: str,
    control: ControlSettings,
    arm: ArmParameters,
    payload: float | None,
    task: Task = DEFAULT_TASK,
) -> MotionCase:
    """A motion from place to place, as texts tell them.

    Args:
        start: place, coordinates or angles.
        goal: place, coordinates or angles.
        control: settings of the function blocks.
        arm: arm that the places are of.
        payload: mass at the tip, kg; None for what the cell carries: a box from the pickup place to that of a colour.
        task: task of the cell.

    Raises:
        ParameterError: a text has none of the forms, or there is no such place.
        UnreachableError: the coordinates are out of reach.
    """
    theta = parse_start(start, arm, task)
    if payload is None:
        payload = control.payload if start == PICKUP_NAME and goal in task.colours else 0.0
    return MotionCase(parse_goal(goal, arm, theta, task), control, theta, arm=arm, payload=payload)


def _from_live(
    live: LiveCell, case: MotionCase, goal: str, task: Task, payload: float | None, own: bool
) -> MotionCase:
    """A case from where the arm of a running cell is and how fast it is.

    Args:
        live: the cell.
        case: the case from a place.
        goal: where it goes to.
        task: task of the cell.
        payload: mass at the tip, kg; None for what the arm holds.
        own: whether the case has an arm of its own; else it is that of the controller's model.
    """
    state, now = live.arm_state(), live.settings()
    settings = replace(case.settings, gains=now.gains, target_time=now.target_time, law=now.law, model=now.model)
    arm = case.arm if own else now.model
    mass = payload if payload is not None else settings.payload if state.holds_box else 0.0
    return replace(
        case,
        goal=parse_goal(goal, arm, state.theta, task),
        settings=settings,
        theta=state.theta,
        omega=state.omega,
        arm=arm,
        payload=mass,
    )


@dataclass(frozen=True, slots=True)
class SimulatedArm:
    """The arm that the twin is.

    Attributes:
        arm: its parameters.
        effects: what it has beside them.
        believed: the arm that a controller believes in if nothing else is said.
    """

    arm: ArmParameters
    effects: Effects
    believed: ArmParameters

    def put_into(self, case: MotionCase, assignments: Texts | Mapping[str, float]) -> MotionCase:
        """A motion of this arm with parameters assigned, by name or as NAME=NUMBER.

        Raises:
            ParameterError: a name or number is wrong.
        """
        return replace(case, arm=self.arm.with_values(pairs(assignments)), effects=self.effects)


def simulated_arm(
    model: Model | None,
    commissioned: AnyPath | None,
    store: AnyPath,
    otherwise: ArmParameters | None = None,
) -> SimulatedArm:
    """The arm that is simulated.

    Args:
        model: identified model.
        commissioned: record of `dtwin commission` instead of a model.
        store: folder of the kept models.
        otherwise: the arm if neither is given; None for the data sheet's.

    Raises:
        ParameterError: model and record are given.
        ModelError: there is no such model or record.
    """
    if commissioned is None:
        arm = arm_of_model(model, store, ArmParameters() if otherwise is None else otherwise)
        return SimulatedArm(arm, NO_EFFECTS, arm)
    if model is not None:
        raise ParameterError("commissioned: expected no `model` beside it")
    record = read_record(Path(commissioned))
    return SimulatedArm(record.arm, record.effects, controllable(record))


@functools.cache
def simulator_of(task: Task) -> Simulator:
    """The simulator of this process, made once: making the blocks takes longer than using them."""
    return Simulator(task=task)


def arm_of_model(model: Model | None, store: AnyPath, otherwise: ArmParameters) -> ArmParameters:
    """The arm of a model, however it is named; another one if there is none.

    Raises:
        ModelError: there is no such model, or its file is damaged.
    """
    if model is None:
        return otherwise
    return model if isinstance(model, ArmParameters) else model_of(model, store).arm
