"""The design of the cascade's gains: poles on a grid, of which those count that leave enough margins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

from dtwin.campaign.spread import Progress
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters, Gains
from dtwin.simulation.margins.demands import MARGINS, Case, Demands
from dtwin.simulation.margins.loop import Loop, linear_arm, linear_blocks
from dtwin.simulation.margins.measures import margins, voltage_noise
from dtwin.simulation.margins.poses import places
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.effects import NO_EFFECTS, Effects

POSITION_POLES: Final = (8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 18.0)
"""Double poles of position and integral that the search tries, rad/s."""
VELOCITY_POLES: Final = (10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
"""Poles of the velocity loop that the search tries, rad/s.

Only pairs are tried whose velocity loop, the inner one of the cascade, is no slower than the position loop around it.
"""
RESERVE: Final = replace(MARGINS, disk=0.5)
"""Demanded of a design, at the places, with and without a box, however late the arm obeys."""
NOISE: Final = 800.0
"""Largest voltage for a rad of white encoder noise, standard deviations, V: an encoder of 12 bits makes 0.35 V."""
LATE: Final = (0.0, 1.0)
"""Ticks after which an arm obeys of which nothing is known."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """Gains of the cascade that were judged.

    Attributes:
        position: double pole of position and integral, rad/s.
        velocity: pole of the velocity loop, rad/s.
        gains: gains with these poles, the same for every joint.
        worst: least share of a demanded margin that there is over places, boxes and delays; 1 and more is enough.
        noise: largest standard deviation of a voltage for encoder noise of 1 rad, over the same cases, V.
    """

    position: float
    velocity: float
    gains: Gains
    worst: float
    noise: float

    @property
    def good(self) -> bool:
        """Whether nothing that is demanded of the design is missing."""
        return self.worst >= 1.0 and self.noise <= NOISE


def gains_of(position: float, velocity: float) -> Gains:
    """The gains of (s + velocity) (s + position)^2 = s^3 + kd s^2 + kp s + ki, the same for every joint.

    Args:
        position: double pole of position and integral, rad/s.
        velocity: pole of the velocity loop, rad/s.
    """
    kd = velocity + 2.0 * position
    kp = position * (2.0 * velocity + position)
    ki = velocity * position**2
    return Gains((kp,) * 3, (ki,) * 3, (kd,) * 3)


def share(case: Case, demands: Demands) -> float:
    """The least share of a demanded margin that a case has; 1 and more is enough."""
    found = case.margins
    return min(
        found.disk / demands.disk,
        found.gain / demands.gain,
        min(found.phase) / demands.phase,
        found.delay / demands.delay,
        found.torque / demands.torque,
    )


def design(
    controller: MotionController,
    settings: ControlSettings,
    arm: ArmParameters,
    progress: Progress,
    late: Sequence[float] = LATE,
    effects: Effects = NO_EFFECTS,
    task: Task = DEFAULT_TASK,
) -> tuple[Candidate, ...]:
    """Judges gains on a grid of poles.

    Args:
        controller: controller whose blocks are used; its current motion ends.
        settings: settings of the blocks but for the gains; the law is the cascade.
        arm: arm that is controlled.
        progress: is told how many candidates of how many have been judged.
        late: ticks after which the arm obeys a command; all are tried.
        effects: what the arm has beside its parameters, as for `linear_loop`.
        task: task whose places are the poses.
    """
    found = []
    at = [
        (pose, payload, linear_arm(arm, payload, pose.theta, effects))
        for pose, payload in product(places(task), (0.0, settings.payload))
    ]
    grid = [(outer, inner) for outer, inner in product(POSITION_POLES, VELOCITY_POLES) if inner >= outer]
    for done, (position, velocity) in enumerate(grid, 1):
        tried = replace(settings, gains=gains_of(position, velocity), law="cascade")
        worst, noise = math.inf, 0.0
        for pose, payload, plant in at:
            blocks = linear_blocks(controller, tried, pose.theta, carries=payload > 0)
            for ticks in late:
                loop = Loop(blocks, plant, ticks)
                worst = min(worst, share(Case(pose, payload, margins(loop)), RESERVE))
                noise = max(noise, voltage_noise(loop) if loop.radius() < 1.0 else math.inf)
        found.append(Candidate(position, velocity, tried.gains, worst, noise))
        progress(done, len(grid))
    return tuple(found)


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """The candidate that rejects disturbances best: the largest integral gain.

    This is the rule of Astrom, Panagopoulos and Hagglund, Automatica 34 (1998), for loops with bounded sensitivity.
    """
    return max(candidates, key=lambda each: each.gains.ki[0])
