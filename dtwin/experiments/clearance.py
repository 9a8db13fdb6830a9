"""The paths of the cell's sequence, swept through the geometry of the cell.

The function blocks plan every way of the cell, for an arm that follows them exactly: the start from hanging, and for
each colour the way to the place and back. All poses on the way are held against the shapes of trays, belt, floor and
boxes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS
from dtwin.controller.sequence import AMONG_BODIES
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.contact.clearance import FARTHEST, Clearance, Nearest
from dtwin.errors import ParameterError
from dtwin.parameters import HANGING, PERIOD, PICKUP, PLACES, GripperParameters, Triple
from dtwin.signals import NO_COLOUR, Sensors

STRIDE: Final = 3
"""Number of ticks between two poses that are checked."""
_LONGEST: Final = 12000
"""Number of ticks after which a sequence that does not end is given up."""
_GRIPPER_SPEED: Final = 0.02
"""Angle by which the gripper moves in a tick, rad."""


class LegClearance(msgspec.Struct, frozen=True):
    """How near the arm comes to anything on one leg of its way.

    Attributes:
        place: place that the way leads to or comes from; "" for the way from the start to the pickup point.
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


def is_free(leg: LegClearance) -> bool:
    """Whether nothing is touched on a leg but the belt by the box that is lifted from it."""
    return leg.distance > 0 or (leg.start == "pickup" and leg.arm == "box_held" and leg.other == "conveyor_belt")


@dataclass(frozen=True, slots=True)
class _Pose:
    theta: Triple
    gripper: float
    carries: bool
    start: str
    end: str


def sweep(model_file: Path = MODEL_FILE, blocks: Path = BLOCKS) -> list[LegClearance]:
    """The clearances of all legs of the cell's ways, in their order.

    Raises:
        DtwinError: the model file or the blocks cannot be used, or the sequence does not come to its end.
    """
    shapes = Clearance(model_file)
    legs: dict[tuple[str, str, str, bool], Nearest] = {}
    for colour in PLACES:
        for tick, pose in enumerate(_poses(colour, blocks)):
            started = pose.start != "start" and pose.start != "before pickup"
            key = (colour if started and pose.end != "before pickup" else "", pose.start, pose.end, pose.carries)
            if tick % STRIDE and key in legs:
                continue
            # The tray has carried its box away before the arm is behind the places.
            lies = pose.start in (colour, f"above {colour}", f"near {colour}")
            boxes = () if pose.carries else (colour, "pickup") if lies else ("pickup",)
            nearest = shapes.nearest(pose.theta, pose.gripper, pose.carries, boxes)
            legs[key] = min(legs.get(key, Nearest(FARTHEST, "", "")), nearest)
    return [LegClearance(*key, *nearest) for key, nearest in legs.items()]


def _poses(colour: str, blocks: Path) -> Iterator[_Pose]:
    """The poses from hanging to the pickup point, to the place of a colour, and back to the pickup point."""
    controller = EmbeddedController(blocks=blocks, sequence=AMONG_BODIES)
    gripper_data = GripperParameters()
    theta, gripper = HANGING, gripper_data.opened
    start = end = "start"
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
        gripper = min(max(gripper + step, closed), gripper_data.opened)
        yield _Pose(theta, gripper, command.box_gripped, start, end)
    raise ParameterError(f"the sequence for a {colour} box: expected it to end within {_LONGEST * PERIOD:.0f} s")
