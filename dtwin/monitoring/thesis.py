"""The thesis's monitor: a second arm under the same function blocks, compared sample by sample.

From the start of every motion the analytic twin is moved from the measured angles by the planner and controller
blocks. A sample deviates on a joint when |simulated - measured| exceeds 0.1 rad and 5 % of the measured angle; ten
deviating samples in a row on a joint are a failure.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from dtwin.bus.twin_messages import UNITS, MonitoringVerdict, UnitState
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.monitoring.kinds import UNKNOWN, FaultId
from dtwin.monitoring.verdict import Finding, finding, monitored_units
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, joint_vector
from dtwin.signals import Event
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, Task
from dtwin.twin.dynamics import integrate

Array = NDArray[np.float64]
Message = Literal["nominal", "may be degrading", "deviation detected"]

ABSOLUTE: Final = 0.1
"""rad"""
RELATIVE: Final = 0.05
"""of the measured angle's size"""
IN_A_ROW: Final = 10
_LEAST_ANGLE: Final = 1e-9
"""rad: an angle of zero is divided by as this"""


@dataclass(frozen=True, slots=True)
class ThesisSettings:
    """How the comparison is made.

    Attributes:
        sample_time: time between two comparisons, s, a whole multiple of 10 ms.
        step: step of the simulation, s; 10 ms is a whole multiple of it.
        control: settings of the simulated controller, with the payload it assumes.

    Raises:
        ParameterError: a time is no such multiple.
    """

    sample_time: float = 0.5
    step: float = 0.005
    control: ControlSettings = field(default_factory=ControlSettings)

    def __post_init__(self) -> None:
        if not _divides(PERIOD, self.sample_time):
            raise ParameterError(f"sample time {self.sample_time} s: expected a whole multiple of {PERIOD} s")
        if not _divides(self.step, PERIOD):
            raise ParameterError(f"step {self.step} s: expected that {PERIOD} s is a whole multiple of it")


class ThesisMonitor:
    """Follows one arm by simulation.

    Args:
        arm: the healthy arm.
        settings: how the comparison is made.
        task: where the places are to which boxes are brought.

    Attributes:
        simulated: (3,), rad.
        counts: (3,), deviating samples in a row.
        failed: time (s) at which each joint failed, NaN if it did not.
        events: failures as they were found.
        missed: samples that did not arrive.
        sample: number of the last sample, -1 before the first.
    """

    def __init__(self, arm: ArmParameters, settings: ThesisSettings | None = None, task: Task = DEFAULT_TASK) -> None:
        self.settings = settings or ThesisSettings()
        self._vector = np.array(arm.vector())
        self._controller = MotionController(task=task)
        self._every = round(self.settings.sample_time / PERIOD)
        self._substeps = round(PERIOD / self.settings.step)
        self._states = np.zeros((2, 6))
        self._volts = np.zeros((1, 3))
        self._payload = np.zeros(1)
        self._gripped = False
        self.counts = np.zeros(3, dtype=int)
        self.failed = np.full(3, np.nan)
        self.events: list[Event] = []
        self.missed = 0
        self.sample = -1

    @property
    def time(self) -> float:
        """Plant time of the last sample, s."""
        return self.sample * PERIOD

    @property
    def simulated(self) -> Array:
        return self._states[0, :3]

    def update(self, sample: int, measured: Array, gripped: bool, colour: str) -> None:
        """Takes in a sample and whether its answer holds a box.

        Args:
            sample: its number; over missing ones the simulation goes on.
            measured: (3,), rad.
            gripped: a change starts a motion.
            colour: colour of the waiting box, "" for none; that of a box being gripped says where the motion goes.
        """
        gap = sample - self.sample
        first = self.sample < 0 or gap < 1
        if not first:
            self.missed += gap - 1
            for _ in range(gap - 1):
                self._advance()
                self._volts[0] = self._controller.step(joint_vector(self.simulated))
            self._advance()
        self.sample = sample
        if first or gripped != self._gripped:
            self._initialise(measured, gripped, colour if gripped else PICKUP_NAME)
        else:
            self._volts[0] = self._controller.step(joint_vector(self.simulated))
        if sample % self._every == 0:
            self._compare(measured)

    def messages(self) -> tuple[Message, Message, Message]:
        """One a link, as the thesis words them."""
        first, second, third = (self._message(joint) for joint in range(3))
        return first, second, third

    def standing(self) -> list[Finding]:
        """The joints that have failed; this method names no cause."""
        return [
            finding(FaultId(UNKNOWN, joint), when, when, confidence=0.0)
            for joint, when in enumerate(self.failed.tolist(), 1)
            if when == when
        ]

    def verdict(self) -> MonitoringVerdict:
        """The opinion now, as it is published."""
        words: dict[Message, UnitState] = {
            "nominal": "nominal",
            "may be degrading": "may be degrading",
            "deviation detected": "failed",
        }
        states: list[UnitState] = [*(words[message] for message in self.messages()), "nominal"]
        units = monitored_units(dict(zip(UNITS, states, strict=True)), self.standing())
        return MonitoringVerdict(self.time, units, (), (), self.missed, 0)

    def _initialise(self, measured: Array, gripped: bool, goal: str) -> None:
        self._states[0, :3], self._states[0, 3:] = measured, 0.0
        self._payload[0] = self.settings.control.payload if gripped else 0.0
        self._volts[0] = self._controller.start(joint_vector(measured), goal, self.settings.control, carries=gripped)
        self._gripped = gripped

    def _advance(self) -> None:
        integrate(
            self._vector, self._volts, self._payload, PERIOD, self._substeps, False, COULOMB_WIDTH, self._states
        )
        self._states[0] = self._states[1]

    def _compare(self, measured: Array) -> None:
        difference = np.abs(self.simulated - measured)
        deviates = (difference > ABSOLUTE) & (difference > RELATIVE * np.maximum(np.abs(measured), _LEAST_ANGLE))
        self.counts = np.where(deviates, self.counts + 1, 0)
        for joint in np.flatnonzero((self.counts >= IN_A_ROW) & np.isnan(self.failed)).tolist():
            self.failed[joint] = self.time
            text = f"deviation detected on link {joint + 1}: {difference[joint]:.3f} rad from the simulation"
            self.events.append(Event(self.time, "failed", text))

    def _message(self, joint: int) -> Message:
        if not np.isnan(self.failed[joint]):
            return "deviation detected"
        return "may be degrading" if self.counts[joint] else "nominal"


def _divides(part: float, whole: float) -> bool:
    if not 0.0 < part <= whole < float("inf"):
        return False
    ratio = whole / part
    return abs(ratio - round(ratio)) < 1e-6 * ratio
