"""A headless run of any serial arm under its function blocks: from pose to pose, as fast as the machine allows."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, Commanded, holding, servo_torque
from dtwin.arm.effort import effort_of, logged, unladen
from dtwin.arm.poses import Poses, ranges
from dtwin.arm.samples import Samples
from dtwin.arm.sorting import Sorting
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.boxes import Boxes, Counts
from dtwin.emulation.chain.faults import ChainFault
from dtwin.emulation.chain.machine import Machine
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.kinematics import Goal, joints_along, joints_for
from dtwin.equations.rigid import inverse_dynamics, usual_inertia
from dtwin.errors import UnreachableError
from dtwin.files import LOG, replacing
from dtwin.measurements.measurement import Measurement
from dtwin.run.machine_code.chain import MOST, ChainTicks, until

EFFORTS: Final[dict[Commanded, str]] = {
    "torque": "torque",
    "current": "current",
    "voltage": "voltage",
    "position": "torque",
}
"""Names of the columns with the commands."""
GRIPPED: Final = "gripped"
"""Name of the column that says whether the gripper is commanded to be closed."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainSettings:
    """A run.

    Attributes:
        arm: the arm as its controller knows it.
        machine: what it really is.
        poses: what it does.
        control: how it is controlled.
        duration: longest plant time, s; the run ends earlier when all poses have been reached.
        seed: number of the generator of noise.
        late: ticks from a command until it acts.
        start: positions at the beginning, (n,); None for the first pose.
        sorting: boxes that the poses are for (sorting_poses); None without.
        faults: what is otherwise than the machine says, and when.
    """

    arm: Arm
    machine: Machine
    poses: Poses
    control: Control = field(default_factory=Control)
    duration: float = 60.0
    seed: int = 0
    late: int = 0
    start: Array | None = None
    sorting: Sorting | None = None
    faults: tuple[ChainFault, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class ChainRun:
    """What happened, a row for each tick.

    Attributes:
        settings: the run.
        t: times of the samples, (N,), s.
        q: what the encoders read, (N, n).
        target: desired positions, (N, n).
        command: commands, (N, n), in the units of the drives.
        true: true positions, (N, n).
        pose: number of the pose to which the arm went, (N,).
        stop: the safe stop in force at the end, 0 if none.
        seconds: wall time, s.
        gripped: whether the gripper was closed from each sample on, (N,).
        boxes: what happened to the boxes; None without any.
        places: numbers of the places, from 1, of the box that waits and of the one that is held, (N, 2); 0 for none.
    """

    settings: ChainSettings
    t: Array
    q: Array
    target: Array
    command: Array
    true: Array
    pose: Array
    stop: int
    seconds: float
    gripped: NDArray[np.bool_]
    boxes: Counts | None = None
    places: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def error(self) -> Array:
        """How far the arm is from its path, (N, n), rad or m."""
        return self.target - self.true

    @property
    def at_limit(self) -> NDArray[np.bool_]:
        """Whether the drive of each joint was at its limit, (N, n)."""
        limits = np.array([joint.largest / abs(joint.actuator.constant or 1.0) for joint in self.settings.arm.joints])
        asked = self.effort if self.settings.arm.servos else self.command
        reached: NDArray[np.bool_] = np.abs(asked) >= limits * (1.0 - 1e-12)
        return reached

    @property
    def saturated(self) -> Array:
        """Ticks in which the drive of each joint was at its limit, (n,)."""
        ticks: Array = np.sum(self.at_limit, axis=0)
        return ticks

    @property
    def beyond(self) -> Array:
        """How far each joint went beyond its range, (n,), rad or m."""
        lower = np.array([joint.lower for joint in self.settings.arm.joints])
        upper = np.array([joint.upper for joint in self.settings.arm.joints])
        far: Array = np.maximum(0.0, np.maximum(lower - self.true, self.true - upper).max(axis=0))
        return far

    @property
    def effort(self) -> Array:
        """What acts at the times of the samples, (N, n), in the units of the drives, or their loops' torque."""
        return effort_of(self.settings.arm, self.q, self.command, self.settings.late)

    @property
    def unladen(self) -> Array:
        """The same without what acts while the gripper is closed, as nobody knows what it holds: NaN."""
        return unladen(self.effort, self.gripped)

    @property
    def samples(self) -> Samples:
        """What a monitor is told of the run."""
        return Samples(self.t, self.q, self.target, self.unladen, self.effort)

    def measurement(self) -> Measurement:
        """What a log of the run tells: positions, effort, desired positions, and when the gripper was closed."""
        arm = self.settings.arm
        commanded = arm.joints[0].actuator.commanded
        return Measurement(
            source=f"run of {arm.name}",
            joints=tuple(joint.name for joint in arm.joints),
            t=self.t,
            q=self.q,
            effort=self.effort * logged(arm),
            kind="torque" if commanded == "position" else commanded,
            command=self.target,
            gripped=self.gripped,
        )

    def save(self, path: Path | str) -> None:
        """Writes a Parquet log: t, then q_J, target_J, sent_J, and torque_J, current_J or voltage_J for joint J.

        What was sent is the command from the sample on; the effort beside it is what acts at the sample, a torque as
        it is at the joint. The last column, `gripped`, says whether the gripper was commanded to be closed.

        Raises:
            RecordingError: it cannot be written.
        """
        import pyarrow as pa  # loaded for a log alone: services that make the same run of an arm write none
        import pyarrow.parquet as pq

        arm = self.settings.arm
        effort = self.effort * logged(arm)
        columns: dict[str, NDArray[Any]] = {"t": self.t}
        for name, values in (("q", self.q), ("target", self.target), ("sent", self.command)):
            columns |= {f"{name}_{k + 1}": values[:, k] for k in range(len(arm))}
        for k, joint in enumerate(arm.joints):
            columns[f"{EFFORTS.get(joint.actuator.commanded, 'command')}_{k + 1}"] = effort[:, k]
        columns[GRIPPED] = self.gripped
        facts = {"arm": arm.name, "machine": self.settings.machine.name, "seed": str(self.settings.seed)}
        table = pa.table({name: pa.array(values) for name, values in columns.items()}).replace_schema_metadata(facts)
        with replacing(Path(path), LOG) as temporary:
            pq.write_table(table, temporary)

    def score(self) -> dict[str, Any]:
        """The figures of the run, SI units."""
        return {
            "arm": self.settings.arm.name,
            "machine": self.settings.machine.name,
            "duration": float(self.t[-1] + self.settings.arm.period) if len(self.t) else 0.0,
            "wall_seconds": self.seconds,
            "joints": [joint.name for joint in self.settings.arm.joints],
            "tracking_error_max": np.abs(self.error).max(axis=0).tolist(),
            "tracking_error_rms": np.sqrt(np.mean(self.error**2, axis=0)).tolist(),
            "saturated_ticks": self.saturated.astype(int).tolist(),
            "beyond_range": self.beyond.tolist(),
            "poses_reached": len(np.unique(self.pose)),
            "stop": self.stop,
            **({} if self.boxes is None else {"boxes": _box_figures(self.boxes, self.places)}),
        }


def _box_figures(counts: Counts, places: Array) -> dict[str, float]:
    errors = counts.errors or [0.0]
    waiting, held = places[-1] > 0.0 if len(places) else (False, False)
    return {
        "arrived": counts.arrived,
        "picked": counts.picked,
        "missed": counts.missed,
        "delivered": counts.delivered,
        "held": int(held),
        "waiting": int(waiting),
        "within_5_mm": sum(error <= 0.005 for error in counts.errors),
        "placement_error_max": max(errors),
        "placement_error_mean": float(np.mean(errors)),
    }


@dataclass(frozen=True, slots=True, eq=False)
class DesiredPath:
    """A path, in the middle of every tick.

    Attributes:
        q: positions, (N, n), rad or m.
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).
        command: commands for them, (N, n), in the units of the drives; of own loops their torques.
        reached: number of poses that were reached.
    """

    q: Array
    qd: Array
    qdd: Array
    command: Array
    reached: int


def path_of(arm: Arm, poses: Poses, control: Control, longest: float) -> DesiredPath:
    """The path that the blocks lead an arm along that follows it without an error.

    Args:
        arm: the arm.
        poses: what it does, once.
        control: how it is controlled.
        longest: time after which the path is cut off, s.
    """
    controller = ChainController(len(arm), inputs(arm, usual_inertia(arm), control, poses))
    positions = poses.positions[0]
    rows: list[tuple[Array, Array, Array, Array]] = []
    while not controller.done and len(rows) < longest / arm.period:
        commands = controller.step(positions.tolist())
        q, qd, qdd = controller.counted()
        asked = np.array(commands)
        rows.append((q, qd, qdd, servo_torque(arm, asked, q, qd) if arm.servos else asked))
        positions = q + 0.5 * arm.period * (qd + 0.25 * arm.period * qdd)  # from the middle of the tick to its end
    found, speed, change, command = (np.array(column, dtype=np.float64) for column in zip(*rows, strict=True))
    return DesiredPath(found, speed, change, command, controller.pose + controller.done)


def sorting_poses(arm: Arm, task: Sorting, dwell: float = 0.15, tolerance: float = 1e-3) -> Poses:
    """The poses of a sorting task: above, at and again above where boxes wait, then the same for each place.

    Args:
        arm: the arm.
        task: the task.
        dwell: time within the tolerance before the gripper moves, and after, s.
        tolerance: distance of every joint from its pose, rad or m.

    Raises:
        UnreachableError: the tool does not reach a point, or the drives do not hold the heaviest box there; names it.
    """
    lower, upper = ranges(arm)
    near = 0.5 * (lower + upper)
    rows = []
    for name, point in {"pick": task.pick, **task.places}.items():
        try:
            above, at = _above_and_at(arm, task, point, near)
            _check_held(arm, task.mass[1], np.stack([above, at]))
        except UnreachableError as error:
            raise UnreachableError(f"{name}: {error}") from None
        rows += [above, at, above]
        near = above
    return Poses(np.array(rows), dwell, True, len(task.places), tolerance, task.usual)


def _check_held(arm: Arm, mass: float, poses: Array) -> None:
    """Whether the drives hold a box at rest in all poses, (N, n).

    Raises:
        UnreachableError: one of them does not; names it.
    """
    rest = np.zeros_like(poses)
    needed = np.abs(inverse_dynamics(holding(arm, mass), poses, rest, rest)).max(axis=0)
    for joint, most in zip(arm.joints, needed.tolist(), strict=True):
        if most > joint.largest:
            unit = joint.effort_unit
            raise UnreachableError(
                f"the drive of {joint.name} gives {joint.largest:.3g} {unit}, and {most:.3g} {unit} hold a box of "
                f"{mass:.3g} kg there: expected lighter boxes (mass), or another point"
            )


def _above_and_at(arm: Arm, task: Sorting, point: Array, near: Array) -> tuple[Array, Array]:
    """Joint positions above a point, and those at it that a straight line leads to."""
    refused: UnreachableError | None = None
    for above in joints_for(arm, Goal(point + task.height * task.up, task.direction), near):
        try:
            return above, joints_along(arm, Goal(point, task.direction), above)
        except UnreachableError as error:
            refused = refused or error
    assert refused is not None
    raise refused


Beside = Callable[[ChainController, Array, NDArray[np.bool_], int], None]
"""Is called between ticks: with the blocks, with the readings, targets and commands, (3, N, n), and whether the
gripper is closed, (N,), of which only those of the ticks so far are filled, and with the number of these."""


def run(
    settings: ChainSettings,
    between: Callable[[int], bool] | None = None,
    beside: Beside | None = None,
    every: int = 1,
) -> ChainRun:
    """Runs an arm.

    Args:
        settings: the run.
        between: is called between two ticks with the number of ticks done; False ends the run.
        beside: who looks on and may change what the blocks count on.
        every: number of ticks after which that is.

    Raises:
        ModelError: something of the arm is not known that its controller needs.
        DivergenceError: the emulation left the finite numbers.
    """
    began = time.perf_counter()
    arm = settings.arm
    values = inputs(arm, usual_inertia(arm), settings.control, settings.poses)
    controller = ChainController(len(arm), values)
    start = settings.poses.positions[0] if settings.start is None else settings.start
    plant = ChainPlant(settings.machine, start, settings.seed, settings.late, settings.faults)
    ticks = max(1, round(settings.duration / arm.period))
    rows = np.zeros((4, ticks, len(arm)))
    poses, places, gripped = np.zeros(ticks), np.zeros((ticks, 2)), np.zeros(ticks, dtype=bool)
    boxes = None if settings.sorting is None else Boxes(settings.sorting, settings.seed)
    ahead = None if beside is not None and every == 1 else ChainTicks(plant, controller, len(arm), arm.period)
    done = 0
    while done < ticks and not controller.done and (between is None or between(done)):
        box = 0 if boxes is None else boxes.waiting(plant.time)
        passed, answered = 0, False
        if ahead is not None:
            most = MOST if boxes is None else until(plant.time, boxes.next_box, arm.period)
            most = most if beside is None else min(most, every - done % every)
            span, closed = slice(done, min(done + most, ticks)), controller.grips
            passed, answered = ahead.run(rows[:, span], poses[span], box)
            places[done : done + passed] = (0, 0) if boxes is None else boxes.places
            gripped[done : done + passed] = closed
            done += passed
        if passed and not answered:
            if beside is not None and done % every == 0:
                beside(controller, rows[:3], gripped, done)
            continue
        if not answered:
            read = plant.read()
            command = controller.step(read.tolist(), box)
            rows[0, done], rows[1, done] = read, controller.desired()[0]
            rows[2, done], rows[3, done] = command, plant.state[0]
            poses[done] = controller.pose
        if boxes is not None:
            boxes.grip(controller.grips, plant.tool, plant.time)
            plant.hold(boxes.held)
            places[done] = boxes.places
        gripped[done] = controller.grips
        plant.apply(rows[2, done], controller.brakes)
        plant.advance()
        done += 1
        if beside is not None and done % every == 0:
            beside(controller, rows[:3], gripped, done)
    counts = None if boxes is None else boxes.counts
    t: Array = np.arange(done, dtype=np.float64) * arm.period
    seconds = time.perf_counter() - began
    q, target, commands, true = (np.array(row[:done], dtype=np.float64) for row in rows)
    stop = controller.stop
    return ChainRun(
        settings, t, q, target, commands, true, poses[:done], stop, seconds, gripped[:done], counts, places[:done]
    )
