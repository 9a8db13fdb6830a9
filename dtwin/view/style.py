"""Colours (RGB) of everything drawn; the viewer's background may be dark or light."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

RGB = tuple[int, int, int]

JOINTS: Final[tuple[RGB, RGB, RGB]] = ((86, 204, 242), (255, 183, 77), (190, 148, 255))
"""Colours of joints 1 to 3, which differ from those of the boxes."""
TARGET: Final[RGB] = (150, 150, 150)
GRIPPER: Final[RGB] = (150, 160, 170)
PAYLOAD: Final[RGB] = (255, 183, 77)
LIMIT: Final[RGB] = (200, 80, 80)
LABEL: Final[RGB] = (15, 15, 15)
FORCE: Final[RGB] = (214, 40, 160)
TRAIL: Final[RGB] = (255, 160, 60)
_BOXES: Final[Mapping[str, RGB]] = {"blue": (52, 112, 236), "red": (224, 52, 46), "green": (44, 172, 74)}


def box_colour(name: str) -> RGB:
    """The colour in which a box is drawn, by the name of its colour; grey when the name is unknown."""
    return _BOXES.get(name, (150, 150, 150))
