"""A station with any other serial arm: its plant, its function blocks and the boxes that it is offered."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.bus.line.plant import JointSettings
from dtwin.controller.chain.application import inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.chain.model import held_inputs
from dtwin.emulation.boxes import REACH
from dtwin.emulation.chain.boxes import BroughtBoxes
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import motion, usual_inertia
from dtwin.errors import ParameterError
from dtwin.line.chain.cell import check_joint_settings
from dtwin.line.chain.rows import ArmRows, Row
from dtwin.line.station import FREE, HOLDING, OFFERED, Input, InputKind, Points, Report
from dtwin.parameters import PERIOD
from dtwin.run.chain import ChainSettings
from dtwin.signals import ArmState, Event, EventKind

_WORDS: Final[dict[str, ArmState]] = {"failed": "failed", "angles unknown": "angles unknown", "release": "nominal"}


class ChainStation:
    """A cell of another arm in this process.

    Args:
        settings: what its arm is and does.

    Attributes:
        log: what it has done, the same to the bit as that of the arm alone with the same `inputs`.
        inputs: everything that was done to it.
        settings: what its blocks have in the place of the settings of its cell; None for nothing.
        released: tick of 10 ms at which its arm was released last, 0 for never.

    Raises:
        DtwinError: its blocks cannot be used.
    """

    def __init__(self, settings: ChainSettings) -> None:
        assert settings.sorting is not None
        arm = settings.arm
        self._settings = settings
        self._controller = ChainController(
            len(arm), inputs(arm, usual_inertia(arm), settings.control, settings.poses)
        )
        start = settings.poses.positions[0] if settings.start is None else settings.start
        self._plant = ChainPlant(settings.machine, start, settings.seed, settings.late, settings.faults)
        self._boxes = BroughtBoxes(settings.sorting)
        self._coming: tuple[str, float] | None = None
        self._arm = FREE
        self._ticks = 0
        self.log = ArmRows(settings)
        self.inputs: list[Input] = []
        self.settings: JointSettings | None = None
        self.released = 0

    def fault_end(self, text: str) -> float | None:
        """When a fault is over, s; None if it lasts. Raises FaultError."""
        end = parse_chain_fault(text, len(self._settings.arm)).end
        return float(end) if np.isfinite(end) else None

    def give(self, kind: InputKind, mass: float = 0.0, text: str = "") -> None:
        self.apply(Input(self._ticks, kind, mass, text))

    def apply(self, given: Input) -> None:
        """Does something to it before the next tick, and notes it.

        Raises:
            ParameterError: the box belongs to no place, or comes while the arm is not free.
            FaultError: it is no fault of this arm.
            ParameterError: settings are of another arm, or out of range.
        """
        if given.kind == "bring":
            if given.text not in self._boxes.names or self._arm != FREE:
                raise ParameterError(f"bring: expected a box for {self._boxes.names} and a free arm, got {given}")
            self._coming, self._arm = (given.text, given.mass), OFFERED
        elif given.kind == "take":
            self._coming, self._arm = None, FREE
            self._boxes.take()
        elif given.kind == "fault":
            self._plant.inject([parse_chain_fault(given.text, len(self._settings.arm))])
        elif given.kind == "settings":
            self._put(joint_settings(given.text))
        else:
            if given.kind == "release" and self.settings is not None:
                self._put(None)
            self._controller.judge(_WORDS[given.kind], 1.0, given.kind == "release")
        if given.kind == "release":
            self.released = given.tick
        self.inputs.append(given)

    def _put(self, settings: JointSettings | None) -> None:
        """Has the blocks work with other settings than those of the cell, or with these again."""
        arm, control = self._settings.arm, self._settings.control
        wished = settings or JointSettings(control.tuning, Adjustment.none(len(arm)))
        check_joint_settings(self._settings, wished)
        tuned = held_inputs(arm, usual_inertia(arm), control.tuned(wished.tuning))
        self._controller.reckon_with(tuned, another=False)
        self._controller.adjust(wished.adjustment)
        self.settings = settings

    @property
    def ahead(self) -> bool:
        """Whether it has worked further than it has reported."""
        return False

    def work_ahead(self, ticks: int, undisturbed: int) -> None:
        """Does nothing: its plant is no faster for many ticks than for few."""

    def advance(self, ticks: int) -> Report:
        """Lets it work for some ticks of 10 ms."""
        events: list[Event] = []
        for _ in range(round(ticks * PERIOD / self._settings.arm.period)):
            self._tick(events)
        self._ticks += ticks
        return Report(self._arm, self._controller.stop, tuple(events))

    def write_log(self, path: Path) -> None:
        """Writes its log. Raises RecordingError."""
        self.log.write(path)

    def desired(self) -> tuple[Array, Array]:
        """Times, (N,), s, and the desired positions of its joints at them, (N, n), rad or m."""
        run = self.log.run()
        return run.t, run.target

    def points(self, every: int) -> Points:
        """Where its joints and its tool were as its encoders read, in every so-manieth tick."""
        arm = self._settings.arm
        run = self.log.run()
        q = run.q[::every]
        still = np.zeros_like(q)
        moving = motion(arm, q, still, still)
        turned = np.broadcast_to(np.eye(3), (len(q), 3, 3))
        at = np.zeros((len(q), 3))
        found = [at]
        for rotation, translation in zip(moving.rotation, moving.translation, strict=True):
            at = at + np.einsum("nij,nj->ni", turned, translation)
            turned = turned @ rotation
            found.append(at)
        found.append(at + np.einsum("nij,j->ni", turned, arm.tool))
        return Points(run.t[::every], np.stack(found, axis=1))

    def _tick(self, events: list[Event]) -> None:
        plant, controller, boxes = self._plant, self._controller, self._boxes
        if self._coming is not None and controller.pose == 0:  # on its way it would bring it to the last one's place
            boxes.bring(*self._coming)
            self._coming = None
        read = plant.read()
        box = boxes.waiting(plant.time)
        sent = controller.step(read.tolist(), box)
        q, target, true = (tuple(each.tolist()) for each in (read, controller.desired()[0], plant.state[0]))
        self.log.append(Row(q, target, sent, true, controller.pose, box, controller.grips))
        self._grip(events)
        plant.apply(sent, controller.brakes)
        plant.advance()

    def _grip(self, events: list[Event]) -> None:
        plant, boxes = self._plant, self._boxes
        before, done = boxes.counts.picked, len(boxes.counts.errors)
        boxes.grip(self._controller.grips, plant.tool, plant.time)
        plant.hold(boxes.held)
        if boxes.counts.picked > before:
            self._arm = HOLDING
            events.append(Event(plant.time, EventKind.PICKED, "picked the box"))
        for error in boxes.counts.errors[done:]:
            self._arm = FREE
            kind = EventKind.DELIVERED if error <= REACH else EventKind.MISPLACED
            events.append(Event(plant.time, kind, f"the box was let go {1000 * error:.1f} mm from its place"))


def joint_settings(text: str) -> JointSettings:
    """The settings of an `Input`. Raises ParameterError: they are of another kind of arm."""
    try:
        return msgspec.json.decode(text, type=JointSettings)
    except msgspec.MsgspecError as error:
        raise ParameterError(f"settings: expected those of an arm of n joints: {error}") from None
