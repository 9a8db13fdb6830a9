"""The motion of an arm of n joints as its samples and the answers of its blocks tell it."""

from __future__ import annotations

from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTicks
from dtwin.bus.messages import JOINT_COMMANDS, JOINT_SENSORS, JOINT_TICKS
from dtwin.bus.pairs import Pairs
from dtwin.bus.session import Bus, Subscription
from dtwin.console.clocks import Clocks
from dtwin.console.motion import BEHIND, Motion
from dtwin.console.telling import Frame


class JointMotion(Motion):
    """How an arm of n joints moves.

    Args:
        bus: session on which the motion is followed.
        clocks: clocks of the console.
        joints: number of joints; messages for another number are not of this arm.
        places: names of the places where boxes belong, in the order of their kinds.
    """

    def __init__(self, bus: Bus, clocks: Clocks, joints: int, places: tuple[str, ...]) -> None:
        super().__init__(bus, clocks)
        self._joints = joints
        self._places = places
        self._sample: JointSensors | None = None
        self._answer: JointCommands | None = None
        self._answered: Pairs[JointSensors, JointCommands] = Pairs()
        self._both: tuple[JointSensors, JointCommands] | None = None

    @property
    def gripped(self) -> bool:
        """Whether the gripper holds a box."""
        return self._answer is not None and self._answer.gripped

    @property
    def waits(self) -> bool:
        """Whether a box waits."""
        return self._sample is not None and bool(self._sample.box)

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        newest, answer, both = self._sample, self._answer, self._both
        if newest is None:
            return Frame()
        sample, command = both or (newest, None)
        age, heard = self._ages(newest.time - sample.time)
        return Frame(
            sample.time,
            age,
            heard,
            sample.theta,
            None if command is None else command.target,
            None if answer is None else answer.commands,
            gripped=answer is not None and answer.gripped,
            box=self._named(newest.box),
        )

    def listen(self) -> None:
        """Subscribes to ticks, which come ten times a second."""
        self._bus.subscribe(JOINT_TICKS, JointTicks, self._receive_ticks)

    def follow(self, wanted: bool) -> bool:
        """Has every sample and its answer sent at once or not; whether that is a change."""
        changed = super().follow(wanted)
        if not wanted:
            self._both = None
        return changed

    def _subscriptions(self) -> list[Subscription]:
        return [
            self._bus.subscribe(JOINT_COMMANDS, JointCommands, self._receive_commands),
            self._bus.subscribe(JOINT_SENSORS, JointSensors, self._receive_sample),
        ]

    def _receive_ticks(self, passed: JointTicks) -> None:
        if not self.followed:
            last = passed.ticks[-1]
            self._note_answer(last.acted)
            self._note_sample(last.sensors)

    def _receive_sample(self, sample: JointSensors) -> None:
        self._note_sample(sample)
        with self._pairing:
            both = self._answered.first(sample)
        if both is not None and self.followed:
            self._both = both
        elif self._both is not None and sample.sequence - self._both[0].sequence not in range(BEHIND):
            self._both = None

    def _receive_commands(self, answer: JointCommands) -> None:
        if not self._note_answer(answer):
            return
        with self._pairing:
            both = self._answered.second(answer)
        if both is not None and self.followed:
            self._both = both

    def _note_answer(self, answer: JointCommands) -> bool:
        """Keeps an answer; whether it is one for this arm."""
        fits = len(answer.commands) == len(answer.target) == self._joints
        self._answer = answer if fits else self._answer
        return fits

    def _note_sample(self, sample: JointSensors) -> None:
        if len(sample.theta) == self._joints:
            self._sample = sample
            self._arrived(sample.time)

    def _named(self, box: int) -> str:
        """The place of the box that waits."""
        return self._places[box - 1] if 0 < box <= len(self._places) else ""
