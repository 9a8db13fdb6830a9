"""Where an AI stands in a cell: what it hears, what it may ask, and the files that it may read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dtwin.ai.profiles import Doors
from dtwin.ai.trends import Trends
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.console.hub import Hub


@dataclass(frozen=True)
class Station:
    """What the tools work with.

    Attributes:
        doors: the queries that the profile may ask.
        hub: what the cell says.
        trends: the last minutes of the arm.
        clocks: clocks of the server.
        who: name of the AI, for histories and events.
        files: folders and files that may be read.
        alarms: journal of the alarms, which a console keeps.
        pages: folder of the documentation.
    """

    doors: Doors
    hub: Hub
    trends: Trends
    clocks: Clocks
    who: str
    files: Files
    alarms: Path
    pages: Path
