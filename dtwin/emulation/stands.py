"""The stands of a cell where its task has them: belt, trays and rack moved, coloured, added and taken away.

`models/arm.xml` shows the usual task. Only what is drawn and what poses are checked against is changed: in a cell
whose bodies touch, the ways of the arm are known for the usual places alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mujoco

from dtwin.emulation.contact.clearance import Clearance
from dtwin.emulation.model import named_spec, one_line, require
from dtwin.errors import ModelError, ParameterError
from dtwin.parameters import GripperParameters, JointVector
from dtwin.task import DEFAULT_TASK, PICKUP_NAME, BoxStream, Destination, Task

GAP: Final = 0.001
"""Least distance between the arm at a place and everything else, m."""
_HALF: Final = BoxStream().size / 2
"""Half the edge of a box in the file, m."""
_FLOOR: Final = -0.55
_LOWEST: Final = -0.48
"""Height below which no stand has room, m."""
_RACK: Final = (0.15, -0.175)
"""Where the column of the rack stands, x and y, m."""
_LEGS: Final = ("conveyor_leg_1", "conveyor_leg_2")
_GEOMS: Final = ("box_waiting", "box_held", "rack_column", "rack_cap", *_LEGS)
"""Shapes that are changed."""
_USUAL: Final = DEFAULT_TASK.colours
"""Colours of the stands in the file."""
_LIES_AT: Final = ("conveyor_belt", "conveyor_stop")
"""What a box at the pickup point touches."""
_LEG_TOP: Final = -0.038
"""Height of the tops of the legs relative to the pickup point, m."""


def drawn_model(model_file: Path, task: Task) -> mujoco.MjModel:
    """The model of a file with the stands of a task, compiled for who draws it.

    Raises:
        ModelError: the file cannot be used, or lacks the stands that are moved.
    """
    try:
        return arranged(model_file, task).compile()
    except ValueError as error:
        raise ModelError(one_line(model_file, str(error))) from None


def arranged(model_file: Path, task: Task) -> mujoco.MjSpec:
    """The content of a file with the stands of a task.

    Raises:
        ModelError: the file cannot be used, or lacks the stands that are moved.
    """
    spec = named_spec(model_file)
    require(model_file, "body", spec.bodies, ("conveyor", "pickup_belt", "rack", *map("{}_belt".format, _USUAL)))
    require(model_file, "geom", spec.geoms, (*_GEOMS, *map("stand_{}_bracket".format, _USUAL)))
    require(model_file, "material", spec.materials, _USUAL)
    _arrange(spec, task)
    return spec


def _arrange(spec: mujoco.MjSpec, task: Task) -> None:
    half = task.boxes.size / 2
    for name in ("box_waiting", "box_held"):
        spec.geom(name).size = (half, half, half)
    _move_conveyor(spec, task, half)
    rack = spec.body("rack")
    for colour in _USUAL:
        spec.delete(spec.geom(f"stand_{colour}_bracket"))
        spec.delete(spec.body(f"{colour}_belt"))
        spec.delete(spec.material(colour))
    for destination in task.destinations:
        _add_stand(spec, rack, destination, half)
    top = max(place.y for place in task.places.values()) - half - 0.002
    column = spec.geom("rack_column")
    column.size[2] = (top - _FLOOR - 0.006) / 2
    column.pos[2] = top - column.size[2]
    spec.geom("rack_cap").pos[2] = top + 0.003


def check_task(task: Task, model_file: Path, contact: bool) -> None:
    """Checks that the arm reaches every place without touching anything there.

    Args:
        task: the task.
        model_file: MJCF file of the cell.
        contact: whether the bodies of the cell touch.

    Raises:
        ModelError: the model file cannot be used.
        ParameterError: a place is too low for a stand, or the arm touches something there; or the bodies of the cell
            touch, and its places or boxes are not the usual ones.
    """
    if contact:
        if task.destinations != DEFAULT_TASK.destinations or task.pickup != DEFAULT_TASK.pickup:
            raise ParameterError(
                "places: expected the usual ones on a machine with contact, as no ways to others are known there"
            )
        if task.boxes.size != DEFAULT_TASK.boxes.size:
            raise ParameterError(
                f"boxes.size: expected {DEFAULT_TASK.boxes.size:g} m on a machine with contact,"
                f" got {task.boxes.size:g}"
            )
        return
    for name, place in task.all_places.items():
        if place.y < _LOWEST:
            raise ParameterError(f"{name}: expected a height y of at least {_LOWEST} m, got {place.y:g}")
    shapes = Clearance(model_file, task, arranged(model_file, task))
    gripper = GripperParameters()
    for name, place in task.all_places.items():
        for carries, angle in ((True, gripper.closed), (False, gripper.opened)):
            _check_pose(shapes, task, name, place.theta, angle, carries)


def _check_pose(shapes: Clearance, task: Task, name: str, theta: JointVector, gripper: float, carries: bool) -> None:
    others = [other for other in task.all_places if other != name]
    found = shapes.nearest(theta, gripper, carries, others)
    own = shapes.among_links()
    if own.distance < found.distance:
        found = own
    if name == PICKUP_NAME and found.arm == "box_held" and found.other in _LIES_AT:
        return
    if found.distance < GAP:
        place = task.all_places[name]
        how = (
            f"{1000 * found.distance:.1f} mm from" if found.distance > 0 else f"{-1000 * found.distance:.1f} mm into"
        )
        raise ParameterError(
            f"{name}: the arm at ({place.x:g}, {place.y:g}) m would have its {found.arm} {how} {found.other}:"
            f" expected {1000 * GAP:g} mm of room; move the place, or name the other elbow"
        )


def _move_conveyor(spec: mujoco.MjSpec, task: Task, half: float) -> None:
    """Moves the belt to the pickup point; a box of any size lies with its middle there."""
    lower = half - _HALF
    x, z = task.pickup.x, task.pickup.y
    conveyor, belt = spec.body("conveyor"), spec.body("pickup_belt")
    belt.pos = (x + belt.pos[0] - conveyor.pos[0], belt.pos[1], z + belt.pos[2] - conveyor.pos[2] - lower)
    conveyor.pos = (x, conveyor.pos[1], z - lower)
    spec.geom("box_waiting").pos[2] += lower
    spec.site(PICKUP_NAME).pos[2] += lower
    for name in _LEGS:
        leg = spec.geom(name)
        leg.size[2] = (z - lower + _LEG_TOP - _FLOOR) / 2
        leg.pos[2] = _LEG_TOP - leg.size[2]


def _add_stand(spec: mujoco.MjSpec, rack: mujoco.MjsBody, destination: Destination, half: float) -> None:
    """Adds tray and bracket at the place of a colour, as the file has them at the usual ones."""
    colour, place = destination.colour, destination.place
    cell = spec.find_default("cell")
    material = f"tray_{colour}"
    spec.add_material(name=material, rgba=(*(part / 255 for part in destination.rgb), 1.0))
    tray = spec.worldbody.add_body(name=f"{colour}_belt", pos=(place.x, -0.062, place.y))
    plate = tray.add_geom(cell, name=f"{colour}_tray", type=mujoco.mjtGeom.mjGEOM_BOX)
    plate.pos, plate.size, plate.material = (0.0, -0.002, -half - 0.0055), (0.013, 0.084, 0.003), material
    ends = sorted((place.x, _RACK[0]))
    width = (ends[1] - ends[0]) / 2 + 0.012
    bracket = rack.add_geom(cell, name=f"stand_{colour}_bracket", type=mujoco.mjtGeom.mjGEOM_BOX)
    bracket.pos = (sum(ends) / 2 - _RACK[0], 0.018, place.y - half - 0.015)
    bracket.size = (width, 0.012, 0.006)
