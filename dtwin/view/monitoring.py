"""What a monitor made of a run: predictions with their band, residuals, evidence, and verdicts on the arm itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.parameters import ArmParameters
from dtwin.recording import Log, replacing
from dtwin.signals import Event
from dtwin.view import scene, style
from dtwin.view.layout import cell_view, plot_view
from dtwin.view.scene import Scene
from dtwin.view.series import TIMELINE, time_column
from dtwin.view.write import log_run, open_stream

Array = NDArray[np.float64]

ROOT: Final = "monitor"
BAND: Final = 2.5758
"""standard deviations on either side of the prediction: 99 % of a healthy arm's readings"""
COLOURS: Final[Mapping[str, style.RGB]] = {
    "nominal": (60, 190, 90),
    "may be degrading": (250, 190, 40),
    "failed": (235, 50, 45),
}
_UNITS: Final = ("joint 1", "joint 2", "joint 3", "gripper")
_LINKS: Final = ("link_1", "link_2", "link_3", "tip")
_LEVELS: Final = {"failed": rr.TextLogLevel.ERROR, "suspected": rr.TextLogLevel.WARN, "restart": rr.TextLogLevel.WARN}
_NOMINAL: Final = ArmParameters()
_BAND_COLOUR: Final[style.RGB] = (110, 120, 130)


class Verdict(Protocol):
    """An opinion: the state of each of the joints and the gripper, one of COLOURS."""

    @property
    def states(self) -> Mapping[str, str]: ...


class Trace(Protocol):
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
    def verdicts(self) -> Sequence[tuple[int, Verdict]]: ...
    @property
    def events(self) -> Sequence[Event]: ...


def write_monitoring(log: Log, trace: Trace, model_file: Path, path: Path, arm: ArmParameters = _NOMINAL) -> None:
    """Writes a run and what the monitor made of it as an .rrd file; it appears complete or not at all.

    Args:
        log: the run, of at least one tick.
        trace: of the monitor over the same ticks.
        model_file: MJCF of the cell.
        arm: its link lengths are drawn.

    Raises:
        ModelError: the model cannot be drawn.
        RecordingError: the log is empty, or the path cannot be written.
    """
    if not len(log):
        raise RecordingError(f"{path}: expected a log of at least one tick to draw")
    drawn = Scene(model_file, arm)
    with replacing(path) as temporary, open_stream(log) as stream:
        stream.save(temporary, default_blueprint=blueprint())
        log_run(stream, drawn, log)
        _log_predictions(stream, log, trace)
        _log_verdicts(stream, drawn, log, trace, arm)
        _log_events(stream, trace.events)


def blueprint() -> rrb.Blueprint:
    """The layout of such a recording."""
    joints = [
        plot_view(f"Joint {j}: measured, predicted, 99 % band (rad)", f"{ROOT}/angles/joint_{j}") for j in (1, 2, 3)
    ]
    residuals = [
        plot_view("Residuals, in standard deviations", f"{ROOT}/residuals"),
        plot_view("Evidence of a fault and threshold", f"{ROOT}/evidence"),
    ]
    findings = rrb.TextLogView(
        name="Findings",
        origin=f"{ROOT}/findings",
        columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["loglevel", "body"]),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(cell_view(), findings, row_shares=[3, 1]),
            rrb.Vertical(
                rrb.StateTimelineView(name="Verdicts", origin=f"{ROOT}/verdicts"),
                rrb.Tabs(rrb.Vertical(*joints, name="Angles"), rrb.Vertical(*residuals, name="Residuals")),
                row_shares=[1, 3],
            ),
            column_shares=[1, 1.2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, loop_mode="all"),
    )


def _log_predictions(stream: rr.RecordingStream, log: Log, trace: Trace) -> None:
    times = time_column(log.columns["t"])
    measured = log.stack("measured")
    for j in range(3):
        middle, half = trace.predicted[:, j], BAND * trace.deviation[:, j]
        colour = style.JOINTS[j]
        lines = {
            "measured": (measured[:, j], colour, 1.5),
            "predicted": (middle, style.TARGET, 1.0),
            "upper": (middle + half, _BAND_COLOUR, 0.8),
            "lower": (middle - half, _BAND_COLOUR, 0.8),
        }
        for name, (values, shade, width) in lines.items():
            _line(stream, times, f"{ROOT}/angles/joint_{j + 1}/{name}", name, values, shade, width)
        residual = (measured[:, j] - middle) / trace.deviation[:, j]
        _line(stream, times, f"{ROOT}/residuals/joint_{j + 1}", f"joint {j + 1}", residual, colour, 1.0)
    _line(stream, times, f"{ROOT}/evidence/statistic", "evidence", trace.statistic, style.TARGET, 1.5)
    ends = time_column(log.columns["t"][[0, -1]])
    for name, value, entity in (
        ("99 %", BAND, "residuals/upper"),
        ("99 %", -BAND, "residuals/lower"),
        ("threshold", trace.threshold, "evidence/threshold"),
    ):
        _line(stream, ends, f"{ROOT}/{entity}", name, np.full(2, value), style.LIMIT, 1.0)


def _line(
    stream: rr.RecordingStream,
    times: rr.TimeColumn,
    entity: str,
    name: str,
    values: Array,
    colour: style.RGB,
    width: float,
) -> None:
    stream.log(entity, rr.SeriesLines(names=name, colors=colour, widths=width), static=True)
    stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=values))


def _log_verdicts(stream: rr.RecordingStream, drawn: Scene, log: Log, trace: Trace, arm: ArmParameters) -> None:
    """States as lanes over time, and as coloured links of the arm."""
    rows = [row for row, _ in trace.verdicts]
    times = time_column(log.columns["t"][rows])
    for number, (unit, body) in enumerate(zip(_UNITS, _LINKS, strict=True)):
        states = [verdict.states[unit] for _, verdict in trace.verdicts]
        lane = f"{ROOT}/verdicts/{unit.replace(' ', '_')}"
        names = list(COLOURS)
        stream.log(
            lane, rr.StateConfiguration(values=names, labels=names, colors=list(COLOURS.values())), static=True
        )
        stream.send_columns(lane, indexes=[times], columns=rr.StateChange.columns(state=states))
        on_arm = f"{scene.ROOT}/verdicts/{unit.replace(' ', '_')}"
        length = arm.length[number] if number < 3 else 0.02
        stream.log(on_arm, drawn.frame(body), static=True)
        stream.log(on_arm, rr.LineStrips3D.from_fields(radii=0.008), static=True)
        strips = np.tile([[[0.0, -0.03, 0.0], [length, -0.03, 0.0]]], (len(rows), 1, 1))
        columns = rr.LineStrips3D.columns(strips=strips, colors=[COLOURS[state] for state in states])
        stream.send_columns(on_arm, indexes=[times], columns=columns)


def _log_events(stream: rr.RecordingStream, events: Sequence[Event]) -> None:
    if events:
        stream.send_columns(
            f"{ROOT}/findings",
            indexes=[time_column([event.time for event in events])],
            columns=rr.TextLog.columns(
                text=[f"{event.kind}: {event.text}" for event in events],
                level=[_LEVELS.get(event.kind, rr.TextLogLevel.INFO) for event in events],
            ),
        )
