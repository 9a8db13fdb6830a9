"""Monitoring of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dtwin.api.arguments import AnyPath, checked
from dtwin.api.identification import Identified
from dtwin.api.run import Run, log_of
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.controller.settings import ControlSettings
from dtwin.emulation import MODEL_FILE
from dtwin.errors import ParameterError, RecordingError
from dtwin.identification.estimation.quality import noise
from dtwin.identification.machine.record import read_record
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import Belief, believed_arm, commissioned, data_sheet, identified
from dtwin.monitoring.estimation.tuning import tuning_for
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import SECOND, Stream, Trace, stream, watch
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings
from dtwin.monitoring.thesis import ThesisMonitor, ThesisSettings
from dtwin.monitoring.trend import Forecast
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import ArmParameters, joint_vector
from dtwin.run.prediction import BelievedArm
from dtwin.run.settings import arm_of
from dtwin.signals import Event, of_monitor
from dtwin.task import task_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, eq=False)
class Monitored:
    """What the monitor made of a run.

    Attributes:
        log: the run.
        verdict: the opinion at its end: the state of every unit, what could not have been seen.
        findings: what is wrong at the end, with cause, size and confidence.
        history: every finding that was settled, in order.
        forecasts: slow changes that will reach a limit, soonest first.
        events: everything that was noticed, in order.
        trace: what was predicted and concluded at every sample.
        believed: the healthy arm that was assumed.
    """

    log: Log
    verdict: MonitoringVerdict
    findings: tuple[Finding, ...]
    history: tuple[Finding, ...]
    forecasts: tuple[Forecast, ...]
    events: tuple[Event, ...]
    trace: Trace
    believed: BelievedArm

    @property
    def states(self) -> dict[str, str]:
        """The state of every unit at the end: nominal, may be degrading, failed or not commissioned."""
        return {name: unit.state for name, unit in self.verdict.units.items()}

    def plot(self) -> Figure:
        """A picture: readings minus predictions (mrad) with their expected spread, evidence, what was noticed."""
        from dtwin.api.plots import draw_trace  # Matplotlib takes half a second to load.

        return draw_trace(self.log, self.trace)

    @checked
    def record(self, path: AnyPath) -> None:
        """Writes a recording for the Rerun viewer: the run with predictions, residuals and verdicts.

        Args:
            path: file to write, *.rrd; it appears complete or not at all.

        Raises:
            RecordingError: the path cannot be written.
        """
        from dtwin.view.monitoring import write_monitoring  # Rerun takes half a second to import.

        drawn = arm_of(self.log.metadata)
        write_monitoring(self.log, self.trace, MODEL_FILE, Path(path), drawn, self.believed)


@checked
def monitor(
    data: Run | AnyPath,
    *,
    model: Identified | str | Path | None = None,
    store: AnyPath = STORE,
    commissioned: AnyPath | None = None,
    alarms_per_hour: float = ALARMS_PER_HOUR,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Monitored:
    """Looks for faults of the arm in a run, as `dtwin monitor LOG` does.

    Only what sensors and commands say is used: what is true in the log is not.

    Args:
        data: a run, or the Parquet file of one.
        model: identified model of the healthy arm: what `identify` returned, a file, or NAME[@REVISION] in `store`;
            None for the data sheet's arm.
        store: folder of identified models.
        commissioned: record of the healthy arm that `dtwin commission` wrote, instead of a model.
        alarms_per_hour: false alarms to be expected of a healthy arm, 1/h.
        progress: told the rows done and their number once a second of plant time.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range, or the run is empty.
        ModelError: there is no such model, or it leaves free parameters open.
        RecordingError: the file is no log, or what is in it does not belong together.
    """
    if commissioned is not None and model is not None:
        raise ParameterError("commissioned: expected no `model` beside it")
    log = log_of(data)
    check_belonging(data.source if isinstance(data, Run) else str(data), log, ArmParameters())
    seen = stream(log)
    settings = MonitorSettings(alarms_per_hour=alarms_per_hour, tuning=tuning_for(task_of(log.metadata).boxes))
    belief = _belief(seen, model, store, commissioned)
    watching = Monitor(belief, settings)
    trace = watch(watching, seen, lambda done: progress(done, len(seen)))
    return Monitored(
        log,
        watching.verdict(),
        tuple(watching.standing()),
        tuple(watching.history),
        tuple(watching.forecasts),
        trace.events,
        trace,
        believed_arm(belief),
    )


@dataclass(frozen=True, slots=True)
class Compared:
    """What the thesis's comparison with a simulated arm made of a run.

    Attributes:
        verdict: the opinion at its end.
        findings: what is wrong at the end.
        history: the same, as this method takes nothing back.
        forecasts: none, as this method makes none.
        events: what was noticed, in order.
    """

    verdict: MonitoringVerdict
    findings: tuple[Finding, ...]
    history: tuple[Finding, ...]
    forecasts: tuple[Forecast, ...]
    events: tuple[Event, ...]


@checked
def compare_with_simulation(
    data: Run | AnyPath,
    *,
    model: Identified | str | Path | None = None,
    store: AnyPath = STORE,
    sample_time: float = 0.5,
    step: float = 0.005,
    target_time: float = 2.0,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Compared:
    """Looks for faults of the arm in a run by the thesis's method, as `dtwin monitor LOG --method thesis` does.

    Args:
        data: a run, or the Parquet file of one.
        model: identified model of the healthy arm; None for the data sheet's arm.
        store: folder of identified models.
        sample_time: time between two comparisons, s.
        step: step of the simulation, s.
        target_time: duration of every motion, s.
        progress: told the rows done and their number once a second of plant time.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range, or the run is empty.
        ModelError: there is no such model.
        RecordingError: the file is no log, what is in it does not belong together, or it tells no box.
    """
    log = log_of(data)
    source = data.source if isinstance(data, Run) else str(data)
    check_belonging(source, log, ArmParameters())
    seen = stream(log)
    if not log.columns["box_colour"].any():
        raise RecordingError(f"{source}: column box_colour: the thesis's method needs it, and it tells no box")
    arm = ArmParameters() if model is None else model_of(model, store).arm
    task = task_of(log.metadata)
    control = ControlSettings(target_time=target_time, payload=task.boxes.middle)
    thesis = ThesisMonitor(arm, ThesisSettings(sample_time, step, control), task)
    for first in range(0, len(seen), SECOND):
        seen.feed(thesis, first, min(first + SECOND, len(seen)))
        progress(first, len(seen))
    found = tuple(thesis.standing())
    return Compared(thesis.verdict(), found, found, (), of_monitor(thesis.events))


def model_of(reference: Identified | str | Path, store: AnyPath) -> IdentifiedModel:
    """The model that `identify` returned, of a file, or of a name in a folder of models.

    Raises:
        ModelError: there is no such model, or its file is damaged.
    """
    return (
        reference.model if isinstance(reference, Identified) else open_model(str(reference), ModelStore(Path(store)))
    )


def _belief(seen: Stream, model: Identified | str | Path | None, store: AnyPath, record: AnyPath | None) -> Belief:
    """What the monitor believes of the healthy arm."""
    if model is not None:
        return identified(model_of(model, store))
    if record is not None:
        return commissioned(read_record(Path(record)))
    return data_sheet(joint_vector(noise(seen.measured)))
