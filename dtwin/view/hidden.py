"""What the machine hides, beside commands and what the twin believes: drives, friction, gears and contacts."""

from __future__ import annotations

from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.emulation.contact.scene import HALF
from dtwin.logs.log import Log
from dtwin.parameters import COULOMB_WIDTH, ArmParameters
from dtwin.run.hidden import DriveColumns, HiddenLog, TouchColumns
from dtwin.task import DEFAULT_TASK
from dtwin.view import scene, style
from dtwin.view.layout import GRIPPER_ANGLES, VOLTS, plot_view, reach
from dtwin.view.series import GRIPPER, send_lines, time_column

Array = NDArray[np.float64]

VOLTAGE: Final = "drive/voltage"
FRICTION: Final = "drive/friction"
GEAR: Final = "drive/gear"
ENCODER: Final = "drive/encoder"
GRIP: Final = "contact/grip"
SLIP: Final = "contact/slip"
FORCES: Final = f"{scene.ROOT}/forces"
BODIES: Final = f"{scene.BOXES}/bodies"
METRES_PER_NEWTON: Final = 0.02
"""Length of the arrow of a force."""
_LEAST: Final = 0.02
"""Smallest force that gets an arrow, N."""
_LONGEST: Final = 0.1
"""Length to which the arrow of a blow is cut, m."""
_SHOWN: Final = 10.5
"""Largest force of the plot, N: the jaw strikes a box with ten times the force that it then presses with."""
_SLIP: Final = 2.0
"""Least slip that its plot can show, mm."""
_TORQUE: Final = 0.5
"""Least friction that its plot can show, N m."""
_AHEAD: Final = 20.0
"""Least deflection of gears that its plot can show, mrad."""
_READ: Final = 5.0
"""Least error of encoders that its plot can show, mrad."""


def hidden_views(log: Log, hidden: HiddenLog, believed: ArmParameters) -> list[rrb.Vertical]:
    """Tabs of what there is: contact first, then drives, friction, gears and encoders.

    Args:
        log: the run.
        hidden: the hidden truth of its ticks.
        believed: as for `log_hidden`.
    """
    tabs = []
    if (touches := hidden.touches()) is not None:
        slips = (0.0, reach(1e3 * touches.slip, _SLIP))
        tabs.append(
            rrb.Vertical(
                plot_view("Forces of the pads (N)", GRIP, (0.0, _SHOWN)),
                plot_view("Slip of the held box along the pads (mm)", SLIP, slips),
                plot_view("Gripper angle (rad)", GRIPPER, GRIPPER_ANGLES),
                name="Contact",
            )
        )
    if (drives := hidden.drives()) is not None:
        theta = log.stack("theta")
        torques = _around(np.hstack((drives.friction, _friction(log, believed))), _TORQUE)
        joints = (1, 2, 3)
        volts = [
            plot_view(f"Motor {j}: voltage commanded, acting (V)", f"{VOLTAGE}/joint_{j}", VOLTS) for j in joints
        ]
        friction = [
            plot_view(f"Joint {j}: friction believed, acting (N m)", f"{FRICTION}/joint_{j}", torques) for j in joints
        ]
        ahead = _around(1e3 * (drives.motors - theta), _AHEAD)
        gear = plot_view("Motor ahead of its link (mrad)", GEAR, ahead)
        read = _around(1e3 * (log.stack("measured") - theta), _READ)
        encoder = plot_view("Encoder reading ahead of the joint (mrad)", ENCODER, read)
        tabs += [
            rrb.Vertical(*volts, name="Voltages"),
            rrb.Vertical(*friction, name="Friction"),
            rrb.Vertical(gear, encoder, name="Gears and encoders"),
        ]
    return tabs


def _around(values: Array, least: float) -> tuple[float, float]:
    """A range that is alike on both sides of 0."""
    end = reach(values, least)
    return -end, end


def _friction(log: Log, believed: ArmParameters) -> Array:
    """The friction that a twin believes in, at the true velocities, (ticks, 3), N m."""
    omega = log.stack("omega")
    return np.array(believed.damping) * omega + np.array(believed.coulomb) * np.tanh(omega / COULOMB_WIDTH)


def log_hidden(stream: rr.RecordingStream, log: Log, hidden: HiddenLog, believed: ArmParameters) -> None:
    """Sends the hidden truth of a run.

    Args:
        stream: where it is sent.
        log: the run.
        hidden: the hidden truth of its ticks.
        believed: arm whose friction D w + mu tanh(w / width), at the true velocity, is what the twin believes.
    """
    times = time_column(log.columns["t"])
    if (drives := hidden.drives()) is not None:
        _log_drives(stream, times, log, drives, believed)
    if (touches := hidden.touches()) is not None:
        _log_touches(stream, times, log, touches)


def _log_drives(
    stream: rr.RecordingStream, times: rr.TimeColumn, log: Log, drives: DriveColumns, believed: ArmParameters
) -> None:
    # What acts at a sample answers the sample before; the command of a row is only about to be given.
    commanded = np.vstack([np.zeros(3), log.stack("volts")[:-1, :3]])
    friction = _friction(log, believed)
    for joint in (1, 2, 3):
        i, colour = joint - 1, style.JOINTS[joint - 1]
        for root, name, twin, true in (
            (VOLTAGE, "commanded", commanded, drives.volts),
            (FRICTION, "believed", friction, drives.friction),
        ):
            send_lines(stream, times, f"{root}/joint_{joint}/acting", ["acting"], [colour], 3.0, true[:, i])
            send_lines(stream, times, f"{root}/joint_{joint}/{name}", [name], [style.TARGET], 1.2, twin[:, i])
    theta = log.stack("theta")
    names = [f"joint {joint}" for joint in (1, 2, 3)]
    send_lines(stream, times, GEAR, names, style.JOINTS, 1.5, 1e3 * (drives.motors - theta))
    send_lines(stream, times, ENCODER, names, style.JOINTS, 1.5, 1e3 * (log.stack("measured") - theta))


def _log_touches(stream: rr.RecordingStream, times: rr.TimeColumn, log: Log, touches: TouchColumns) -> None:
    names = ["fixed pads press", "moving pads press", "pads carry", "most they can carry"]
    colours = (style.JOINTS[0], style.JOINTS[2], style.JOINTS[1], style.LIMIT)
    send_lines(stream, times, GRIP, names, colours, 1.5, touches.grip)
    send_lines(stream, times, SLIP, ["slip"], [style.PAYLOAD], 2.0, 1e3 * touches.slip)

    drawn = np.arange(len(log)) % scene.STRIDE == 0
    moments = time_column(log.columns["t"][drawn])
    force = np.linalg.norm(touches.forces[:, 3:], axis=1)
    of_tick = np.repeat(np.arange(len(log)), touches.contacts)
    shown = (force >= _LEAST) & drawn[of_tick]
    scale = np.minimum(METRES_PER_NEWTON, _LONGEST / force[shown])
    counts = np.bincount(of_tick[shown], minlength=len(log))[drawn]
    stream.log(FORCES, rr.Arrows3D.from_fields(radii=0.0012, colors=style.FORCE), static=True)
    vectors = scale[:, None] * touches.forces[shown, 3:]
    arrows = rr.Arrows3D.columns(origins=touches.forces[shown, :3], vectors=vectors)
    stream.send_columns(FORCES, indexes=[moments], columns=arrows.partition(counts))

    shown = np.repeat(drawn, touches.boxes)
    stream.log(BODIES, rr.Boxes3D.from_fields(fill_mode="solid"), static=True)
    boxes = rr.Boxes3D.columns(
        half_sizes=np.full((int(shown.sum()), 3), HALF),
        centers=touches.poses[shown, :3],
        quaternions=np.roll(touches.poses[shown, 3:], -1, axis=1),
        colors=np.array([DEFAULT_TASK.rgb(colour) for colour in np.array(touches.colours)[shown]], dtype=np.uint8),
    )
    stream.send_columns(BODIES, indexes=[moments], columns=boxes.partition(touches.boxes[drawn]))
