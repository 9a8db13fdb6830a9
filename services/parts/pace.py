"""The paces of a cell; `services/emulator.py` says how their ticks differ."""

from __future__ import annotations

from typing import Literal

Pace = Literal["realtime", "lockstep", "free"]
"""realtime: ticks on the wall clock; lockstep: every tick waits for its command; free: no tick waits."""
