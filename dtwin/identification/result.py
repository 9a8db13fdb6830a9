"""Makes an identified model of an estimate."""

from __future__ import annotations

import platform

import numpy as np

from dtwin import __version__
from dtwin.identification.data import Array, fingerprint
from dtwin.identification.estimation.estimate import Estimate
from dtwin.identification.estimation.residuals import LAGS
from dtwin.identification.model import SCHEMA, Covariance, Data, IdentifiedModel, PriorRecord, Validity
from dtwin.parameters import PARAMETER_NAMES


def from_estimate(estimate: Estimate, fit: Array, source: str) -> IdentifiedModel:
    """Makes the model of an estimate.

    Args:
        estimate: result of an identification.
        fit: (3,), fit of every joint on held-out data.
        source: description of the data in words.
    """
    problem = estimate.problem
    hidden = estimate.identifiability.unidentifiable
    kept = [k for k, name in enumerate(problem.shared) if name not in hidden]
    names = [problem.shared[k] for k in kept]
    matrix = estimate.covariance[np.ix_(kept, kept)]
    return IdentifiedModel(
        schema=SCHEMA,
        parameters=dict(zip(PARAMETER_NAMES, estimate.parameters.vector(), strict=True)),
        free=list(problem.free),
        unidentifiable=list(hidden),
        identifiability=estimate.identifiability.text(),
        standard_errors={name: estimate.standard_errors[name] for name in names},
        covariance=Covariance(names, matrix.tolist()),
        offsets=problem.offset(estimate.x).tolist(),
        priors={name: PriorRecord(prior.mean, prior.deviation) for name, prior in problem.priors.items()},
        data=Data(
            fingerprint(problem.experiments),
            source,
            [len(experiment) for experiment in problem.experiments],
            [float(experiment.payload.max()) for experiment in problem.experiments],
            problem.experiments[0].payload_model,
        ),
        validity=Validity(
            estimate.converged,
            fit.tolist(),
            estimate.noise.tolist(),
            estimate.shape,
            estimate.whiteness.white,
            list(estimate.whiteness.p_values),
            LAGS,
            estimate.bic,
            list(estimate.at_bound),
        ),
        versions={"dtwin": __version__, "numpy": np.__version__, "python": platform.python_version()},
    )
