"""Colours (RGB) of everything drawn; the viewer's background may be dark or light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dtwin.task import RGB

JOINTS: Final[tuple[RGB, RGB, RGB]] = ((86, 204, 242), (255, 183, 77), (190, 148, 255))
"""Colours of joints 1 to 3, which differ from those of the boxes."""
TARGET: Final[RGB] = (150, 150, 150)
GRIPPER: Final[RGB] = (150, 160, 170)
PAYLOAD: Final[RGB] = (255, 183, 77)
LIMIT: Final[RGB] = (200, 80, 80)
LABEL: Final[RGB] = (15, 15, 15)
FORCE: Final[RGB] = (214, 40, 160)
TRAIL: Final[RGB] = (255, 160, 60)
MARKS: Final[Mapping[str, RGB]] = {"fault": (235, 50, 45), "finding": (240, 100, 220), "stop": (250, 190, 40)}
"""of the moments that are worth a look"""
GHOST: Final[RGB] = (60, 120, 220)
PLAN: Final[RGB] = (40, 90, 200)
_FURTHER: Final[tuple[RGB, ...]] = ((0, 158, 115), (213, 94, 0), (204, 121, 167), (0, 114, 178), (160, 130, 60))


def joint_colour(number: int) -> RGB:
    """Colour of a joint, or of a kind of box, counted from 0; they repeat after eight."""
    colours = (*JOINTS, *_FURTHER)
    return colours[number % len(colours)]
