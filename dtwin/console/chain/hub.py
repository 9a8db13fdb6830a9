"""Gathers what a cell with an arm of n joints says on its bus; the rest is as in every cell."""

from __future__ import annotations

from typing import Final

import msgspec

from dtwin.arm.chain import Arm
from dtwin.arm.sorting import Sorting
from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTicks, JointUpload
from dtwin.bus.chain.shapes import joint_shapes
from dtwin.bus.messages import ARM_UPLOAD, JOINT_COMMANDS, JOINT_SENSORS, JOINT_TICKS, RECOVERY_LOOK
from dtwin.bus.pairs import Pairs
from dtwin.bus.proposals.deciding import ARM
from dtwin.bus.proposals.messages import RecoveryLook
from dtwin.bus.session import Bus, Subscription
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.console.chain.commands import CHAIN_COMMANDS
from dtwin.console.chain.faces import points_of
from dtwin.console.clocks import Clocks
from dtwin.console.conditions import conditions, doing
from dtwin.console.hub import BEHIND, KEPT_EVERY, Hub
from dtwin.console.telling import CellState, Frame, ModelFace

RECOVERY: Final = "recovery"


class ChainHub(Hub):
    """The last word of everybody in a cell with an arm of n joints.

    Args:
        bus: session on which the hub listens and asks.
        cell: name of the cell.
        name: name of the arm in the keys of the bus.
        clocks: clocks of the console.
        arm: the arm as its data sheet says.
        sorting: its task, if it sorts boxes.
    """

    commands = CHAIN_COMMANDS
    kept = ARM

    def __init__(
        self, bus: Bus, cell: str, name: str, clocks: Clocks, arm: Arm, sorting: Sorting | None = None
    ) -> None:
        super().__init__(bus, cell, name, clocks)
        self.joints = len(arm)
        self._faces = joint_shapes(arm)
        self._tool = tuple(map(float, arm.tool))
        self._points = points_of(sorting)
        self._sample: JointSensors | None = None
        self._answer: JointCommands | None = None
        self._answered: Pairs[JointSensors, JointCommands] = Pairs()
        self._both: tuple[JointSensors, JointCommands] | None = None

    @property
    def age(self) -> float | None:
        """Time since the last sample arrived, s; None before the first one."""
        return None if self._sample is None else self._clocks.steady() - self._heard[0]

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        newest, answer, both = self._sample, self._answer, self._both
        if newest is None:
            return Frame()
        sample, command = both or (newest, None)
        heard = self._heard[1] - (newest.time - sample.time)
        return Frame(
            sample.time,
            round(max(0.0, self._clocks.steady() - self._heard[0]), 3),
            round(1e3 * heard, 1),
            sample.theta,
            None if command is None else command.target,
            None if answer is None else answer.commands,
            gripped=answer is not None and answer.gripped,
            box=self._named(newest.box),
        )

    def state(self) -> CellState:
        """All that changes seldom."""
        base = super().state()
        verdict = None if base.verdict is None else _together(base.verdict)
        model = self._of("simulation", JointUpload)
        proposals = self._of(RECOVERY, RecoveryLook)
        told = () if proposals is None else proposals.proposals
        watch = base.watch
        found = conditions(
            base.services,
            base.stop,
            verdict,
            None,
            self.age,
            watch is None or watch.running,
            sum(each.state == "open" for each in told),
        )
        return msgspec.structs.replace(
            base,
            doing=self._doing(base),
            verdict=verdict,
            proposals=told,
            places={},
            conditions=found,
            joints=self._faces,
            tool=self._tool,
            points=self._points,
            model=None if model is None else _face(model),
        )

    def _doing(self, base: CellState) -> str:
        """What the arm does, in one line."""
        states = [health.state for health in base.services.values()]
        words = doing(base.stop, states, base.identification, "", "")
        if words != doing("none", (), None, "", ""):
            return words
        if not self._points:
            return "the arm goes from pose to pose"
        if self._answer is not None and self._answer.gripped:
            return "the arm carries a box to its place"
        return "the arm fetches a box" if self._sample is not None and self._sample.box else words

    def _listen_to_motion(self) -> None:
        self._bus.subscribe(JOINT_TICKS, JointTicks, self._receive_ticks)

    def _samples_followed(self) -> list[Subscription]:
        return [
            self._bus.subscribe(JOINT_COMMANDS, JointCommands, self._receive_commands),
            self._bus.subscribe(JOINT_SENSORS, JointSensors, self._receive_sample),
        ]

    def follow_path(self, wanted: bool) -> None:
        """Has every sample and its answer sent at once or not, which costs all who send them time."""
        super().follow_path(wanted)
        if not wanted:
            self._both = None

    def _ask_settings(self) -> None:
        if self.is_here("simulation"):
            self._ask(ARM_UPLOAD, JointUpload)
        if self.is_here(RECOVERY):
            self._ask(RECOVERY_LOOK, RecoveryLook)

    def _receive_ticks(self, passed: JointTicks) -> None:
        if not self._followed:
            last = passed.ticks[-1]
            self._note_answer(last.acted)
            self._note_sample(last.sensors)

    def _receive_sample(self, sample: JointSensors) -> None:
        self._note_sample(sample)
        with self._pairing:
            both = self._answered.first(sample)
        if both is not None and self._followed:
            self._both = both
        elif self._both is not None and sample.sequence - self._both[0].sequence not in range(BEHIND):
            self._both = None

    def _receive_commands(self, answer: JointCommands) -> None:
        if not self._note_answer(answer):
            return
        with self._pairing:
            both = self._answered.second(answer)
        if both is not None and self._followed:
            self._both = both

    def _note_answer(self, answer: JointCommands) -> bool:
        """Keeps an answer; whether it is one for this arm."""
        fits = len(answer.commands) == len(answer.target) == self.joints
        self._answer = answer if fits else self._answer
        return fits

    def _note_sample(self, sample: JointSensors) -> None:
        if len(sample.theta) != self.joints:
            return
        self._sample, self._heard = sample, (self._clocks.steady(), self._clocks.wall())
        self._opinion.sample(sample.time, self._heard[0])
        if self._heard[0] >= self._due:
            self._due = max(self._due + KEPT_EVERY, self._heard[0])
            self.keep(self.frame())

    def _named(self, box: int) -> str:
        """The place of the box that waits."""
        names = list(self._points)[1:]
        return names[box - 1] if 0 < box <= len(names) else ""


def _together(verdict: MonitoringVerdict) -> MonitoringVerdict:
    """The verdict with one unit for all joints while the arm is being learned, which is one condition, not n."""
    units = list(verdict.units.values())
    if len(units) < 2 or any(unit != units[0] or unit.state != "not commissioned" for unit in units):
        return verdict
    return msgspec.structs.replace(verdict, units={"arm": units[0]})


def _face(model: JointUpload) -> ModelFace:
    return ModelFace(
        model.version, model.time, model.action, model.text, model.on_trial, model.predicted, model.measured
    )
