"""The emulated arm of n joints on the bus: publishes a sample every tick, obeys the commands that answer it.

services/parts/paced/loop.py has the loop, and says what the paces are. One that was killed begins anew at time 0.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any, Final

from dtwin.bus.chain.messages import JointCommands, JointSensors
from dtwin.bus.messages import JOINT_COMMANDS, JOINT_SENSORS, JOINT_TICKS
from dtwin.bus.passed import PassedJoints
from dtwin.services.chain.machine import RunningArm
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.emulator import ASKED_TO_END
from dtwin.services.parts.gate import STALE
from dtwin.services.parts.pace import Pace
from dtwin.services.parts.paced.loop import Paced
from dtwin.services.service import Link, Service, main

NAME: Final = "emulator"


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Run the emulated arm on the bus."""

    pace: Pace = "realtime"
    """realtime: ticks on the wall clock; lockstep: every tick waits for its command; free: no tick waits."""
    duration: float | None = None
    """Plant time after which the run ends, s; without it, it never ends."""
    stale: float = STALE
    """Time without a command, in real time, after which the arm gets no torque, s."""

    def run(self) -> int:
        settings = self.settings()
        period = settings.arm.period
        ticks = None if self.duration is None else max(1, round(self.duration / period))
        arm = RunningArm(settings)
        with Service(NAME, self) as service:
            whole = ArmEmulator(service, arm, period, self.pace, self.stale).run(ticks)
        return 0 if whole else ASKED_TO_END


class ArmEmulator(Paced[JointSensors, JointCommands]):
    """The arm between its inbox and its publications.

    Args:
        service: frame of this service.
        arm: emulated arm that runs.
        period: time between two ticks, s.
        pace: how long a tick waits for its command.
        stale: time without a command, in real time, after which the arm gets no torque, s.
    """

    def __init__(self, service: Service, arm: RunningArm, period: float, pace: Pace, stale: float) -> None:
        self._arm = arm
        lossless = pace != "realtime"
        self._publish_sensors = service.bus.publisher(JOINT_SENSORS, lossless=lossless)
        self._publish_ticks = service.bus.publisher(JOINT_TICKS, lossless=lossless)
        self._passed = PassedJoints(self._publish_ticks)
        super().__init__(service, arm, (JOINT_COMMANDS, JointCommands), period, pace, stale)

    def publish_sample(self, sample: JointSensors) -> None:
        """Publishes a sample."""
        self._publish_sensors(sample)

    def publish_acting(self, sample: JointSensors, command: JointCommands, answers: bool) -> None:
        """Keeps what acts in this tick until it is told with others."""
        if self._publish_ticks.wanted:
            self._passed.add(sample, command)

    def end_of_run(self) -> None:
        """Tells the ticks that wait to be told."""
        self._passed.tell()

    def figures(self) -> dict[str, Any]:
        """What became of the boxes."""
        return {"boxes": self._arm.box_counts}


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
