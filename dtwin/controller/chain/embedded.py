"""The controller of any serial arm in this process; the control law itself is in the function blocks alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.controller.chain.application import (
    ARM,
    LIBRARY,
    SEQUENCE,
    STOP,
    TWIN,
    VERDICT,
    first_doubted,
    joint_name,
    network,
)
from dtwin.controller.runtime import Blocks, running
from dtwin.signals import ARM_STATES, STOPS, ArmState, Stop
from iec61499 import model
from iec61499.library import Library
from iec61499.native.resource import NativeResource


class ChainController:
    """The application of an arm of n joints, stepped by calls.

    Args:
        joints: the number of joints n.
        values: values of the inputs of its blocks (application.inputs).
        blocks: folder of the block library.

    Attributes:
        resource: the running application, whose variables can be read and written between steps.
        grips: whether the gripper is closed since the last step.
        brakes: whether the brake of each joint is engaged since then, (n,).

    Raises:
        FunctionBlockError: the library cannot be used, or a value is not of its input's type.
        NativeError: machine code is asked for and cannot be made here.
    """

    def __init__(self, joints: int, values: Mapping[str, Any], blocks: Path = LIBRARY) -> None:
        self.resource: Blocks = running(_network(joints), _library(blocks, Library([blocks]).stamp()))
        for name, value in values.items():
            self.resource.write(name, value)
        servers = [self.resource.server(name) for name in (ARM, VERDICT, TWIN)]
        self._told = Adjustment.none(joints)
        self._unstarted = self.resource.snapshot()
        self.resource.start()
        self._exchange, self._verdict, self._twin = (server.exchange for server in servers)
        self._joints = joints
        self._release()
        names = [joint_name(k) for k in range(joints)]
        self._desired = [self.resource.reader((f"{name}.PATH.Q_D", f"{name}.PATH.QD_D")) for name in names]
        self._counted = [
            self.resource.reader(tuple(f"{name}.FEEDBACK.{what}" for what in ("Q_M", "QD_M", "U"))) for name in names
        ]
        self._sequence = self.resource.reader((f"{SEQUENCE}.INDEX", f"{SEQUENCE}.DONE"))
        self._doubts = [self.resource.reader((f"{name}.OBSERVER.DOUBT", f"{name}.OBSERVER.COUNT")) for name in names]
        self._stop = self.resource.reader((f"{STOP}.STOP", f"{STOP}.COUNT"))

    def start_anew(self, values: Mapping[str, Any]) -> None:
        """Puts the blocks to their beginning with other values of some inputs, and starts them."""
        self.resource.restore(self._unstarted)
        for name, value in values.items():
            self.resource.write(name, value)
        self.resource.start()
        self._release()

    def _release(self) -> None:
        self.grips, self.brakes = False, (False,) * self._joints

    def check(self, problem: int) -> None:
        """Raises what blocks returned to machine code: FunctionBlockError, or CommunicationError if none answered."""
        assert isinstance(self.resource, NativeResource)
        self.resource.check(problem, ARM)

    def step(self, positions: Sequence[float], box: int = 0) -> tuple[float, ...]:
        """The commands that answer a sample, (n,), in the units of the drives.

        Args:
            positions: what the encoders read, (n,), rad or m.
            box: place of the box that waits, from 1; 0 if none waits.

        Raises:
            FunctionBlockError: a block failed. CommunicationError: the application did not answer.
        """
        n = self._joints
        answer = self._exchange((*positions, box))
        self.grips, self.brakes = bool(answer[n]), tuple(map(bool, answer[n + 1 :]))
        return tuple(answer[:n])

    def judge(self, state: ArmState, confidence: float, release: bool = False) -> Stop:
        """Sends a verdict on the arm, its probability, and whether an operator releases it; returns the stop.

        Only a sure failure changes the stop; a release takes effect unless the arm still brakes.
        """
        (stop,) = self._verdict((ARM_STATES.index(state), confidence, release))
        return STOPS[int(stop)]

    def adjust(self, found: Adjustment) -> None:
        """Lets the joints count on what was found of them, from the next sample on."""
        self._told = found
        self._twin(found.message)

    def reckon_with(self, values: Mapping[str, float], another: bool = True) -> None:
        """Gives the blocks a model and a tuning from the next sample on (model.held_inputs).

        Args:
            values: values of inputs.
            another: whether the model is another one, so that the integral parts, which have balanced what the one
                before did not know, begin anew.
        """
        for name, value in values.items():
            self.resource.write(name, value)
        if another:
            self._twin(self._told.message)

    def halt(self, angles_known: bool) -> None:
        """Stops the arm: it brakes along its path and stands; without torque where its angles are not known."""
        self.judge("failed" if angles_known else "angles unknown", 1.0)

    def desired(self) -> tuple[Array, Array]:
        """Desired positions and velocities at the last sample, (n,) each."""
        both = np.array([read() for read in self._desired])
        return both[:, 0], both[:, 1]

    def counted(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at which the equations counted at the last sample, (n,) each."""
        state = np.array([read() for read in self._counted])
        return state[:, 0], state[:, 1], state[:, 2]

    @property
    def done(self) -> bool:
        """Whether all poses have been reached and nothing follows."""
        return bool(self._sequence()[1])

    @property
    def pose(self) -> int:
        """Number of the pose to which the arm goes, from 0."""
        return int(self._sequence()[0])

    @property
    def doubted(self) -> int:
        """Number of the first joint, from 1, whose readings the arm stops for; 0 for none."""
        return first_doubted([float(read()[0]) for read in self._doubts])

    @property
    def stop(self) -> int:
        """The stop in force: 0 none, 1 braking, 2 standstill, 3 torque off."""
        return int(self._stop()[0])


@lru_cache(maxsize=8)
def _network(joints: int) -> model.FBNetwork:
    return started_network(network(joints))


@lru_cache(maxsize=4)
def _library(blocks: Path, stamp: tuple[tuple[str, int, int], ...]) -> Library:
    """The library, read anew when a file of it has changed."""
    return Library([blocks])


def started_network(drawn: model.FBNetwork) -> model.FBNetwork:
    """The network with what starts it on a resource."""
    begins = tuple(model.Connection(f"START.{name}", f"{ARM}.INIT") for name in ("COLD", "WARM"))
    start = model.Block("START", "E_RESTART")
    return model.FBNetwork((start, *drawn.blocks), (), (*begins, *drawn.events), drawn.data)
