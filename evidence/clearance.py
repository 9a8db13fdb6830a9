"""The paths of the cell's sequence, swept through the geometry of the cell.

The function blocks plan every way of the cell, for an arm that follows them exactly: the start from hanging, and for
each colour the way to the place and back. All poses on the way are held against the shapes of trays, belt, floor and
boxes. So are the ways that the blocks find from free poses drawn at random, and from poses in which the arm hangs
after whole turns of its joints.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS
from dtwin.controller.sequence import AMONG_BODIES, HELP
from dtwin.controller.settings import ControlSettings
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.clearance import FARTHEST, Clearance, Nearest
from dtwin.errors import ParameterError
from dtwin.parameters import HANGING, JOINTS, PERIOD, PICKUP, PLACES, GripperParameters, JointVector, joint_vector
from dtwin.pictures import COLOURS, new_figure
from dtwin.signals import NO_COLOUR, Sensors
from evidence.experiment import ExperimentCommand
from evidence.report import Picture, Report, page, table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STRIDE: Final = 3
"""Number of ticks between two poses that are checked."""
POSES: Final = 300
"""Number of random free poses from which the blocks look for a way."""
_TURNS: Final = (-2 * math.pi, 0.0, 2 * math.pi)
"""Turns of joints 2 and 3 with which the arm may hang, rad; joint 1 hangs at -pi/2, or a turn further."""
_LONGEST: Final = 12000
"""Number of ticks after which a sequence that does not end is given up."""
OPEN: Final = GripperParameters().opened
"""Angle of the open gripper, rad."""
_GRIPPER_SPEED: Final = 0.02
"""Angle by which the gripper moves in a tick, rad."""


class LegClearance(msgspec.Struct, frozen=True):
    """How near the arm comes to anything on one leg of its way.

    Attributes:
        place: place that the way leads to or comes from; "" for the way from hanging to the pickup point.
        start: where the leg begins.
        end: where it leads.
        carries: whether a box is carried.
        distance: shortest distance, m; `FARTHEST` for that or more.
        arm: part of the arm that comes nearest.
        other: what it comes nearest to.
    """

    place: str
    start: str
    end: str
    carries: bool
    distance: float
    arm: str
    other: str


class StartUps(msgspec.Struct, frozen=True):
    """What the blocks did from poses anywhere.

    Attributes:
        poses: number of free poses.
        free: ways that were found and touch nothing.
        helpless: poses from which no way is known, so that the arm stood and help was called for.
        touching: ways on which something was touched.
        distance: shortest distance on all ways that were found, m; `FARTHEST` for that or more.
        arm: part of the arm that came nearest.
        other: what it came nearest to.
    """

    poses: int
    free: int
    helpless: int
    touching: int
    distance: float
    arm: str
    other: str


class Clearances(msgspec.Struct, frozen=True):
    """The clearances of all ways of the cell: its own legs, and those from random poses and from hanging."""

    legs: list[LegClearance]
    random: StartUps
    hanging: StartUps


def is_free(leg: LegClearance) -> bool:
    """Whether nothing is touched on a leg but the belt by the box that is lifted from it."""
    return leg.distance > 0 or (leg.start == "pickup" and leg.arm == "box_held" and leg.other == "conveyor_belt")


def keeps_clear(found: Clearances) -> bool:
    """Whether no way of the cell touches anything that it must not."""
    return all(map(is_free, found.legs)) and not found.random.touching + found.hanging.touching


def clearance_report(found: Clearances) -> Report:
    """The page of the clearances."""
    legs = [
        [
            leg.place,
            leg.start,
            leg.end,
            "held" if leg.carries else "",
            f"{1000 * leg.distance:.1f}",
            f"{leg.arm} and {leg.other}" if leg.other else "nothing within reach",
        ]
        for leg in found.legs
    ]
    starts = [
        [
            name,
            *map(str, (ups.poses, ups.free, ups.helpless, ups.touching)),
            f"{1000 * ups.distance:.1f}",
            f"{ups.arm} and {ups.other}",
        ]
        for name, ups in (("random", found.random), ("hanging", found.hanging))
    ]
    return page(
        "Clearances",
        "The function blocks plan every way of the cell for an arm that follows them exactly, and all poses on the "
        "way are held against the shapes of trays, belt, floor and boxes. A box on the belt under it does not count.",
        "## Ways of the cell",
        table(["place", "from", "to", "box", "clearance, mm", "between"], legs),
        Picture(
            _chart(found.legs),
            "Shortest distance of arm, jaws and held box from anything else on every leg of the ways to the places "
            "and back, as the function blocks plan them. Blue without a box, orange with one; a bar that ends at "
            f"the right edge stands for {1000 * FARTHEST:g} mm or more.",
        ),
        "## Starts from anywhere",
        table(["poses", "number", "free way", "call for help", "touch", "nearest, mm", "between"], starts),
    )


def _chart(legs: Sequence[LegClearance]) -> Figure:
    figure = new_figure(9, 0.24 * len(legs) + 1.2)
    axis = figure.subplots()
    colours = [COLOURS[1] if leg.carries else COLOURS[0] for leg in legs]
    axis.barh(range(len(legs)), [1000 * leg.distance for leg in legs], color=colours)
    axis.set_yticks(range(len(legs)), [f"{leg.start} - {leg.end}" for leg in legs], fontsize=7)
    axis.set(xlabel="clearance, mm", xlim=(0, 1000 * FARTHEST))
    axis.invert_yaxis()
    axis.grid(alpha=0.3, axis="x")
    return figure


@dataclass(frozen=True, slots=True)
class _Pose:
    theta: JointVector
    gripper: float
    carries: bool
    start: str
    end: str


def clearances(model_file: Path = MODEL_FILE, blocks: Path = BLOCKS, seed: int = 0) -> Clearances:
    """The clearances of all ways of the cell, and of those from anywhere.

    Args:
        model_file: MJCF file of the cell.
        blocks: folder of the function-block library.
        seed: number of the random generator of poses.

    Raises:
        DtwinError: the model file or the blocks cannot be used, or a sequence does not come to its end.
    """
    shapes = Clearance(model_file)
    random = start_ups(shapes, random_poses(shapes, POSES, seed), blocks)
    return Clearances(sweep(shapes, blocks), random, start_ups(shapes, hanging_poses(), blocks))


def sweep(shapes: Clearance, blocks: Path = BLOCKS) -> list[LegClearance]:
    """The clearances of all legs of the cell's own ways, in their order.

    Raises:
        DtwinError: the blocks cannot be used, or the sequence does not come to its end.
    """
    legs: dict[tuple[str, str, str, bool], Nearest] = {}
    for colour in PLACES:
        for tick, pose in enumerate(_poses(colour, blocks)):
            started = pose.start not in ("here", "before pickup")
            key = (colour if started and pose.end != "before pickup" else "", pose.start, pose.end, pose.carries)
            if tick % STRIDE and key in legs:
                continue
            # The tray has carried its box away before the arm is behind the places.
            lies = pose.start in (colour, f"above {colour}", f"near {colour}")
            boxes = () if pose.carries else (colour, "pickup") if lies else ("pickup",)
            nearest = shapes.nearest(pose.theta, pose.gripper, pose.carries, boxes)
            legs[key] = min(legs.get(key, Nearest(FARTHEST, "", "")), nearest)
    return [LegClearance(*key, *nearest) for key, nearest in legs.items()]


def random_poses(shapes: Clearance, count: int, seed: int) -> list[JointVector]:
    """Free poses, angles uniform over a turn.

    Args:
        shapes: arm and cell, with a box at the pickup point.
        count: number of poses.
        seed: number of the random generator.
    """
    generator = np.random.default_rng(seed)
    found: list[JointVector] = []
    while len(found) < count:
        theta = joint_vector(generator.uniform(-math.pi, math.pi, JOINTS))
        if shapes.nearest(theta, OPEN, False, ("pickup",)).distance > 0:
            found.append(theta)
    return found


def hanging_poses() -> list[JointVector]:
    """Poses in which an arm may hang that has fallen from anywhere: each joint whole turns further or not."""
    return [(first, *rest) for first in (HANGING[0], HANGING[0] + 2 * math.pi) for rest in product(_TURNS, _TURNS)]


def start_ups(shapes: Clearance, poses: Sequence[JointVector], blocks: Path = BLOCKS) -> StartUps:
    """Lets the blocks find a way from each of some poses to the pickup point, for an arm that follows it exactly.

    Args:
        shapes: arm and cell.
        poses: free poses, rad.
        blocks: folder of the function-block library.

    Raises:
        DtwinError: the blocks cannot be used, or a way does not come to its end.
    """
    controller = EmbeddedController(ControlSettings(target_time=1.0), blocks, AMONG_BODIES)
    fresh = controller.resource.snapshot()
    nearest = Nearest(FARTHEST, "", "")
    helpless = touching = 0
    for pose in poses:
        controller.resource.restore(fresh)
        way = _start_up(controller, pose)
        if way is None:
            helpless += 1
            continue
        found = min(shapes.nearest(theta, OPEN, False, ("pickup",)) for theta in way)
        touching += found.distance <= 0
        nearest = min(nearest, found)
    return StartUps(len(poses), len(poses) - helpless - touching, helpless, touching, *nearest)


def _start_up(controller: EmbeddedController, theta: JointVector) -> list[JointVector] | None:
    """The poses on the way to the pickup point, None if help is called for."""
    way = [theta]
    for tick in range(_LONGEST):
        controller.step(Sensors(tick, tick * PERIOD, theta, OPEN, False, NO_COLOUR))
        if controller.resource.read(HELP):
            return None
        if controller.target() != theta:
            theta = controller.target()
            way.append(theta)
        if theta == PICKUP.theta:
            return way[::STRIDE]
    raise ParameterError(f"the start from {way[0]}: expected it to end within {_LONGEST * PERIOD:.0f} s")


def _poses(colour: str, blocks: Path) -> Iterator[_Pose]:
    """The poses from hanging to the pickup point, to the place of a colour, and back to the pickup point."""
    controller = EmbeddedController(blocks=blocks, sequence=AMONG_BODIES)
    theta, gripper = HANGING, OPEN
    start = end = "here"
    carried = False
    for tick in range(_LONGEST):
        waits = not carried
        sensors = Sensors(tick, tick * PERIOD, theta, gripper, waits, colour if waits else NO_COLOUR)
        command = controller.step(sensors)
        destination = str(controller.resource.read("SEQUENCE.DESTINATION"))
        if destination != end:
            start, end = end, destination
        carried = carried or end == "between"
        if carried and end == "pickup" and theta == PICKUP.theta:
            return
        theta = controller.target()
        closed = AMONG_BODIES.box_angle
        step = _GRIPPER_SPEED if command.volts[3] > 0 else -_GRIPPER_SPEED
        gripper = min(max(gripper + step, closed), OPEN)
        yield _Pose(theta, gripper, command.box_gripped, start, end)
    raise ParameterError(f"the sequence for a {colour} box: expected it to end within {_LONGEST * PERIOD:.0f} s")


@dataclass(frozen=True)
class ExperimentClearance(ExperimentCommand[Clearances]):
    """Sweep the planned paths of the cell with contact through its geometry, also those from 300 random free poses.

    The status is 1 if the arm touches anything on its way; a box on the belt under it does not count.
    """

    name: ClassVar = "clearance"

    mjcf: Path = MODEL_FILE
    """MJCF file of the cell."""
    blocks: Path = BLOCKS
    """Folder of the function blocks that plan the paths."""

    def measure(self, progress: Progress) -> Clearances:
        return clearances(self.mjcf, self.blocks, self.seed)

    def report(self, result: Clearances) -> Report:
        return clearance_report(result)

    def figures(self, result: Clearances) -> dict[str, Any]:
        found: dict[str, Any] = msgspec.to_builtins(result)
        return found

    def passed(self, result: Clearances) -> bool:
        return keeps_clear(result)
