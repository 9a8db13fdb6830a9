"""The emulated machine of n joints between two ticks: sample, command, boxes, and the stop kept for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dtwin.bus.chain.messages import JointCommands, JointSensors
from dtwin.emulation.chain.boxes import Boxes
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.emulation.generators import check_seed
from dtwin.run.chain import ChainSettings
from dtwin.services.parts.latch import Latch, Latched
from dtwin.signals import BoxCounts, Event, EventKind


class RunningArm:
    """An arm that goes on tick by tick.

    Args:
        settings: the run of the arm.

    Attributes:
        command: commands that it obeys.
        latch: stop that is kept until its release.
    """

    def __init__(self, settings: ChainSettings) -> None:
        self._joints = len(settings.arm)
        self.latch = Latch(Latched(), lambda latched: None)
        self._start(settings)

    def _start(self, settings: ChainSettings) -> None:
        start = settings.poses.positions[0] if settings.start is None else settings.start
        self._settings = settings
        self._plant = ChainPlant(settings.machine, start, settings.seed, settings.late, settings.faults)
        self._boxes = None if settings.sorting is None else Boxes(settings.sorting, settings.seed)
        self._events: list[Event] = []
        self._sequence = 0
        self._sample = self._sampled()
        self._held: tuple[float, ...] | None = None
        self.command = self._without_torque(JointCommands(0, 0.0, (0.0,) * self._joints, tuple(map(float, start))))

    @property
    def seed(self) -> int:
        """Of boxes and noise."""
        return self._settings.seed

    @property
    def without_command(self) -> str:
        """What becomes of the arm without a command, in words."""
        return "is held where it is" if self._settings.arm.servos else "gets no torque"

    def read(self) -> JointSensors:
        """The sample of this tick."""
        return self._sample

    def obey(self, command: JointCommands) -> None:
        """Sets the commands until the next ones.

        Commands for another number of joints do not count, as nobody knows which joint they are for.
        """
        if len(command.commands) == self._joints and len(command.brakes) in (0, self._joints):
            self.command, self._held = command, None

    def stop(self) -> None:
        """No torque until the next command, and all brakes are engaged; the gripper stays as it is.

        Drives that are commanded a position hold the joints where they were measured when this began.
        """
        self.command = self._without_torque(self.command)

    def _without_torque(self, command: JointCommands) -> JointCommands:
        if self._held is None:
            self._held = self._sample.theta if self._settings.arm.servos else (0.0,) * self._joints
        brakes = (True,) * self._joints
        return JointCommands(command.sequence, command.time, self._held, command.target, command.gripped, brakes)

    def hold_off(self, command: JointCommands) -> None:
        """No torque where a command came that may not pass."""
        self.stop()

    def advance(self) -> None:
        """One tick under the commands.

        Raises:
            DivergenceError: the motion is not finite any more.
        """
        plant, boxes = self._plant, self._boxes
        if boxes is not None:
            before = replace(boxes.counts)
            boxes.grip(self.command.gripped, plant.tool, plant.time)
            plant.hold(boxes.held)
            for kind, text, new in (
                (EventKind.PICKED, "a box was picked", boxes.counts.picked > before.picked),
                (EventKind.GRIP_MISSED, "the gripper closed without a box", boxes.counts.missed > before.missed),
                (EventKind.DELIVERED, "a box was delivered", boxes.counts.delivered > before.delivered),
            ):
                if new:
                    self._events.append(Event(plant.time, kind, text))
        plant.apply(self.command.commands, self.command.brakes)
        plant.advance()
        self._sequence += 1
        self._sample = self._sampled()

    def drain_events(self) -> list[Event]:
        """What happened to the boxes since the last call."""
        events, self._events = self._events, []
        return events

    def drain_news(self) -> Sequence[str]:
        """Nothing: it keeps no files."""
        return ()

    def inject(self, faults: Sequence[str]) -> list[str]:
        """Adds faults; returns them with the times they really have.

        Raises:
            FaultError: one cannot be read.
        """
        time = self._plant.time
        read = [parse_chain_fault(text, self._joints) for text in faults]
        found = [replace(fault, start=max(fault.start, time)) for fault in read]
        self._plant.inject(found)
        return [str(fault) for fault in found]

    def restart(self, seed: int) -> None:
        """Starts anew at time 0, with the boxes and the noise of a seed.

        A latched stop stays, with the torque off: another arm stands there now.

        Raises:
            ParameterError: the seed is out of range; the arm goes on as it was.
        """
        check_seed(seed)
        self.latch.harden()
        self._start(replace(self._settings, seed=seed))

    @property
    def box_counts(self) -> BoxCounts | None:
        """What became of the boxes; None for an arm that does not sort."""
        if self._boxes is None:
            return None
        counts = self._boxes.counts
        return BoxCounts(counts.arrived, 0, counts.picked, counts.delivered, 0, int(self._boxes.held > 0.0))

    def _sampled(self) -> JointSensors:
        waiting, time = 0, self._sequence * self._settings.arm.period
        if self._boxes is not None:
            before = self._boxes.counts.arrived
            waiting = self._boxes.waiting(self._plant.time)
            if self._boxes.counts.arrived > before:
                self._events.append(Event(time, EventKind.ARRIVED, "a box arrived"))
        return JointSensors(self._sequence, time, tuple(map(float, self._plant.read())), waiting)
