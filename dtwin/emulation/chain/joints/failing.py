"""What faults do to the joints of an emulated arm at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array
from dtwin.emulation.chain.faults import ChainFault


class Failing:
    """The faults of an arm of n joints, and what they come to.

    Args:
        joints: number of joints n.
        faults: what is otherwise than the machine says, and when.

    Attributes:
        strength: factors of the constants of the drives, (n,).
        friction: factors of all friction, (n,).
        bias: what the encoders read too much, (n,), rad or m.
        push: torques or forces on the joints, (n,), N m or N.
        load: what hangs on the tool besides what is held, kg.
        locked: whether each joint does not move, (n,).
    """

    def __init__(self, joints: int, faults: Sequence[ChainFault]) -> None:
        self._faults = list(faults)
        self._read: Array | None = None
        self.strength, self.friction = np.ones(joints), np.ones(joints)
        self.bias, self.push = np.zeros(joints), np.zeros(joints)
        self.load = 0.0
        self.locked: NDArray[np.bool_] = np.zeros(joints, dtype=bool)

    def __bool__(self) -> bool:
        return bool(self._faults)

    @property
    def first(self) -> float:
        """When the first fault begins, s; infinite if there is none."""
        return min((fault.start for fault in self._faults), default=np.inf)

    def inject(self, faults: Sequence[ChainFault], time: float) -> None:
        """Adds faults at a time, s; those that would begin in the past begin at once."""
        self._faults += [replace(fault, start=max(fault.start, time)) for fault in faults]

    def update(self, time: float) -> None:
        """Works out what acts at a time, s."""
        self.strength[:] = self.friction[:] = 1.0
        self.bias[:] = self.push[:] = self.load = 0.0
        self.locked[:] = False
        for fault in self._faults:
            if fault.acts(time):
                self._add(fault)

    def _add(self, fault: ChainFault) -> None:
        match fault.kind:
            case "K":
                self.strength[fault.joint] *= fault.value
            case "friction":
                self.friction[fault.joint] *= fault.value
            case "bias":
                self.bias[fault.joint] += fault.value
            case "push":
                self.push[fault.joint] += fault.value
            case "load":
                self.load += fault.value
            case "lock":
                self.locked[fault.joint] = True
            case "freeze" | "scale":
                pass  # It acts on what is read alone.

    def misread(self, q: Array, time: float) -> Array:
        """What encoders with faults read at a time (s) instead of q, (n,), rad or m."""
        before = self._read
        q = q.copy()
        for fault in self._faults:
            if fault.acts(time) and fault.kind == "bias":
                q[fault.joint] += fault.value
            if fault.acts(time) and fault.kind == "scale":
                q[fault.joint] *= fault.value
        for fault in self._faults:
            if fault.acts(time) and fault.kind == "freeze" and before is not None:
                q[fault.joint] = before[fault.joint]
        self._read = q
        return q
