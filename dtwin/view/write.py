"""A finished run as a Rerun recording."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec
import rerun as rr

from dtwin.errors import RecordingError
from dtwin.logs.log import COLUMNS, Log
from dtwin.parameters import ArmParameters
from dtwin.run.hidden import HiddenLog
from dtwin.run.prediction import believed_by_controller
from dtwin.task import task_of
from dtwin.view.boxes import grasps, waiting
from dtwin.view.hidden import hidden_views, log_hidden
from dtwin.view.layout import blueprint, extent_of
from dtwin.view.saving import saving
from dtwin.view.scene import Scene
from dtwin.view.series import log_events, log_limits, log_plots, log_states, log_styles, stream_of
from dtwin.view.story import Story, log_marks, log_story_styles, marks

_PART: Final = 1 << 15
"""Number of ticks sent at once, a multiple of the scene's stride."""
_NOMINAL: Final = ArmParameters()


def write_recording(
    log: Log, model_file: Path, path: Path, arm: ArmParameters = _NOMINAL, hidden: HiddenLog | None = None
) -> None:
    """Writes a run as an .rrd file with a prepared layout; the file appears complete or not at all.

    Equal runs have equal contents and the same recording id; Rerun's own chunk ids still differ from file to file.

    Args:
        log: the run, of at least one tick.
        model_file: MJCF of the cell.
        arm: arm of the run, whose link lengths are drawn.
        hidden: hidden truth of the same ticks, drawn beside what the twin of the data sheet's arm believes; None on
            the ideal machine.

    Raises:
        ModelError: the model cannot be drawn, or what the log says of its controller is not that of a run.
        RecordingError: the log is empty, or the path cannot be written.
    """
    if not len(log):
        raise RecordingError(f"{path}: expected a log of at least one tick to draw")
    scene = Scene(model_file, arm, task_of(log.metadata), believed_by_controller(log.metadata))
    stream = open_stream(log)
    layout = blueprint(extent_of(log, scene.task), *(hidden_views(log, hidden, _NOMINAL) if hidden else ()))
    with saving(stream, path, layout):
        log_run(stream, scene, log, hidden)
        log_marks(stream, marks(log.events))


def log_run(stream: rr.RecordingStream, scene: Scene, log: Log, hidden: HiddenLog | None = None) -> None:
    """Sends everything that is drawn of a log, and of the hidden truth of the same ticks if there is some."""
    waits, carried = waiting(log), grasps(log)
    scene.log_geometry(stream, float(log.columns["t"][0]))
    log_styles(stream)
    log_story_styles(stream)
    log_limits(stream, log)
    Story().send(stream, log)
    for start in range(0, len(log), _PART):
        part = log.part(start, start + _PART)
        scene.log_motion(stream, part)
        log_plots(stream, part)
        # Otherwise an hour of data would wait in memory for Rerun's writer.
        stream.flush()
    if hidden is not None:
        log_hidden(stream, log, hidden, _NOMINAL)
    if hidden is None or not hidden.has_touches:
        # Otherwise boxes are bodies, which are drawn where they are.
        scene.log_boxes(stream, log, waits, carried)
    log_states(stream, log, waits, carried, scene.task)
    log_events(stream, log.events)


def open_stream(log: Log, of: str = "run") -> rr.RecordingStream:
    """A stream whose id is the digest of a log and of what is made of it, by which the viewer tells them apart."""
    notes = msgspec.json.encode((of, log.events, dict(log.metadata)), order="sorted")
    return stream_of(notes, (log.columns[name] for name in COLUMNS))
