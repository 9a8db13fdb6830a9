"""Recordings as pictures."""

from __future__ import annotations

import io
from typing import Annotated, Final

from mcp.server.mcpserver import Image
from pydantic import Field

from dtwin.ai.station import Station
from dtwin.ai.tools.look import Looking
from dtwin.errors import RecordingError
from dtwin.logs.reading import read_log
from dtwin.pictures import COLOURS, DARK, new_figure

DPI: Final = 80
BIGGEST: Final = 64 << 20
"""Greatest size of a log that is drawn, bytes."""


class Pictures:
    """Draws logs.

    Args:
        station: where the AI stands.
    """

    def __init__(self, station: Station) -> None:
        self._folder = station.files.recordings
        self._looking = Looking(station)

    def recording_picture(
        self, name: Annotated[str, Field(max_length=100, description="Name of a log; see `recordings`")]
    ) -> Image:
        """A picture of a log: measured angles on their paths, and voltages. No text of it is drawn."""
        self._looking.check_log(name)
        assert self._folder is not None
        path = self._folder / name
        if path.stat().st_size > BIGGEST:
            raise RecordingError(f"{path.name}: expected at most {BIGGEST >> 20} MiB")
        log = read_log(path)
        figure = new_figure(9, 6)
        *joints, last = figure.subplots(4, 1, sharex=True)
        time, measured = log.columns["t"], log.stack("measured")
        target, volts = log.stack("target"), log.stack("volts")
        for joint, axis in enumerate(joints):
            axis.plot(time, measured[:, joint], color=COLOURS[joint], lw=2.0)
            axis.plot(time, target[:, joint], color=DARK, lw=0.8, ls="--")
            axis.set_ylabel(f"joint {joint + 1}, rad")
            last.step(time, volts[:, joint], color=COLOURS[joint], lw=0.8, where="post")
        last.set_ylabel("voltage, V")
        last.set_xlabel("time, s")
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=DPI)
        return Image(data=buffer.getvalue(), format="png")
