"""The emulated cell behind one interface: read a sample, apply a command, advance."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.boxes import NO_DELIVERIES, Box, Boxes, Deliveries
from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.contact.boxes import ContactBoxes
from dtwin.emulation.encoders import Encoders, NoiseKind
from dtwin.emulation.faults import NEVER, PADS, Condition, Fault, FaultSchedule, due_step, parse_fault
from dtwin.emulation.generators import check_seed
from dtwin.emulation.hidden import Hidden
from dtwin.emulation.machine.encoding import encoding_of
from dtwin.emulation.machine.plant import MachinePlant, plant_of
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.emulation.stands import check_task
from dtwin.emulation.states import EmulationState as EmulationState
from dtwin.emulation.states import Free as Free
from dtwin.errors import FaultError, ParameterError
from dtwin.parameters import (
    HANGING,
    PERIOD,
    PHYSICS_STEP,
    ArmParameters,
    GripperParameters,
    JointVector,
)
from dtwin.signals import NO_COLOUR, BoxCounts, DriveVector, Event, EventKind, Sensors, Truth, Voltages
from dtwin.task import DEFAULT_TASK, Task

_EXACT = np.full((1000, 4), -0.0)
"""No errors of encoders, rad: what is added to an angle without changing it, not even the sign of 0."""


class Emulation:
    """Plant, encoders, boxes and faults of one run that starts at rest with the gripper open.

    Changes (faults, arrivals) happen at the end of the `advance` that reaches their time. Two cells with equal
    arguments, given equal commands, are equal to the bit; noise and faults do not alter the boxes.

    Args:
        parameters: parameters that the healthy arm was made to; those of the data sheet when None.
        machine: what the arm has beside its parameters, and how far it is from them.
        gripper: parameters of the gripper; those of the data sheet when None.
        noise: magnitude N of the encoder noise, rad.
        noise_kind: "uniform" (mean N/2), "gaussian" (standard deviation N) or "none".
        seed: number of the random generators of boxes and noise.
        faults: changes that happen at their times.
        theta: joint angles at the start, rad.
        model_file: MJCF file of the plant.
        step: integration step, s.
        task: what boxes come, and where they belong.
        deliveries: boxes that others bring (`bring`), in place of those that come by themselves.

    Raises:
        ModelError: the model file cannot be used.
        ParameterError: an argument is out of range.
    """

    def __init__(
        self,
        *,
        parameters: ArmParameters | None = None,
        machine: Machine = IDEAL,
        gripper: GripperParameters | None = None,
        noise: float = 0.0,
        noise_kind: NoiseKind = "uniform",
        seed: int = 0,
        faults: Iterable[Fault] = (),
        theta: JointVector = HANGING,
        model_file: Path = MODEL_FILE,
        step: float = PHYSICS_STEP,
        task: Task = DEFAULT_TASK,
        deliveries: Deliveries | None = None,
    ) -> None:
        check_seed(seed)
        if not all(map(math.isfinite, theta)):
            raise ParameterError(f"start angles: expected three finite numbers, got {theta}")
        made = machine.arm(parameters or ArmParameters())
        gripper = gripper or GripperParameters()
        box_seed, noise_seed, machine_seed = np.random.SeedSequence(seed).spawn(3)
        self._condition = Condition(made)
        self._contact = contact = machine.contact
        if task != DEFAULT_TASK:
            check_task(task, model_file, contact.enabled)
        self._schedule = FaultSchedule(made, task.boxes.lightest, self._possible(faults), step)
        bodies = Bodies(contact) if contact.enabled else None
        self._plant = plant_of(machine, parameters, gripper, model_file, step, bodies)
        stream = np.random.default_rng(box_seed)
        if bodies and deliveries:
            raise ParameterError("deliveries: expected a machine without contact")
        self._boxes = (
            ContactBoxes(stream, bodies, self._plant.tip, task)
            if bodies
            else Boxes(stream, gripper, task, deliveries)
        )
        encoding = encoding_of(machine, np.random.default_rng(machine_seed))
        self._encoders = Encoders(noise_kind, noise, np.random.default_rng(noise_seed), encoding)
        self._plant.reset(theta)
        self._events: list[Event] = []
        self._gripped = False
        self._commanded: DriveVector = (0.0, 0.0, 0.0, 0.0)
        self._sequence = 0
        self._due = NEVER
        self._change_due()
        self._sample()

    @property
    def gripped(self) -> bool:
        """Whether the last command said that the box is held."""
        return self._gripped

    @property
    def box_counts(self) -> BoxCounts:
        """What became of the boxes so far."""
        return self._boxes.counts

    @property
    def placement_errors_mm(self) -> tuple[float, ...]:
        """Distance of every delivered box from its place, mm."""
        return self._boxes.placement_errors_mm

    def check_period(self, period: float) -> None:
        """Checks that the cell can be advanced by a period (s).

        Raises:
            ParameterError: the period is not a whole multiple of the integration step.
        """
        self._plant.whole_steps(period)

    def read(self) -> Sensors:
        """The sample that encoders and box sensor give now."""
        return self._sensors

    def apply(self, voltages: Voltages) -> None:
        """Sets the voltages until the next command; a change of box_gripped picks a box or lets it go.

        Raises:
            DivergenceError: a voltage is not finite or far beyond all limits.
        """
        self._plant.check(voltages.volts)
        volts = self._commanded if self._condition.late else voltages.volts
        self._commanded = voltages.volts
        self._plant.apply(self._condition.arriving(volts))
        if voltages.box_gripped != self._gripped:
            self._gripped = voltages.box_gripped
            self._change_grip()

    def advance(self, period: float) -> None:
        """Lets the cell run for a period (s).

        Raises:
            ParameterError: the period is not a whole multiple of the integration step.
            DivergenceError: the state is no longer finite.
        """
        self._plant.advance(period)
        self._sequence += 1
        if self._plant.steps >= self._due:
            self._change_due()
        if self._contact.enabled:
            self._observe()
        self._sample()

    def free(self, ticks: int) -> Free | None:
        """What somebody needs to move the plant for some ticks while nothing happens; None if more than MuJoCo moves
        it, or more than noise is in the readings.

        The errors may be those of fewer ticks.
        """
        condition, stepping = self._condition, self._plant.stepping()
        if stepping is None or condition.late or condition.cut or condition.supply != 1.0:
            return None
        errors = self._encoders.errors(ticks)
        if errors is None:
            return None
        plant = self._plant
        substeps, rate = plant.whole_steps(PERIOD), plant.rate
        added = np.array(errors) if errors else _EXACT[:ticks]
        return Free(*stepping, substeps, plant.steps, self._due, rate, plant.payload, plant.limits, added)

    def adopt_ticks(self, ticks: int, last: NDArray[np.float64]) -> None:
        """Goes on where somebody has moved the plant to with what `free` gave.

        Args:
            ticks: number of ticks, at least 1, in none of which something happened but in the last.
            last: (19,), row of the log of the last of them.
        """
        _, *numbers = last.tolist()
        self._encoders.skip(ticks - 1, [*numbers[6:9], numbers[16]])
        v1, v2, v3, v4 = numbers[12:16]
        self._commanded = (v1, v2, v3, v4)
        self._plant.note_steps(ticks * self._plant.whole_steps(PERIOD))
        self._sequence += ticks
        if self._plant.steps >= self._due:
            self._change_due()
        self._sample()

    def bring(self, box: Box | None) -> None:
        """Brings a box to the pickup point at the end of the next tick, or takes away the one that waits (None).

        Raises:
            ParameterError: boxes come by themselves.
        """
        if isinstance(self._boxes, ContactBoxes):
            raise ParameterError(NO_DELIVERIES)
        self._boxes.bring(round(100 * self._plant.time) + 1, box)
        self._due = min(self._due, self._steps_to(self._boxes.next_arrival))

    def disturb(self, torques: JointVector) -> None:
        """Pushes the joints with torques (N m) from outside until the next call, beside the pushes of faults."""
        self._plant.set_push(tuple(a + b for a, b in zip(self._condition.push, torques, strict=True)))

    def truth(self) -> Truth:
        """The true state of the plant, as opposed to what the sensors say."""
        plant = self._plant
        return Truth(plant.time, plant.theta, plant.omega, plant.gripper, plant.payload)

    def hidden(self) -> Hidden:
        """What no sensor tells, at the time of `truth`."""
        drives = self._plant.drives() if isinstance(self._plant, MachinePlant) else None
        touch = self._boxes.touch() if isinstance(self._boxes, ContactBoxes) else None
        return Hidden(drives, touch)

    def drain_events(self) -> list[Event]:
        """The events since the last call, in order of time."""
        events, self._events = self._events, []
        return events

    def inject(self, faults: Iterable[Fault]) -> tuple[Fault, ...]:
        """Adds faults to a running cell; those that would begin in the past begin in the next tick.

        Returns:
            The faults with the times at which they begin and end.

        Raises:
            FaultError: a fault has ended already, or the faults together make a parameter or the payload impossible.
        """
        plant = self._plant
        added = self._schedule.add(self._possible(faults), plant.time, plant.steps)
        self._due = min(self._due, self._schedule.next_step)
        return added

    def state(self) -> EmulationState:
        """All that the further course depends on, but for the events that nobody has asked for yet."""
        return EmulationState(
            self._sensors,
            self._gripped,
            tuple(map(str, self._schedule.faults)),
            self._plant.state(),
            self._encoders.state(),
            self._boxes.state(),
            self._boxes.bodies() if isinstance(self._boxes, ContactBoxes) else None,
            self._commanded,
        )

    def restore(self, state: EmulationState) -> None:
        """Goes on where a cell of the same settings and seed was, equal to the bit; there are no events yet.

        Raises:
            DtwinError: the state is that of a cell with other settings.
        """
        condition = self._schedule.restore(tuple(map(parse_fault, state.faults)), state.plant.steps)
        if (state.bodies is not None) != self._contact.enabled:
            raise ParameterError(
                "state of the cell: expected one of a cell that is like this one with or without contact"
            )
        if isinstance(self._boxes, ContactBoxes) and state.bodies is not None:
            self._boxes.restore(state.boxes, state.bodies)
        elif isinstance(self._boxes, Boxes):
            self._boxes.restore(state.boxes)
        self._enter(condition)
        self._load()
        self._encoders.restore(state.encoders)
        # Last, because a lock stops its joint, which moves by a rounding error once it is locked.
        self._plant.restore(state.plant)
        self._commanded = state.commanded
        self._gripped, self._sensors, self._sequence = state.gripped, state.sensors, state.sensors.sequence
        self._events = []
        self._find_due()

    def _sample(self) -> None:
        time = self._plant.time
        *theta, gripper = self._encoders.measure(self._plant.sampled, time)
        waiting = self._boxes.waiting
        self._sensors = Sensors(
            self._sequence,
            time,
            tuple(theta),
            gripper,
            waiting is not None,
            waiting.colour if waiting else NO_COLOUR,
        )

    def _change_due(self) -> None:
        """Carries out all changes whose time has come and finds when the next one is due."""
        steps = self._plant.steps
        while (change := self._schedule.take_due(steps)) is not None:
            self._events += (Event(self._plant.time, EventKind.FAULT, text) for text in change.texts)
            self._enter(change.condition)
            if change.slips:
                self._record(self._boxes.slip(self._plant.time))
            self._load()
        while self._steps_to(self._boxes.next_arrival) <= steps:
            self._record(self._boxes.arrive(self._plant.time))
        self._find_due()

    def _find_due(self) -> None:
        """Finds the step at which the next change is due."""
        self._due = min(self._schedule.next_step, self._steps_to(self._boxes.next_arrival))

    def _possible(self, faults: Iterable[Fault]) -> tuple[Fault, ...]:
        """The faults, all of which this cell can have."""
        found = tuple(faults)
        for fault in found:
            if fault.target == PADS and not self._contact.enabled:
                raise FaultError(f"fault {fault}: the pads have friction in a cell with contact only")
        return found

    def _observe(self) -> None:
        """Reads from the bodies what became of the boxes."""
        before = self._boxes.held
        self._events += self._boxes.observe(self._plant.time)
        if self._boxes.held is not before:
            self._load()

    def _enter(self, condition: Condition) -> None:
        self._plant.set_parameters(condition.parameters)
        self._plant.set_locked(condition.locked)
        self._plant.set_push(condition.push)
        self._encoders.set_faults(condition.encoders)
        if isinstance(self._boxes, ContactBoxes):
            self._boxes.set_pad_friction(condition.pad_friction(self._contact.pad_friction))
        self._condition = condition

    def _change_grip(self) -> None:
        plant = self._plant
        if self._gripped:
            self._record(self._boxes.grip(plant.time, plant.tip(), plant.gripper))
        else:
            self._record(self._boxes.release(plant.time, plant.tip()))
        self._load()

    def _load(self) -> None:
        box = self._boxes.held
        self._plant.set_payload(self._condition.payload(box.mass) if box else 0.0)

    def _record(self, event: Event | None) -> None:
        if event:
            self._events.append(event)

    def _steps_to(self, time: float) -> int:
        return due_step(time, self._plant.step)
