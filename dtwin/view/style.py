"""Colours (RGB) of everything drawn; the viewer's background may be dark or light."""

from __future__ import annotations

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
