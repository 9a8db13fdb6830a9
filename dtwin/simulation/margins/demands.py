"""What margins are demanded of settings, and where settings fall short of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, NamedTuple

from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters, Law
from dtwin.simulation.margins.loop import Loop, linear_loop
from dtwin.simulation.margins.measures import Margins, margins, no_margins
from dtwin.simulation.margins.poses import Pose
from dtwin.twin.effects import NO_EFFECTS, Effects

STABLE: Final = 1.0 - 1e-6
"""Spectral radius from which the closed loop counts as not stable: errors would take hours to halve."""


UNSTABLE: Final = "stability"
"""Name of what an unstable loop falls short of."""


class Shortfall(NamedTuple):
    """A margin that falls short of the demand.

    Attributes:
        name: name of the margin.
        text: margin, its value, and what was expected of it.
        share: value as a share of what was expected, below 1.
    """

    name: str
    text: str
    share: float


@dataclass(frozen=True, slots=True)
class Demands:
    """Least margins of a loop.

    Attributes:
        disk: disk margin of all motors at once.
        gain: gain margin of any one motor, dB.
        phase: phase margin of any one motor, degrees.
        delay: delay margin of all motors at once, ticks.
        torque: share of its torque by which any one motor may be weaker or stronger.
    """

    disk: float = 0.3
    gain: float = 6.0
    phase: float = 35.0
    delay: float = 1.5
    torque: float = 0.25

    def shortfall(self, found: Margins) -> Shortfall | None:
        """The margin that falls short the most; None when all are as demanded."""
        if not found.spectral_radius < STABLE:
            radius = f"not stable: spectral radius {found.spectral_radius:.4f} of one tick, expected below 1"
            return Shortfall(UNSTABLE, radius, 0.0)
        values = {
            "disk margin": (found.disk, self.disk, ".2f", ""),
            "gain margin": (found.gain, self.gain, ".1f", " dB"),
            "phase margin": (min(found.phase), self.phase, ".0f", " degrees"),
            "delay margin": (found.delay, self.delay, ".2f", " ticks"),
            "change of one motor's torque": (found.torque, self.torque, ".2f", " of it"),
        }
        broken = {name: value / least for name, (value, least, *_) in values.items() if value < least}
        if not broken:
            return None
        name = min(broken, key=lambda each: broken[each])
        value, least, digits, unit = values[name]
        text = f"{name} {value:{digits}}{unit}, expected at least {least:g}{unit}"
        return Shortfall(name, text, broken[name])


MARGINS: Final = Demands()
"""Demanded of the application's settings: classical margins with room for a motor a quarter weaker or stronger."""
STABILITY: Final = Demands(0.0, 0.0, 0.0, 0.0, 0.0)
"""Demanded of the thesis's laws, which are kept for its experiments: a stable loop and no more."""
DEMANDS: Final[dict[Law, Demands]] = {"computed_torque": STABILITY, "row_sum": STABILITY, "cascade": MARGINS}
"""What is demanded before settings are used, by the control law."""


def demanded_margins(loop: Loop, demands: Demands) -> Margins:
    """The margins of a loop as far as demands ask for them: enough to tell the shortfall.

    A delay margin beyond the demand is not looked for, and where stability alone is demanded nothing beside it.
    """
    return no_margins(loop.radius()) if demands == STABILITY else margins(loop, demands.delay)


class Case(NamedTuple):
    """The margins at a pose, with a box of a mass (kg) in the gripper, 0 for none."""

    pose: Pose
    payload: float
    margins: Margins

    def __str__(self) -> str:
        return f"{self.pose.name} {'with' if self.payload else 'without'} a box"


def cases(
    controller: MotionController,
    settings: ControlSettings,
    arm: ArmParameters,
    poses: Iterable[Pose],
    late: float = 0.0,
    effects: Effects = NO_EFFECTS,
) -> list[Case]:
    """The margins of settings at each pose, without a box and with one as the settings assume it.

    Args:
        controller: controller whose blocks are used; its current motion ends.
        settings: settings of the blocks.
        arm: arm that is controlled.
        poses: poses at which the arm rests.
        late: ticks after which the arm obeys a command.
        effects: what the arm has beside its parameters, as for `linear_loop`.
    """
    return [
        Case(pose, payload, margins(linear_loop(controller, settings, arm, payload, pose.theta, late, effects)))
        for pose in poses
        for payload in dict.fromkeys((0.0, settings.payload))
    ]
