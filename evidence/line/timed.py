"""A line whose arms only take time, under blocks of any kind."""

from __future__ import annotations

from collections.abc import Mapping

from dtwin.line.control import Control, Exchange
from dtwin.line.floor import check_boxes
from dtwin.line.line import CYCLE, Line
from dtwin.line.plant import Plant
from dtwin.line.station import TimedStation, WorkTimes


class TimedLine:
    """A line at work, which looks for every box in every cycle.

    Args:
        line: the line.
        blocks: its blocks, which may not answer.
        times: how long the work of each station takes, by its name.

    Attributes:
        plant: the plant.
        control: the control, which asks the blocks.
    """

    def __init__(self, line: Line, blocks: Exchange, times: Mapping[str, WorkTimes]) -> None:
        self.plant = Plant(line, {name: TimedStation(needed) for name, needed in times.items()})
        self.control = Control(line, blocks, patient=True)
        self.control.set_up(line.assignment)

    def work(self, seconds: float) -> None:
        """Works for a time, s. Raises DtwinError: a box has vanished."""
        for _ in range(round(seconds / CYCLE)):
            self.plant.advance()
            self.control.step(self.plant)
            check_boxes(self.plant)
