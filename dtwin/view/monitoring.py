"""What a monitor made of a run: residuals, predictions with their band, evidence, and verdicts on the arm itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringResiduals, MonitoringVerdict, UnitState
from dtwin.errors import RecordingError
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters
from dtwin.run.prediction import DATA_SHEET, BelievedArm
from dtwin.signals import MONITOR, Event, EventKind
from dtwin.task import task_of
from dtwin.view import scene, style
from dtwin.view.layout import Extent, blueprint, extent_of, plot_view
from dtwin.view.saving import saving
from dtwin.view.scene import Scene
from dtwin.view.series import time_column
from dtwin.view.story import log_marks, marks
from dtwin.view.write import log_run, open_stream

Array = NDArray[np.float64]

ROOT: Final = "monitor"
BAND: Final = 2.5758
"""standard deviations on either side of the prediction: 99 % of a healthy arm's readings"""
COLOURS: Final[Mapping[UnitState, style.RGB]] = {
    "nominal": (60, 190, 90),
    "may be degrading": (250, 190, 40),
    "failed": (235, 50, 45),
    "not commissioned": (150, 110, 200),
    "unknown": (130, 135, 140),
}
_RESIDUALS_SHOWN: Final = 10.5
"""standard deviations"""
_EVIDENCE_SHOWN: Final = 105.0
"""2 log likelihood ratio: twice the highest threshold that is usual, while that of a fault goes on to thousands"""
_BODIES: Final = ("link_1", "link_2", "link_3", "jaw")
"""what shows the verdicts of the units"""
_TEXT: Final = f"{scene.ROOT}/verdicts/text"
_TEXT_AT: Final = (0.0, -0.02, 0.4)
"""m, above the arm"""
_LEVELS: Final[Mapping[str, rr.TextLogLevel]] = {
    MONITOR + EventKind.FAILED: rr.TextLogLevel.ERROR,
    MONITOR + EventKind.SUSPECTED: rr.TextLogLevel.WARN,
    MONITOR + EventKind.RESTART: rr.TextLogLevel.WARN,
    MONITOR + EventKind.MISFIT: rr.TextLogLevel.WARN,
}
_NOMINAL: Final = ArmParameters()
_BAND_COLOUR: Final[style.RGB] = (110, 120, 130)


class DrawnTrace(Protocol):
    """What is drawn, a row a tick of the log.

    predicted (N, 3) and deviation (N, 3) are the readings expected and their standard deviation, rad; statistic (N,)
    is the evidence of a fault, threshold where it becomes an alarm; verdicts hold from their row on.
    """

    @property
    def predicted(self) -> Array: ...
    @property
    def deviation(self) -> Array: ...
    @property
    def statistic(self) -> Array: ...
    @property
    def threshold(self) -> float: ...
    @property
    def verdicts(self) -> Sequence[tuple[int, MonitoringVerdict]]: ...
    @property
    def events(self) -> Sequence[Event]: ...


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """What was expected of some samples.

    Attributes:
        t: (n,), plant times, s.
        measured: (n, 3), rad.
        predicted: (n, 3), rad.
        deviation: (n, 3), standard deviation of the readings about the prediction, rad.
        evidence: (n,), evidence of a sudden change, 2 log likelihood ratio.
        threshold: evidence from which on a change is diagnosed.
    """

    t: Array
    measured: Array
    predicted: Array
    deviation: Array
    evidence: Array
    threshold: float


def predictions(messages: Sequence[MonitoringResiduals]) -> Predictions:
    """What the monitor expected, as it is drawn."""
    predicted = np.array([message.predicted for message in messages]).reshape(-1, 3)
    return Predictions(
        np.array([message.time for message in messages]),
        predicted + np.array([message.residual for message in messages]).reshape(-1, 3),
        predicted,
        np.array([message.deviation for message in messages]).reshape(-1, 3),
        np.array([message.evidence for message in messages]),
        messages[-1].threshold if messages else 0.0,
    )


def write_monitoring(
    log: Log,
    trace: DrawnTrace,
    model_file: Path,
    path: Path,
    arm: ArmParameters = _NOMINAL,
    believed: BelievedArm = DATA_SHEET,
) -> None:
    """Writes a run and what the monitor made of it as an .rrd file; it appears complete or not at all.

    Args:
        log: the run, of at least one tick.
        trace: what the monitor made of the same ticks.
        model_file: MJCF of the cell.
        arm: the arm whose link lengths are drawn.
        believed: the healthy arm of the monitor, which is drawn as a ghost.

    Raises:
        ModelError: the model cannot be drawn.
        RecordingError: the log is empty, or the path cannot be written.
    """
    if not len(log):
        raise RecordingError(f"{path}: expected a log of at least one tick to draw")
    drawn = Scene(model_file, arm, task_of(log.metadata), believed)
    t = log.columns["t"]
    extent = extent_of(log, drawn.task)
    stream = open_stream(log, ROOT)
    with saving(stream, path, blueprint(extent, monitoring_views(extent))):
        log_run(stream, drawn, log)
        log_monitor_styles(stream, drawn)
        log_predictions(
            stream,
            Predictions(t, log.stack("measured"), trace.predicted, trace.deviation, trace.statistic, trace.threshold),
        )
        log_verdicts(stream, drawn, [verdict for _, verdict in trace.verdicts])
        _log_findings(stream, trace.events)
        log_marks(stream, marks([*log.events, *trace.events]))


def monitoring_views(extent: Extent) -> rrb.Vertical:
    """Verdicts over residuals and angles."""
    shown = (-_RESIDUALS_SHOWN, _RESIDUALS_SHOWN)
    residuals = [
        plot_view(f"Joint {j}: measured - predicted, in standard deviations", f"{ROOT}/residuals/joint_{j}", shown)
        for j in (1, 2, 3)
    ]
    angles = [
        plot_view(f"Joint {j}: measured, predicted, 99 % band (rad)", f"{ROOT}/angles/joint_{j}", extent.angles)
        for j in (1, 2, 3)
    ]
    evidence = plot_view("Evidence of a fault and threshold", f"{ROOT}/evidence", (0.0, _EVIDENCE_SHOWN))
    return rrb.Vertical(
        rrb.StateTimelineView(
            name="Verdicts", origin=f"{ROOT}/verdicts", time_view=rrb.TimeAxis(link="linktoglobal")
        ),
        rrb.Tabs(rrb.Vertical(*residuals, evidence, name="Residuals"), rrb.Vertical(*angles, name="Angles")),
        row_shares=[1.3, 3],
        name="Monitoring",
    )


def log_monitor_styles(stream: rr.RecordingStream, drawn: Scene) -> None:
    """Sends names and colours of lines and lanes, and what the verdicts on the arm are fixed to."""
    for j in (1, 2, 3):
        colour = style.JOINTS[j - 1]
        for name, shade, width in (
            ("measured", colour, 2.5),
            ("predicted", style.TARGET, 1.0),
            ("upper", _BAND_COLOUR, 0.8),
            ("lower", _BAND_COLOUR, 0.8),
        ):
            _style(stream, f"angles/joint_{j}/{name}", name, shade, width)
        _style(stream, f"residuals/joint_{j}/residual", "residual", colour, 1.0)
        for name in ("upper", "lower"):
            _style(stream, f"residuals/joint_{j}/{name}", "99 %", style.LIMIT, 1.0)
    _style(stream, "evidence/statistic", "evidence", style.TARGET, 1.5)
    _style(stream, "evidence/threshold", "threshold", style.LIMIT, 1.0)
    text = rr.Points3D([_TEXT_AT], colors=style.LABEL, radii=0.0)
    stream.log(_TEXT, text, static=True)
    for unit in UNITS:
        name = unit.replace(" ", "_")
        lane = rr.StateConfiguration(
            values=list(COLOURS), labels=list(COLOURS), colors=[(*colour, 255) for colour in COLOURS.values()]
        )
        stream.log(f"{ROOT}/verdicts/{name}", lane, static=True)


def log_predictions(stream: rr.RecordingStream, seen: Predictions) -> None:
    """Sends what was expected of samples that follow those sent before."""
    times, ends = time_column(seen.t), time_column(seen.t[[0, -1]])
    for j in range(3):
        measured, middle, half = seen.measured[:, j], seen.predicted[:, j], BAND * seen.deviation[:, j]
        angles, residuals = f"angles/joint_{j + 1}", f"residuals/joint_{j + 1}"
        _send(stream, times, f"{angles}/measured", measured)
        _send(stream, times, f"{angles}/predicted", middle)
        _send(stream, times, f"{angles}/upper", middle + half)
        _send(stream, times, f"{angles}/lower", middle - half)
        _send(stream, times, f"{residuals}/residual", (measured - middle) / seen.deviation[:, j])
        _send(stream, ends, f"{residuals}/upper", np.full(2, BAND))
        _send(stream, ends, f"{residuals}/lower", np.full(2, -BAND))
    _send(stream, times, "evidence/statistic", seen.evidence)
    _send(stream, ends, "evidence/threshold", np.full(2, seen.threshold))


def log_verdicts(stream: rr.RecordingStream, drawn: Scene, verdicts: Sequence[MonitoringVerdict]) -> None:
    """Sends states as lanes over time and as coloured links of the arm, what is wrong as text beside them."""
    times = time_column([verdict.time for verdict in verdicts])
    for unit, body in zip(UNITS, _BODIES, strict=True):
        states = [verdict.units[unit].state for verdict in verdicts]
        name = unit.replace(" ", "_")
        stream.send_columns(f"{ROOT}/verdicts/{name}", indexes=[times], columns=rr.StateChange.columns(state=states))
        for verdict, state in zip(verdicts, states, strict=True):
            drawn.colour(stream, body, None if state == "nominal" else COLOURS[state], verdict.time)
    texts = ["\n".join(filter(None, (_label(*item) for item in verdict.units.items()))) for verdict in verdicts]
    columns = rr.Points3D.columns(labels=texts, show_labels=[bool(text) for text in texts])
    stream.send_columns(_TEXT, indexes=[times], columns=columns)


def _label(name: str, unit: MonitoredUnit) -> str:
    """What is wrong, without what only the log needs to tell."""
    if unit.state == "nominal":
        return ""
    reason = unit.text or unit.state
    return f"{name}: {reason.partition(', confidence')[0].replace(f' of {name}', '')}"


def _style(stream: rr.RecordingStream, entity: str, name: str, colour: style.RGB, width: float) -> None:
    stream.log(f"{ROOT}/{entity}", rr.SeriesLines(names=name, colors=colour, widths=width), static=True)


def _send(stream: rr.RecordingStream, times: rr.TimeColumn, entity: str, values: Array) -> None:
    stream.send_columns(f"{ROOT}/{entity}", indexes=[times], columns=rr.Scalars.columns(scalars=values))


def _log_findings(stream: rr.RecordingStream, events: Sequence[Event]) -> None:
    if events:
        stream.send_columns(
            f"{ROOT}/findings",
            indexes=[time_column([event.time for event in events])],
            columns=rr.TextLog.columns(
                text=[f"{event.kind}: {event.text}" for event in events],
                level=[_LEVELS.get(event.kind, rr.TextLogLevel.INFO) for event in events],
            ),
        )
