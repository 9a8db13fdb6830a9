"""The drives of an emulated arm: commands within their limits, which act after some ticks."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.joints.failing import Failing


class Actuation:
    """The drives of n joints.

    Args:
        arm: the arm.
        model: its model; a servo is an actuator of it.
        late: whole ticks from a command until it acts.
        start: positions at the beginning, (n,), which servos are commanded at first.

    Attributes:
        constant: torque of a command of each drive, (n,).
        limit: the largest command of each, (n,), in its own unit.
        servos: whether the drives are commanded positions.
        waiting: commands that are late, oldest first, (n,) each.
    """

    def __init__(self, arm: Arm, model: mujoco.MjModel, late: int, start: Array) -> None:
        self.constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
        self.limit = np.array([joint.actuator.limit for joint in arm.joints])
        self.servos = bool(arm.servos)
        first = np.array(start, dtype=np.float64) if self.servos else np.zeros(len(arm))
        self.waiting = [first.copy() for _ in range(late)]
        self._model = model
        self._healthy = tuple(
            np.array(each) for each in (model.actuator_gainprm, model.actuator_biasprm, model.actuator_forcerange)
        )

    def add(self, commands: Sequence[float]) -> None:
        """Takes commands, (n,), each within its limit."""
        self.waiting.append(np.minimum(np.maximum(commands, -self.limit), self.limit))

    def act(self, failing: Failing) -> tuple[Array, Array]:
        """What acts in the next tick: the torques of motors that are commanded directly, (n,), N m or N, and the
        positions of servos, (n,); the one or the other is 0.

        Drives that are commanded a position have the encoders of their joints, with what these read too much.
        """
        command = self.waiting.pop(0)
        if not self.servos:
            return failing.strength * self.constant * command, np.zeros(len(command))
        factor = failing.strength[:, None]
        gain, bias, force = self._healthy
        self._model.actuator_gainprm[:] = factor * gain
        self._model.actuator_biasprm[:] = factor * bias
        self._model.actuator_forcerange[:] = factor * force
        return np.zeros(len(command)), command - failing.bias
