"""Models of a running arm: from the signal that excites it, or from the motions that it makes anyway."""

from __future__ import annotations

from collections.abc import Sequence

from dtwin.errors import IdentificationError
from dtwin.identification.collector import divided
from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.identification.estimation.problem import UPPER_OF_FAULTY, Prior
from dtwin.identification.held_out import compare
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.operating_data import PIECES
from dtwin.identification.result import from_estimate
from dtwin.parameters import ArmParameters


def estimate_excited(experiment: Experiment, settings: EstimationSettings) -> tuple[Estimate, IdentifiedModel]:
    """Estimates from the first part of a signal, whose rest judges the model.

    Args:
        experiment: the whole signal.
        settings: what to estimate and how.

    Raises:
        IdentificationError: the signal tells too little.
    """
    part, rest = divided(experiment)
    return _judged([part], rest, settings, "the running cell")


def renewed(
    known: ArmParameters, errors: dict[str, float], free: Sequence[str], anew: Sequence[str]
) -> EstimationSettings:
    """Settings that estimate some parameters of an identified arm again.

    Args:
        known: parameters of the arm as they were identified.
        errors: standard errors of the identified parameters by name, SI units.
        free: names of the parameters to estimate; those without a standard error stay fixed unless in `anew`.
        anew: names of the parameters whose old values no longer count; all of `free` when empty.

    Raises:
        IdentificationError: a name in `anew` is not free.
    """
    unknown = tuple(anew) or tuple(free)
    if strangers := [name for name in unknown if name not in free]:
        raise IdentificationError(f"--anew {strangers[0]}: expected some of the free parameters, {', '.join(free)}")
    priors = {name: Prior(known.get(name), errors[name]) for name in free if name not in unknown and name in errors}
    wanted = tuple(name for name in free if name in unknown or name in priors)
    return EstimationSettings(wanted, known, priors=priors, upper=UPPER_OF_FAULTY)


def estimate_from(
    pieces: Sequence[Experiment], settings: EstimationSettings, source: str
) -> tuple[Estimate, IdentifiedModel]:
    """Estimates from all pieces but the last, which judges the model.

    Args:
        pieces: pieces of motion, at least PIECES.
        settings: what to estimate and how.
        source: description of the data in words.

    Raises:
        IdentificationError: there are too few pieces, or they tell too little.
    """
    if len(pieces) < PIECES:
        raise IdentificationError(f"expected at least {PIECES} pieces of motion, got {len(pieces)}")
    *known, last = pieces
    return _judged(known, last, settings, source)


def _judged(
    known: Sequence[Experiment], rest: Experiment, settings: EstimationSettings, source: str
) -> tuple[Estimate, IdentifiedModel]:
    estimate = identify(known, settings)
    fit = compare([rest], estimate.parameters, estimate.problem.offset(estimate.x)).fit
    return estimate, from_estimate(estimate, fit, source)
