"""Margins of any serial arm under its controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dtwin.api.arguments import AnyPath, checked
from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ParameterError
from dtwin.run.margins import chain
from dtwin.run.margins.chain import JointMargins
from dtwin.run.margins.gears import control_of
from dtwin.simulation.margins.poses import POSES

_LARGEST_LATE: Final = 10
"""Most ticks after which an arm may obey."""


@checked
def margins_arm(arm: AnyPath, *, poses: int = POSES, late: int = 0) -> Mapping[str, JointMargins]:
    """Computes what change of any serial arm its controller stands, as `dtwin margins --arm` does.

    Args:
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        poses: number of poses that are drawn, at least 1.
        late: ticks from a command until it acts, 0 to 10.

    Returns:
        The least margins over all poses by the names of the joints: gain and weakest (factors of the drive's
        constant), phase (rad), delay (s), modulus, stable.

    Raises:
        DtwinError: a file cannot be used, or a value is out of range.
    """
    if poses < 1:
        raise ParameterError(f"poses: expected at least 1, got {poses}")
    if not 0 <= late <= _LARGEST_LATE:
        raise ParameterError(f"late: expected 0 to {_LARGEST_LATE} ticks, got {late}")
    known = arm_of(str(arm))
    found = chain.margins(known, control_of(known, late), poses, late=late)
    return {joint.name: one for joint, one in zip(known.joints, found, strict=True)}
