"""Checks settings before an upload: their bounds, the margins at rest, and the motions of the cell on the twin."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from dtwin.controller.bounds import check_bounds
from dtwin.controller.ports import BLOCKS
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import ArmParameters, JointVector, Law, joint_vector
from dtwin.settings.change import Refused
from dtwin.simulation.figures import Figures
from dtwin.simulation.margins.demands import DEMANDS, UNSTABLE, Case, Shortfall
from dtwin.simulation.margins.loop import lateness, later, linear_loop
from dtwin.simulation.margins.measures import margins
from dtwin.simulation.margins.poses import Pose
from dtwin.simulation.places import Leg, angles_of, legs_of
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, Task
from dtwin.twin.effects import NO_EFFECTS, Effects

TAIL: Final = 0.5
"""Time after the end of a path for which a checked motion is simulated, s."""
TOLERANCE: Final = 0.9
"""Share of the margins of an arm that has less than is demanded that other settings have to keep, and of those that
are demanded of an arm with effects whose commands are late."""
WORST_TRACKING: Final[Mapping[Law, float]] = {"computed_torque": 0.3, "row_sum": 0.3, "cascade": 0.2}
"""Largest distance from the path in any motion of the cell, rad; under the cascade 0.5 rad stop the arm."""


class Motion(NamedTuple):
    """One of the motions of the cell: the names of its start and goal, and whether a box is carried."""

    start: str
    goal: str
    carries: bool


def motions_of(task: Task) -> tuple[Motion, ...]:
    """The motions of a cell: to every place with a box, and back without one."""
    ways = ((Motion(PICKUP_NAME, colour, True), Motion(colour, PICKUP_NAME, False)) for colour in task.colours)
    return tuple(itertools.chain.from_iterable(ways))


MOTIONS: Final = motions_of(DEFAULT_TASK)
"""The motions of a cell with the usual task."""


@dataclass(frozen=True, slots=True)
class ExpectedTracking:
    """Performance that the twin predicts for settings.

    Attributes:
        tracking: largest distance of each joint from its path over the motions of the cell, rad.
        rms: root mean square of the distance over all motions and joints, rad.
        peak_volts: largest voltage of each joint, V.
        saturated: largest share of the samples of a motion with a voltage at its limit.
        worst: motion with the largest distance from the path.
        spectral_radius: largest spectral radius of the closed loop at rest over the places, with and without a box.
        disk_margin: least disk margin over the same places.
    """

    tracking: JointVector
    rms: float
    peak_volts: JointVector
    saturated: float
    worst: Motion
    spectral_radius: float
    disk_margin: float


class Checker:
    """Checks settings on the twin with the real function blocks, which the first check loads.

    Args:
        blocks: folder of the function-block library.
        task: task of the cell.
        effects: what the arm has beside its parameters.
        via: whether the arm moves over points that keep clear of bodies.

    Attributes:
        motions: motions of the cell.
        task: task of the cell.
    """

    def __init__(
        self, blocks: Path = BLOCKS, task: Task = DEFAULT_TASK, effects: Effects = NO_EFFECTS, via: bool = False
    ) -> None:
        self._via = via
        self._blocks = blocks
        self.task = task
        self._effects = effects
        self.motions = motions_of(task)
        self._least = 1.0
        self._heavier = round(task.boxes.heaviest - task.boxes.middle, 12)

    @cached_property
    def _simulator(self) -> Simulator:
        return Simulator(self._blocks, self.task)

    @cached_property
    def _between_bodies(self) -> Simulator:
        return Simulator(self._blocks, self.task, via=True)

    @cached_property
    def _legs(self) -> tuple[Leg, ...]:
        return legs_of(self.task, self._between_bodies.controller.point) if self._via else ()

    def load(self) -> None:
        """Loads the function blocks and the compiled twin, so that no check has to wait for them,
        not even one of an arm whose commands come late.

        Raises:
            FunctionBlockError: the library cannot be used.
        """
        settings, arm, motions = ControlSettings(), ArmParameters(), self.motions[:1]
        for late in (0.0, 1.0):
            list(self._resting(settings, arm, motions, late))
            self.predict(settings, arm, motions, late)

    def tolerate(self, settings: ControlSettings, arm: ArmParameters) -> float:
        """Demands little more than settings have on an arm, when that is less than is demanded.

        An arm that is too slow for the demanded margins works with less, and must not be kept from what helps it.
        Settings with which it is not stable are no reason to demand less.

        Args:
            settings: settings that no upload changes, lest every upload lowers what the next one needs.
            arm: arm as it is known.

        Returns:
            the share of the demanded margins that is asked for from now on; stability is demanded whatever it is.

        Raises:
            FunctionBlockError: the library cannot be used.
        """
        short = [found.share for _, found in self._resting(settings, arm, self.motions) if found is not None]
        self._least = TOLERANCE * min(short) if short and min(short) > 0.0 else 1.0
        return self._least

    def least(self, late: float = 0.0) -> float:
        """The share of the demanded margins that is asked for.

        An arm with effects need only keep TOLERANCE of them when its commands are late: it is slower than the arm
        that they are meant for.

        Args:
            late: ticks by which commands act later than they did.
        """
        return min(self._least, TOLERANCE) if late and self._effects != NO_EFFECTS else self._least

    def keeps_margins(self, settings: ControlSettings, arm: ArmParameters, late: float = 0.0) -> bool:
        """Whether settings have the margins on an arm that `check` asks for, wherever a motion begins or ends."""
        least = self.least(late)
        found = (short for _, short in self._resting(settings, arm, self.motions, late))
        return all(short is None or _stands(short, least) for short in found)

    def check(
        self,
        settings: ControlSettings,
        arm: ArmParameters,
        motions: Sequence[Motion] | None = None,
        late: float = 0.0,
        in_force: ControlSettings | None = None,
    ) -> ExpectedTracking:
        """Predicts the performance of settings on an arm and refuses bad ones.

        An arm that has changed may have small margins with the settings that it works with. More time for its motions
        changes none of them, and may be what it needs before anything else is accepted.

        Args:
            settings: settings to be uploaded.
            arm: model of the arm, which takes the place of the plant.
            motions: motions that must keep to their paths; None for all that the arm makes at work.
            late: ticks by which commands act later than they did.
            in_force: settings in force; those that differ by no more than a longer time need only be stable.

        Raises:
            Refused: a value is out of bounds, a margin is too small, or a motion leaves its path; the message says
                which and why.
        """
        least = self.least(late)
        if in_force is not None and settings == replace(in_force, target_time=settings.target_time):
            least = least if settings.target_time < in_force.target_time else 0.0
        try:
            check_bounds(settings)
            resting = self._margins(settings, arm, self.motions if motions is None else motions, late, least)
            prediction = self.predict(settings, arm, motions, late)
        except (ParameterError, DivergenceError) as error:
            raise Refused(str(error)) from None
        worst, most = max(prediction.tracking), WORST_TRACKING[settings.law]
        if worst > most:
            joint, motion = prediction.tracking.index(worst) + 1, prediction.worst
            raise Refused(
                f"{motion.start} to {motion.goal}: joint {joint} would leave its path by {worst:.3g} rad, expected at"
                f" most {most:g} rad"
            )
        return replace(
            prediction,
            spectral_radius=max(case.margins.spectral_radius for case in resting),
            disk_margin=min(case.margins.disk for case in resting),
        )

    def expected_tracking(
        self,
        settings: ControlSettings,
        in_force: ControlSettings,
        arm: ArmParameters | None = None,
        late: float = 0.0,
    ) -> JointVector:
        """The largest distance of each joint from its path that `check` predicts, rad; on the controller's model of
        the arm if no other is given.

        Raises:
            Refused: as of `check`.
        """
        return self.check(settings, arm or settings.model, late=late, in_force=in_force).tracking

    def predict(
        self,
        settings: ControlSettings,
        arm: ArmParameters,
        motions: Sequence[Motion] | None = None,
        late: float = 0.0,
    ) -> ExpectedTracking:
        """Predicts the performance of settings on an arm, good or bad; margins at rest are not checked.

        All motions that the arm makes at work if none are named: among bodies it goes along the ways between them,
        and never from place to place. Motions with a box are simulated with a box of the mass that the controller
        assumes and with a heavier one: near the voltage limit a few grams decide whether an arm can follow its path.

        Raises:
            DivergenceError: the state of the arm is no longer finite.
        """
        heavier = settings.payload + self._heavier
        if motions is None:
            made = self.expect(settings, arm, settings.payload, late)
            made += self.expect(settings, arm, heavier, late, loaded=True)
        else:
            loaded = [motion for motion in motions if motion.carries]
            made = list(zip(motions, self.simulate(settings, arm, settings.payload, motions, late), strict=True))
            made += zip(loaded, self.simulate(settings, arm, heavier, loaded, late), strict=True)
        found = [figures for _, figures in made]
        tracking = np.array([figures.tracking_max for figures in found])
        worst = made[int(tracking.max(axis=1).argmax())][0]
        volts = np.max([figures.peak_volts for figures in found], axis=0)
        saturated = max(figures.saturated for figures in found)
        rms = float(np.sqrt(np.mean([np.square(figures.tracking_rms) for figures in found])))
        return ExpectedTracking(
            joint_vector(tracking.max(axis=0)), rms, joint_vector(volts), saturated, worst, 0.0, 0.0
        )

    def simulate(
        self,
        settings: ControlSettings,
        arm: ArmParameters,
        box: float,
        motions: Sequence[Motion] | None = None,
        late: float = 0.0,
    ) -> list[Figures]:
        """Simulates motions, with a box of a mass (kg) where one is carried, and returns the figures of each.

        Commands act some ticks later than they did.

        Raises:
            DivergenceError: the state of the arm is no longer finite.
        """
        chosen, effects = self.motions if motions is None else motions, later(self._effects, late)
        cases = (motion_case(motion, settings, arm, box, self.task, effects) for motion in chosen)
        return [self._simulator.run(case).figures for case in cases]

    def expect(
        self, settings: ControlSettings, arm: ArmParameters, box: float, late: float = 0.0, loaded: bool = False
    ) -> list[tuple[Motion, Figures]]:
        """All motions that the arm makes at work, or those with a box, in one order, and the figures of each.

        They lead from place to place, or along the ways between bodies.

        Args:
            settings: settings of the controller.
            arm: the arm.
            box: mass of the box where one is carried, kg.
            late: ticks by which commands act later than they did.
            loaded: whether only motions with a box are asked for.

        Raises:
            DivergenceError: the state of the arm is no longer finite.
        """
        if not self._via:
            motions = [motion for motion in self.motions if motion.carries or not loaded]
            return list(zip(motions, self.simulate(settings, arm, box, motions, late), strict=True))
        legs = [leg for leg in self._legs if leg.carries or not loaded]
        return [(Motion(*leg.names, leg.carries), self._along(leg, settings, arm, box, late)) for leg in legs]

    def _along(self, leg: Leg, settings: ControlSettings, arm: ArmParameters, box: float, late: float) -> Figures:
        case = MotionCase(
            leg.goal,
            settings,
            leg.start,
            arm=arm,
            payload=box if leg.carries else 0.0,
            carries=leg.carries,
            duration=leg.duration(settings.target_time) + TAIL,
            effects=later(self._effects, late),
        )
        return self._between_bodies.run(case).figures

    def _margins(
        self, settings: ControlSettings, arm: ArmParameters, motions: Sequence[Motion], late: float, least: float
    ) -> list[Case]:
        """The margins where motions begin and end; delays longer than what is demanded are not looked at.

        Raises:
            Refused: a margin is below this share of what is demanded of the law; the message says which, where, and
                what is.
        """
        found = []
        for case, short in self._resting(settings, arm, motions, late):
            if short is not None and not _stands(short, least):
                raise Refused(f"{case}: {short.text}")
            found.append(case)
        return found

    def _resting(
        self, settings: ControlSettings, arm: ArmParameters, motions: Sequence[Motion], late: float = 0.0
    ) -> Iterator[tuple[Case, Shortfall | None]]:
        """The margins where motions end, and where they begin, and what falls short there of what is demanded."""
        demands, effects = DEMANDS[settings.law], later(self._effects, late)
        ends = [(motion.goal, motion.carries) for motion in motions]
        begins = [(motion.start, motion.carries) for motion in motions]
        for place, carries in dict.fromkeys(ends + begins):
            payload = settings.payload if carries else 0.0
            pose = Pose(place, angles_of(place, self.task))
            after = lateness(effects)
            loop = linear_loop(self._simulator.controller, settings, arm, payload, pose.theta, after, effects)
            case = Case(pose, payload, margins(loop, demands.delay))
            yield case, demands.shortfall(case.margins)


def _stands(short: Shortfall, least: float) -> bool:
    """Whether what falls short of a demand is stable, and has at least a share of what is demanded."""
    return short.name != UNSTABLE and short.share >= least


def motion_case(
    motion: Motion,
    settings: ControlSettings,
    arm: ArmParameters,
    box: float,
    task: Task = DEFAULT_TASK,
    effects: Effects = NO_EFFECTS,
) -> MotionCase:
    """The case of one of the motions of the cell, with a box of a mass (kg) if one is carried."""
    return MotionCase(
        motion.goal,
        settings,
        angles_of(motion.start, task),
        arm=arm,
        payload=box if motion.carries else 0.0,
        carries=motion.carries,
        duration=settings.target_time + TAIL,
        effects=effects,
    )
