"""A cell whose arm is the twin with the numbers of a drawn machine: days of work in minutes.

The plant is `dtwin.twin.cell_loop`, not the emulation: rigid gears without play, nothing that touches, boxes as
masses at the tip. Sequence and control are the function blocks. So that the arm is not what the monitor believes,
torques act on it that no effect of its model has (EXTRA_NAMES), beside amplifiers and encoders of finite resolution
and samples that are lost.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import EMULATOR, PATH, STOP, VERDICT
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.boxes import Boxes
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import DivergenceError, NativeError
from dtwin.logs.log import COLUMNS, Log
from dtwin.parameters import (
    HANGING,
    JOINTS,
    PERIOD,
    VOLTAGE_LIMIT,
    ArmParameters,
    GripperParameters,
    joint_vector,
)
from dtwin.signals import NO_COLOUR, BoxCounts
from dtwin.task import DEFAULT_TASK
from dtwin.twin.cell_loop import DIVERGED, Course, Device, Disturbed, State, work
from dtwin.twin.closed_loop import Blocks
from dtwin.twin.effects import Effects
from dtwin.twin.kinematics import forward
from dtwin.twin.machine import MACHINE_NAMES, machine_of_vector
from evidence.identification.strangers import truth_of
from iec61499.native.resource import NativeResource

Array = NDArray[np.float64]

STRANGE: Final = {"sine": 1e-3, "cosine": 1e-3, "direction": 1e-3, "speed": 1e-4, "voltage": 1e-4}
"""Largest factors of the torques that no effect of the model has, N m, N m s^2/rad^2 and N m/V^2."""
_ROUNDING: Final = 1e-6
"""Share of a tick by which a time may be rounded."""


class _Readings:
    """What an encoder adds to angles, and which samples are lost.

    Args:
        deviation: standard deviation of the noise, rad.
        loss: probability that a sample is lost.
        errors, losses: generators of both.

    Attributes:
        deviation, loss: the same.
    """

    def __init__(
        self, deviation: float, loss: float, errors: np.random.Generator, losses: np.random.Generator
    ) -> None:
        self.deviation, self.loss = deviation, loss
        self._errors, self._losses = errors, losses

    def draw(self, count: int) -> tuple[Array, NDArray[np.bool_]]:
        """Noise (N, 3), rad, and whether the sample is lost, (N,), of the next ticks."""
        noise = self.deviation * self._errors.standard_normal((count, 3))
        return noise, self._losses.random(count) < self.loss


class _Blocks:
    """The function blocks in machine code, and where a kernel finds what it needs of them.

    Args:
        control: settings of the controller.

    Attributes:
        resource: the blocks.
        verdicts: the block that takes verdicts.
        stop: gives the stop in force.

    Raises:
        NativeError: there is no machine code.
    """

    def __init__(self, control: ControlSettings) -> None:
        resource = EmbeddedController(control).resource
        if not isinstance(resource, NativeResource):
            raise NativeError("a cell of the twin: expected a controller in machine code")
        self.resource, self._server = resource, resource.server(EMULATOR.block)
        function, memory = resource.function(f"exchange__{EMULATOR.block}"), resource.numbers()
        places, answer = np.array([resource.offset(name) // 8 for name in PATH]), np.zeros(40, np.uint8)
        self._arrays = Blocks(function, resource.address, np.zeros(0, np.uint8), answer, memory, places)
        self.verdicts, self.stop = resource.server(VERDICT.block), resource.reader((STOP,))

    def told(self, present: bool, colour: str) -> Blocks:
        """What a kernel needs of them while a box waits or not."""
        request = self._server.requests([(0.0, 0.0, 0.0, 0.0, present, colour)])[0]
        return self._arrays._replace(request=request)


class TwinCell:
    """A cell at work.

    Args:
        number: number that its machine is drawn by.
        seed: number of the random generators of boxes and noise.
        control: settings of the controller.

    Attributes:
        arm: parameters of the arm as it was made.
        ticks: number of ticks so far.

    Raises:
        NativeError: machine code cannot be made here.
    """

    def __init__(self, number: int, seed: int, control: ControlSettings) -> None:
        machine, gripper = machine_of(str(number)), GripperParameters()
        drawn = np.random.default_rng([number, 1])
        values = truth_of(machine, ArmParameters())
        for name, most in STRANGE.items():
            values |= {f"{name}{joint}": drawn.uniform(-most, most) for joint in (1, 2, 3)}
        vector = np.array([values[name] for name in MACHINE_NAMES])
        self.arm = machine.arm(ArmParameters())
        sensing, bits = machine.sensing, machine.drive.bits
        quantum = math.tau / 2**sensing.bits if sensing.bits else 0.0
        resolution = np.array([2.0 * VOLTAGE_LIMIT / 2**bits if bits else 0.0, quantum])
        boxes, errors, losses = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(3))
        self._readings = _Readings(sensing.noise, sensing.loss_rate * PERIOD, errors, losses)
        self._boxes = Boxes(boxes, gripper, DEFAULT_TASK)
        self._blocks = _Blocks(control)
        jaw = np.array([gripper.inertia, gripper.damping, gripper.voltage_constant, gripper.closed, gripper.opened])
        self._device = Device(vector, resolution, jaw)
        self._state = State(
            arm=np.array([*HANGING, 0.0, 0.0, 0.0]),
            commands=np.zeros((math.floor(values["delay"] / PERIOD) + 2, 3)),
            acting=np.full(3, np.nan),
            fingers=np.array([gripper.opened, 0.0]),
        )
        self._last, self._held = np.array([*HANGING, gripper.opened]), False
        self.ticks = 0

    @property
    def effects(self) -> Effects:
        """What the twin knows of the machine beside the parameters of its arm."""
        return machine_of_vector(self._device.p)[1]

    @property
    def box_counts(self) -> BoxCounts:
        """What became of the boxes so far."""
        return self._boxes.counts

    @property
    def stopped(self) -> bool:
        """Whether the function blocks have stopped the arm."""
        return bool(self._blocks.stop()[0])

    def release(self) -> None:
        """Lets a stopped arm go on, as an operator does."""
        self._blocks.verdicts.exchange((0, 1.0, True))

    def run(self, seconds: float) -> Log:
        """Works on for a time (s), and gives what sensors and commands said.

        Raises:
            DivergenceError: the state of the arm is no longer finite.
            FunctionBlockError: a block failed.
        """
        count = round(seconds / PERIOD)
        measured, path, volts = np.empty((count + 1, 4)), np.empty((count, 3)), np.empty((count, 4))
        gripped, present = np.empty(count, dtype=bool), np.empty(count, dtype=bool)
        colours = np.empty(count, dtype="U16")
        noise, lost = self._readings.draw(count)
        blocks = self._blocks
        measured[0] = self._last
        done = 0
        while done < count:
            while self._tick_of(self._boxes.next_arrival) <= self.ticks:
                self._boxes.arrive(self.ticks * PERIOD)
            waiting = self._boxes.waiting
            colour = waiting.colour if waiting else NO_COLOUR
            part = slice(done, min(count, done + self._tick_of(self._boxes.next_arrival) - self.ticks))
            made, problem = work(
                blocks.told(waiting is not None, colour),
                self._device,
                self._boxes.held.mass if self._boxes.held else 0.0,
                Disturbed(noise[part], lost[part]),
                self.ticks > 0,
                self._state,
                Course(measured[done : part.stop + 1], path[part], volts[part], gripped[part]),
            )
            if problem == DIVERGED:
                raise DivergenceError("cell of the twin", self.ticks * PERIOD, self._state.arm)
            blocks.resource.check(problem, EMULATOR.block)
            now = slice(done, done + made)
            present[now], colours[now] = waiting is not None, colour
            done, self.ticks = done + made, self.ticks + made
            if bool(gripped[done - 1]) != self._held:
                self._grip(bool(gripped[done - 1]))
        self._last = measured[-1]
        times = PERIOD * np.arange(self.ticks - count, self.ticks, dtype=np.float64)
        return _log(times, measured[1:], path, volts, present, colours, gripped)

    def _grip(self, closed: bool) -> None:
        """Picks the waiting box, or lets go of the held one, where the tip is now."""
        self._held = closed
        x, y, _ = forward(joint_vector(self._state.arm[:JOINTS]), self.arm)
        time = (self.ticks - 1) * PERIOD
        if closed:
            self._boxes.grip(time, (x, y), float(self._state.fingers[0]))
        else:
            self._boxes.release(time, (x, y))

    def _tick_of(self, time: float) -> int:
        """The first tick at or after a plant time (s)."""
        return math.ceil(time / PERIOD - _ROUNDING)


def _log(
    times: Array,
    measured: Array,
    path: Array,
    volts: Array,
    present: NDArray[np.bool_],
    colours: NDArray[np.str_],
    gripped: NDArray[np.bool_],
) -> Log:
    """The log of an arm of which nobody knows the truth."""
    columns: dict[str, NDArray[Any]] = dict.fromkeys(COLUMNS, np.full(len(times), np.nan))
    columns |= {"t": times, "gripper": measured[:, 3].copy()}
    for name, values in (("measured", measured[:, :3]), ("target", path), ("volts", volts)):
        columns |= {f"{name}_{number}": np.ascontiguousarray(column) for number, column in enumerate(values.T, 1)}
    columns |= {"box_present": present, "box_colour": colours, "box_gripped": gripped}
    return Log(MappingProxyType(columns))
