"""A run in the Rerun viewer while it runs: a few times a second the new rows are sent in columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
import rerun as rr

from dtwin.bus.twin_messages import MonitoredUnit, MonitoringResiduals, MonitoringVerdict
from dtwin.logs.log import Log, concatenate
from dtwin.parameters import ArmParameters
from dtwin.run.prediction import DATA_SHEET, BelievedArm
from dtwin.task import DEFAULT_TASK, Task
from dtwin.view.boxes import grasps, waiting
from dtwin.view.layout import blueprint, extent_of, live_blueprint, live_extent, sparse_blueprint
from dtwin.view.monitoring import (
    log_monitor_styles,
    log_predictions,
    log_verdicts,
    monitoring_views,
    predictions,
)
from dtwin.view.saving import RecordingFile
from dtwin.view.scene import STRIDE, Scene
from dtwin.view.series import APPLICATION, ERROR, PLOTS, log_events, log_limits, log_plots, log_states, log_styles
from dtwin.view.story import MOST_MARKS, Story, log_marks, log_story_styles, marks
from dtwin.view.viewer import Detail

SCREEN: Final = 4
"""Number of ticks of which a recording in the detail of a screen holds one, 25 Hz, and more where a line bends."""
FILE_TICKS: Final = 1000
"""Number of ticks that are written to a file at once: every part of it costs as much as a second of one line."""
SPARSE: Final = 5
"""Number of ticks of which one is sent sparsely: 20 Hz of the error, 10 Hz of poses."""
SPARSE_TICKS: Final = 200
"""Number of ticks that are sent at once sparsely: such a viewer takes in a few messages with every picture."""
_STATE: Final = ("box_present", "box_colour", "box_gripped")


class Waiting:
    """What waits to be sent.

    Args:
        together: number of ticks that are sent at once.

    Attributes:
        together: the same.
    """

    def __init__(self, together: int) -> None:
        self.together = together
        self._logs: list[Log] = []
        self._residuals: list[MonitoringResiduals] = []
        self._verdicts: list[MonitoringVerdict] = []
        self._units: Mapping[str, MonitoredUnit] = {}

    def add(self, log: Log) -> bool:
        """Takes ticks that follow; whether so many wait that they are sent."""
        self._logs.append(log)
        return sum(map(len, self._logs)) >= self.together

    def add_monitoring(
        self, residuals: Sequence[MonitoringResiduals], verdicts: Sequence[MonitoringVerdict], sparse: bool
    ) -> bool:
        """Takes what a monitor has said; whether that is anything new. Sparsely, nothing else is kept."""
        news = [each for each in verdicts if each.units != self._units]
        self._units = verdicts[-1].units if verdicts else self._units
        if sparse:
            # An opinion a second that says the same takes longer to show than it says.
            residuals, verdicts = (), news
        self._residuals += residuals
        self._verdicts += verdicts
        return bool(news)

    def take(self) -> tuple[Log | None, list[MonitoringResiduals], list[MonitoringVerdict]]:
        """All that waits, which waits no longer; None for no ticks."""
        logs, residuals, verdicts = self._logs, self._residuals, self._verdicts
        self._logs, self._residuals, self._verdicts = [], [], []
        return concatenate(logs, {}) if logs else None, residuals, verdicts


class LiveView:
    """Sends a growing log to a file, a viewer, or both.

    Args:
        model_file: MJCF of the cell.
        arm: arm whose link lengths are drawn.
        file: .rrd file to write, which can be read at any time; None for no file.
        url: URL of a viewer that listens; "" for no viewer.
        monitored: whether predictions and verdicts of a monitor are drawn as well.
        task: task of the cell.
        believed: arm that the twin believes in, which is drawn as a ghost.
        detail: what is sent; with a viewer beside it a file is sent each part at once, and grows by more. Sparsely,
            a tenth of what moves, and of the plots the tracking error alone, to a viewer that draws without a GPU.

    Raises:
        ModelError: the model cannot be drawn.
        NoSpaceError: there is no room for the file.
        RecordingError: the file cannot be written.
    """

    def __init__(
        self,
        model_file: Path,
        arm: ArmParameters,
        file: Path | None,
        url: str = "",
        monitored: bool = False,
        detail: Detail | Literal["sparse"] = "screen",
        task: Task = DEFAULT_TASK,
        believed: BelievedArm = DATA_SHEET,
    ) -> None:
        self._scene = Scene(model_file, arm, task, believed)
        self._stream = rr.RecordingStream(APPLICATION, send_properties=False)
        self._stream.set_log_tick_enabled(False)
        self._stream.set_log_time_enabled(False)
        self._states: Log | None = None
        self._story = Story()
        self._marks = 0
        self._file = None if file is None else RecordingFile(file)
        sinks: list[rr.FileSink | rr.GrpcSink] = [] if self._file is None else [rr.FileSink(self._file.begun)]
        if url:
            sinks.append(rr.GrpcSink(url))
        self._monitored, self._sparse = monitored, detail == "sparse"
        self._full = detail == "full"
        self._waiting = Waiting(SPARSE_TICKS if self._sparse else 0 if url or self._full else FILE_TICKS)
        self._whole: Log | None = None
        extent = live_extent(task)
        tabs = [monitoring_views(extent)] if monitored else []
        self._stream.set_sinks(
            *sinks, default_blueprint=sparse_blueprint(extent) if self._sparse else live_blueprint(extent, *tabs)
        )

    @property
    def ready(self) -> bool:
        """Whether there is room for more in the file."""
        return self._file is None or self._file.has_room

    def add(self, log: Log) -> None:
        """Sends ticks and events that follow those sent before, to a file alone or sparsely many at once.

        What is worth a look is in a file at once, and so is its beginning.
        """
        at_once = not self._sparse and (self._states is None or bool(marks(log.events)))
        if self._waiting.add(log) or at_once:
            self._send_collected()

    def _send_collected(self) -> None:
        log, residuals, verdicts = self._waiting.take()
        if log is not None:
            self._send(log)
        if residuals:
            log_predictions(self._stream, predictions(residuals))
        if verdicts:
            log_verdicts(self._stream, self._scene, verdicts)

    def _send(self, log: Log) -> None:
        if len(log):
            if self._states is None:
                self._scene.log_geometry(self._stream, float(log.columns["t"][0]), self._sparse)
                log_styles(self._stream)
                log_story_styles(self._stream)
                if self._monitored:
                    log_monitor_styles(self._stream, self._scene)
            if self._sparse:
                part = Log({name: column[::SPARSE] for name, column in log.columns.items()})
                self._scene.log_motion(self._stream, part, sparse=True)
                log_plots(self._stream, part, [plot for plot in PLOTS if plot.entity == ERROR])
            else:
                log_limits(self._stream, log)
                every = 1 if self._full else SCREEN
                self._scene.log_motion(self._stream, log, stride=max(STRIDE, every))
                log_plots(self._stream, log, every=every)
            self._add_states(log)
            self._whole = _widened(self._whole, log)
            self._story.send(self._stream, log)
        log_events(self._stream, log.events)
        new = marks(log.events)[: MOST_MARKS - self._marks]
        log_marks(self._stream, new, self._marks)
        self._marks += len(new)
        self._stream.flush()
        if self._file is not None:
            self._file.appear()

    def add_monitoring(self, residuals: Sequence[MonitoringResiduals], verdicts: Sequence[MonitoringVerdict]) -> None:
        """Sends the new residuals, as predictions, and verdicts of a monitor, at once if they say something new."""
        news = self._waiting.add_monitoring(residuals, verdicts, self._sparse)
        if self._states is not None and (news or not self._waiting.together or self._sparse):
            self._send_collected()

    def _add_states(self, log: Log) -> None:
        """Draws the boxes again when the state of one of them has changed."""
        changes = _changes(self._states, log)
        if self._states is not None and not len(changes):
            return
        before = [] if self._states is None else [self._states]
        drawn = sum(map(len, before))
        self._states = concatenate([*before, changes], {})
        waits, carried = waiting(self._states), grasps(self._states)
        self._scene.log_boxes(self._stream, self._states, waits, carried, drawn)
        log_states(self._stream, self._states, waits, carried, self._scene.task, drawn)

    def close(self) -> None:
        """Closes the file, which then opens on the whole run, and the connection to the viewer."""
        self._send_collected()
        if self._file is not None and self._whole is not None and self._file.appeared:
            extent = extent_of(self._whole, self._scene.task)
            tabs = [monitoring_views(extent)] if self._monitored else []
            self._stream.send_blueprint(blueprint(extent, *tabs))
        self._stream.disconnect()
        if self._file is not None:
            self._file.discard()


def _widened(before: Log | None, log: Log) -> Log:
    """The ticks of a growing log that hold its extent: its first and last, and those of its extreme values."""
    whole = log if before is None else concatenate([before, log], {})
    error = whole.stack("target") - whole.angles()
    values = np.column_stack((whole.angles(), whole.stack("target"), error, whole.columns["payload_mass"]))
    values = np.nan_to_num(values)
    kept = np.unique([0, len(whole) - 1, *values.argmin(axis=0), *values.argmax(axis=0)])
    return Log({name: column[kept] for name, column in whole.columns.items()})


def _changes(before: Log | None, log: Log) -> Log:
    """The ticks at which a box state differs from that of the tick before."""
    changed = np.zeros(len(log), dtype=bool)
    held = log.held()
    for values, last in (
        *((log.columns[name], None if before is None else before.columns[name][-1]) for name in _STATE),
        (held, None if before is None else before.held()[-1]),
    ):
        changed[1:] |= values[1:] != values[:-1]
        changed[0] |= last is None or values[0] != last
    return Log(MappingProxyType({name: column[changed] for name, column in log.columns.items()}))
