"""Path and control of a single motion: the planner and controller blocks without the sequence of the cell.

The blocks are those of the system `motion.sys`; the what-if simulation closes the loop with the analytic twin.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dtwin.controller.kept import application
from dtwin.controller.ports import BLOCKS, CONFIRM, MOTION_SYSTEM, OFFSETS, PATH, PATH_END, WIDENED
from dtwin.controller.runtime import running
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError, choices
from dtwin.parameters import PERIOD, JointVector, every_joint
from dtwin.task import DEFAULT_TASK, Task

NAMES: Final = tuple(DEFAULT_TASK.all_places)
"""Names of the usual places."""
STILL: Final[JointVector] = every_joint(0.0)
ARM: Final = "ARM"
"""The SERVER block that receives three angles, whether a path begins and whether a box is held; it answers volts."""
_OF_THE_APPLICATION: Final = {CONFIRM, WIDENED, *OFFSETS}
"""Inputs of blocks of the cell's application, which a single motion has not."""

_UNSETTLED: Final = 10
"""Samples after a start for which the observer takes no reading for frozen."""

Goal = str | JointVector
"""Goal of a motion: the name of a place, or joint angles in rad."""


class MotionController:
    """The blocks PATH_PLANNER and COMPUTED_TORQUE_CONTROL_3, stepped by calls, one motion after another.

    Args:
        blocks: folder of the function-block library.
        task: says where the places are to which motions lead by their names.
        via: whether motions are parts of ways over points that keep clear of bodies: straight in joint space, and the
            shorter the less far they go.

    Attributes:
        resource: the running blocks, whose variables can be read and written between steps.

    Raises:
        FunctionBlockError: the library or its system cannot be used.
        NativeError: machine code is asked for and cannot be made here.
    """

    def __init__(self, blocks: Path = BLOCKS, task: Task = DEFAULT_TASK, via: bool = False) -> None:
        self._places = task.all_places
        self.resource = running(*application(blocks, MOTION_SYSTEM))
        server = self.resource.server(ARM)
        self.resource.start()
        self.resource.write("PLANNER.VIA", via)
        self._configured = self.resource.snapshot()
        self._exchange = server.exchange
        self._path = self.resource.reader(PATH)
        self._target = self.resource.reader(PATH_END)
        self._settings: ControlSettings | None = None
        self._inputs: dict[str, float | int] = {}
        self._carries = False

    def start(
        self,
        theta: JointVector,
        goal: Goal,
        settings: ControlSettings,
        *,
        carries: bool = False,
        omega: JointVector = STILL,
    ) -> JointVector:
        """Starts a path with its first sample; the blocks keep no state of earlier motions.

        Args:
            as of `prepare`.

        Returns:
            The voltages of joints 1 to 3, V.

        Raises:
            ParameterError: there is no place of the goal's name.
        """
        self.prepare(theta, goal, settings, carries=carries, omega=omega)
        v_1, v_2, v_3 = self._exchange((*theta, True, carries))
        return (v_1, v_2, v_3)

    def prepare(
        self,
        theta: JointVector,
        goal: Goal,
        settings: ControlSettings,
        *,
        carries: bool = False,
        omega: JointVector = STILL,
    ) -> None:
        """Prepares the blocks for the first sample of a path.

        Args:
            theta: measured angles, rad.
            goal: place or joint angles at which the motion ends.
            settings: values for the inputs of the blocks; offsets of encoders do not count, since these angles have
                none.
            carries: whether the controller counts on a box in the gripper.
            omega: velocities at the start, from which the samples before this one are made up, rad/s.

        Raises:
            ParameterError: there is no place of the goal's name.
        """
        resource = self.resource
        resource.restore(self._configured)
        if settings != self._settings:
            inputs = settings.inputs()
            for name, value in inputs.items():
                if name not in _OF_THE_APPLICATION and value != self._inputs.get(name):
                    resource.write(name, value)
            self._settings, self._inputs, self._configured = settings, inputs, resource.snapshot()
        self._aim(goal)
        if omega != STILL:
            self._remember(theta, omega)
        self._carries = carries

    def go(self, theta: JointVector, goal: Goal) -> JointVector:
        """Starts another path with its first sample, and keeps what the blocks have learned on the way.

        Args:
            theta: measured angles, rad.
            goal: place or joint angles at which the motion ends.

        Returns:
            The voltages of joints 1 to 3, V.

        Raises:
            ParameterError: there is no place of the goal's name.
        """
        self._aim(goal)
        v_1, v_2, v_3 = self._exchange((*theta, True, self._carries))
        return (v_1, v_2, v_3)

    def step(self, theta: JointVector) -> JointVector:
        """Voltages of joints 1 to 3 (V) that answer the next sample of the angles (rad)."""
        v_1, v_2, v_3 = self._exchange((*theta, False, self._carries))
        return (v_1, v_2, v_3)

    def path(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""
        theta_1, theta_2, theta_3 = self._path()
        return (theta_1, theta_2, theta_3)

    def target(self) -> JointVector:
        """Angles at which the path ends, rad."""
        theta_1, theta_2, theta_3 = self._target()
        return (theta_1, theta_2, theta_3)

    def point(self, name: str) -> JointVector | None:
        """The angles (rad) of a point that the planner knows by its name, such as `above pickup`; None if it does
        not."""
        self.prepare(STILL, STILL, self._settings or ControlSettings())
        self.resource.write("PLANNER.DESTINATION", name)
        self._exchange((*STILL, True, False))
        found = self.target()
        self.resource.restore(self._configured)
        return None if found == STILL else found

    def _aim(self, goal: Goal) -> None:
        if isinstance(goal, str):
            if goal not in self._places:
                raise ParameterError(f"unknown place {goal!r}: expected {choices(self._places)}")
            goal = self._places[goal].theta
        for name, angle in zip(PATH_END, goal, strict=True):
            self.resource.write(name, angle)

    def _remember(self, theta: JointVector, omega: JointVector) -> None:
        """Gives controller and observer the samples before, from which they compute a velocity."""
        write = self.resource.write
        write("CONTROLLER.RUNNING", True)
        write("OBSERVER.RUNNING", True)
        write("OBSERVER.WAIT", _UNSETTLED)
        for joint, (angle, speed) in enumerate(zip(theta, omega, strict=True), 1):
            before = angle - speed * PERIOD
            write(f"CONTROLLER.Y1{joint}", before)
            write(f"CONTROLLER.Y2{joint}", angle - 2.0 * speed * PERIOD)
            observed = {"TH": before, "SEEN": before, "MOVED": speed * PERIOD, "OM": speed, "PACE": speed}
            for name, value in observed.items():
                write(f"OBSERVER.{name}{joint}", value)
            write(f"OBSERVER.SIGN{joint}", 1.0)
            write(f"OBSERVER.BELIEVED{joint}", True)
