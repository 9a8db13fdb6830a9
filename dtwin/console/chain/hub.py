"""Gathers what a cell with an arm of n joints says on its bus; the rest is as in every cell."""

from __future__ import annotations

from typing import Final

import msgspec

from dtwin.arm.chain import Arm
from dtwin.arm.sorting import Sorting
from dtwin.bus.chain.messages import JointUpload
from dtwin.bus.chain.shapes import joint_shapes
from dtwin.bus.messages import ARM_UPLOAD, RECOVERY_LOOK
from dtwin.bus.proposals.deciding import ARM
from dtwin.bus.proposals.messages import RecoveryLook
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.console.chain.commands import CHAIN_COMMANDS
from dtwin.console.chain.faces import points_of
from dtwin.console.chain.motion import JointMotion
from dtwin.console.clocks import Clocks
from dtwin.console.conditions import conditions, doing
from dtwin.console.hub import Hub
from dtwin.console.telling import CellState, ModelFace

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
        points = points_of(sorting)
        self._motion = JointMotion(bus, clocks, len(arm), tuple(points)[1:])
        super().__init__(bus, cell, name, clocks, motion=self._motion)
        self.joints = len(arm)
        self._faces = joint_shapes(arm)
        self._tool = tuple(map(float, arm.tool))
        self._points = points

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
        if self._motion.gripped:
            return "the arm carries a box to its place"
        return "the arm fetches a box" if self._motion.waits else words

    def _ask_settings(self) -> None:
        if self.is_here("simulation"):
            self._answers.ask(ARM_UPLOAD, JointUpload)
        if self.is_here(RECOVERY):
            self._answers.ask(RECOVERY_LOOK, RecoveryLook)


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
