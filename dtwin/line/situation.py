"""What a line is at one moment, for simulations that go on from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dtwin.bus.line.situation import PlantNow


@dataclass(frozen=True, slots=True)
class Situation:
    """A line at one moment.

    Attributes:
        plant: its plant.
        set_ups: number of set-ups that each zone has counted, by its name.
        done_by: the station that has last done each job in a zone, by the names of both.
        blocks: the state of its blocks, for blocks of the same kind (`Exchange.resume`).
    """

    plant: PlantNow
    set_ups: dict[str, int]
    done_by: dict[str, dict[str, str]]
    blocks: Any
