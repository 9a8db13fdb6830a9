"""Identification of the arm from a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from dtwin.api.arguments import AnyPath, Texts, checked, texts
from dtwin.api.run import Run, log_of
from dtwin.errors import DtwinError, IdentificationError, ParameterError
from dtwin.identification.data import Experiment, from_log
from dtwin.identification.estimation.estimate import NINETY_FIVE, Estimate, EstimationSettings, Loss, load_kernels
from dtwin.identification.estimation.estimate import identify as estimated
from dtwin.identification.estimation.friction import FRICTIONS, Friction, choose, with_friction
from dtwin.identification.held_out import Comparison, compare
from dtwin.identification.model import IdentifiedModel, write_model
from dtwin.identification.parsing import settings_for
from dtwin.identification.result import from_estimate
from dtwin.logs.belonging import check_belonging
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters, load_arm
from dtwin.run.settings import arm_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HELD_OUT_SHARE: Final = 0.2
"""share of a log that is kept for judging the model"""
_MOST_SEGMENTS: Final = 60
"""number of segments of one second that a fit takes from a log; each has six unknowns, and more would take minutes"""

FrictionChoice = Literal["viscous", "coulomb", "both", "auto"]


@dataclass(frozen=True, slots=True)
class Measured:
    """What an arm is identified from.

    Attributes:
        training: what the parameters are fitted to.
        judging: what the model is judged by.
        truth: parameters of the emulated arm that was measured; None where nobody knows them.
        source: where the data come from, in words.
    """

    training: Sequence[Experiment]
    judging: Sequence[Experiment]
    truth: ArmParameters | None
    source: str


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """An identified arm.

    Attributes:
        estimate: the estimate with residuals, covariance and what the data do not tell.
        held_out: motion that the model was not fitted to, its prediction, and how well they fit.
        model: the model as it is kept in files.
        truth: parameters of the emulated arm; None where nobody knows them. They are only compared with.
        criteria: BIC of each friction law where the law was chosen; else None.
        judging: the data of the held-out motion.
    """

    estimate: Estimate
    held_out: Comparison
    model: IdentifiedModel
    truth: ArmParameters | None
    criteria: dict[Friction, float] | None
    judging: Sequence[Experiment]

    @property
    def before(self) -> Comparison:
        """The held-out motion as the model before the identification predicts it."""
        return compare(self.judging, self.estimate.problem.fixed, self.estimate.problem.offset(self.estimate.x))

    @property
    def arm(self) -> ArmParameters:
        """All parameters: those that the data determine as estimated, the others as they were known. SI units."""
        return self.estimate.parameters

    @property
    def values(self) -> dict[str, float]:
        """The estimates of what the data determine, by name such as K2, SI units."""
        return {name: self.estimate.values[name] for name in self.estimate.identifiability.identifiable}

    @property
    def intervals(self) -> dict[str, float]:
        """Half widths of the 95 % intervals of `values`, by name, SI units."""
        return {name: NINETY_FIVE * self.estimate.standard_errors[name] for name in self.values}

    @property
    def doubts(self) -> str:
        """Why the model should not be used, "" if nothing speaks against it."""
        return self.model.validity.doubts

    def plot(self) -> Figure:
        """A picture: the held-out motion with both predictions (rad), 95 % intervals (%), correlation."""
        from dtwin.identification.plots import picture  # Matplotlib takes half a second to load.

        title = f"identified from {self.model.data.source}"
        return picture(self.estimate, self.before, self.held_out, self.truth, title)

    @checked
    def save(self, path: AnyPath) -> None:
        """Writes the model, for `dtwin monitor --model`, `dtwin simulate --model` and their like.

        Args:
            path: file to write, *.json; it appears complete or not at all.

        Raises:
            RecordingError: the path cannot be written.
        """
        write_model(self.model, Path(path))


@checked
def identify(
    data: Run | AnyPath,
    *,
    payload: float | None = None,
    free: str = "K,I,c,D",
    friction: FrictionChoice | None = None,
    prior: Texts = (),
    loss: Loss = "adaptive",
    known: ArmParameters | AnyPath | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda stage: None,
) -> Identified:
    """Identifies the parameters of the arm from a run at work, as `dtwin identify LOG` does.

    Four fifths of the run are fitted, the last fifth judges the model; of long runs 60 s, evenly spread, are fitted.
    What is true in the log is not looked at.

    Args:
        data: a run, or the Parquet file of one.
        payload: mass of every box, kg; None leaves out motions with a box.
        free: what to estimate: symbols (K, m, I, l, c, D, mu) of all joints, names such as m2, or "all", without mu.
        friction: friction law to estimate, in place of D and mu of `free`; auto takes that with the least BIC.
        prior: knowledge of a free parameter from elsewhere, NAME=MEAN+-DEVIATION in SI units.
        loss: likelihood: adapted to the noise's shape, least squares (gaussian), or robust to outliers (huber).
        known: parameters that are not estimated, or their JSON file; None for the data sheet.
        seed: number of the random generator of further starting points, at least 0.
        progress: is told "estimating" when that begins.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        IdentificationError: the run is too short or too poor.
        RecordingError: the file is no log, or what is in it does not belong together.
    """
    settings = identification_settings(free, known, texts(prior), loss, seed)
    source = data.source if isinstance(data, Run) else str(data)
    return fitted(measured(log_of(data), payload, source, settings.known), settings, friction, progress)


def identification_settings(
    free: str, known: ArmParameters | AnyPath | None, prior: tuple[str, ...], loss: Loss, seed: int
) -> EstimationSettings:
    """What is estimated, as arguments tell it.

    Args:
        free: what to estimate.
        known: parameters that are not estimated, or their JSON file; None for the data sheet.
        prior: knowledge of free parameters, NAME=MEAN+-DEVIATION.
        loss: likelihood.
        seed: number of the random generator of further starting points.

    Raises:
        ParameterError: an argument is out of range.
        ModelError: the file cannot be used.
    """
    if seed < 0:
        raise ParameterError(f"seed: expected a whole number of at least 0, got {seed}")
    arm = load_arm(Path(known)) if isinstance(known, str | Path) else known
    return settings_for(free, arm, prior, loss, seed)


def measured(log: Log, payload: float | None, source: str, arm: ArmParameters) -> Measured:
    """Divides a log into what is fitted and what judges.

    Args:
        log: log of a run.
        payload: mass of every box, kg; None leaves out motions with a box.
        source: where the log comes from, in words.
        arm: arm as it was designed.

    Raises:
        IdentificationError: the log is too short.
        RecordingError: readings and commands do not belong together: signs, order, units or rows are wrong.
    """
    check_belonging(source, log, arm)
    segments = from_log(log, payload)
    kept = max(1, round(_HELD_OUT_SHARE * len(segments)))
    if len(segments) <= kept:
        raise IdentificationError(f"{source}: too few samples: {len(log)}, expected at least two seconds")
    stride = -(-(len(segments) - kept) // _MOST_SEGMENTS)
    return Measured(segments[:-kept:stride], segments[-min(kept, _MOST_SEGMENTS) :], _truth(log), source)


def fitted(
    data: Measured,
    settings: EstimationSettings,
    friction: FrictionChoice | None,
    progress: Callable[[str], None],
) -> Identified:
    """Estimates the parameters and judges them.

    Args:
        data: what the arm is identified from.
        settings: what is estimated.
        friction: friction law to estimate; None for that of the settings.
        progress: is told "estimating" when that begins, after what it needs is loaded.

    Raises:
        IdentificationError: the data are too poor.
    """
    load_kernels()
    progress("estimating")
    criteria: dict[Friction, float] | None = None
    if friction == "auto":
        choice = choose(data.training, settings)
        estimate = choice.estimates[choice.best]
        criteria = {name: choice.estimates[name].bic for name in FRICTIONS}
    else:
        used = settings if friction is None else with_friction(settings, friction)
        estimate = estimated(data.training, used)
    held_out = compare(data.judging, estimate.parameters, estimate.problem.offset(estimate.x))
    model = from_estimate(estimate, held_out.fit, data.source)
    return Identified(estimate, held_out, model, data.truth, criteria, data.judging)


def _truth(log: Log) -> ArmParameters | None:
    """The arm an emulated run was made with, if its log says so."""
    if "arm" not in log.metadata:
        return None
    try:
        return arm_of(log.metadata)
    except DtwinError:
        return None
