"""Local identifiability: which parameters an experiment determines, in numbers and in words.

The derivatives are exact, so combinations that have no effect on the data have singular values of rounding size, ten
orders below the others: the rank is a property of the experiment and does not depend on the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.errors import choices
from dtwin.identification.data import Array, Experiment, Start
from dtwin.identification.estimation.problem import Problem
from dtwin.parameters import symbol_of

_RANK_TOLERANCE: Final = 1e-9
"""Singular value that counts as zero, relative to the largest one of a matrix with unit columns."""
_ABSENT: Final = 1e-5
"""Component of a null direction below which a parameter does not take part in it."""
_USUAL_NOISE: Final = 1e-3
"""Noise that sets the weight of the data against the priors, rad; the rank does not depend on it."""
_OTHER_PAYLOAD: Final = 0.2
"""Payload of the run that is proposed beside an empty one, kg."""


@dataclass(frozen=True, slots=True)
class Identifiability:
    """Which parameters an experiment determines.

    Attributes:
        free: names of the free parameters.
        rank: number of independent combinations of the free parameters that the data determine.
        identifiable: names of the parameters that the data determine.
        combinations: groups of the other parameters; of a group only combinations are determined.
        missing: number of undetermined directions in each group.
        advice: what would make all parameters identifiable, or at least more of them.
    """

    free: tuple[str, ...]
    rank: int
    identifiable: tuple[str, ...]
    combinations: tuple[tuple[str, ...], ...]
    missing: tuple[int, ...]
    advice: str

    @property
    def unidentifiable(self) -> tuple[str, ...]:
        """Names of the free parameters that are not determined, in the order of `free`."""
        return tuple(name for name in self.free if name not in self.identifiable)

    def text(self) -> str:
        """The result in words."""
        count = len(self.free)
        if self.rank == count:
            return f"All {count} free parameters are determined."
        groups = "; ".join(
            f"{', '.join(group)} only in combination ({missing} of {len(group)} degrees of freedom open)"
            if len(group) > 1
            else f"{group[0]} not at all"
            for group, missing in zip(self.combinations, self.missing, strict=True)
        )
        alone = f" {', '.join(self.identifiable)} are determined;" if self.identifiable else ""
        return f"These data fix {self.rank} of {count} parameters:{alone} {groups}. {self.advice}".rstrip()


def analyse(problem: Problem, x: Array) -> Identifiability:
    """Finds which parameters the data and priors of a problem determine, linearised at the scaled unknowns x."""
    matrix = parameter_sensitivity(problem, x)
    null = null_space(matrix)
    rank = len(problem.free) - null.shape[1]
    inside = np.abs(null).max(axis=1, initial=0.0) > _ABSENT
    identifiable = tuple(name for name, hidden in zip(problem.free, inside, strict=True) if not hidden)
    groups = _groups(null)
    names = tuple(tuple(problem.free[k] for k in group) for group in groups)
    missing = tuple(int(np.linalg.matrix_rank(null[list(group)], tol=1e-6)) for group in groups)
    advice = _advise(problem, x, rank) if null.shape[1] else ""
    return Identifiability(problem.free, rank, identifiable, names, missing, advice)


def parameter_sensitivity(problem: Problem, x: Array) -> Array:
    """Derivatives (R, free) of the data by the parameters, projected off the offsets and initial states.

    Each column is divided by the norm that it has before the projection.
    """
    matrix = problem.sensitivity(x, [np.full(3, 1.0 / _USUAL_NOISE)] * len(problem.experiments))
    free = len(problem.free)
    offsets = matrix.shape[1] - free
    triangle = np.asarray(np.linalg.qr(np.hstack((matrix[:, free:], matrix[:, :free])), mode="r"))
    reduced = triangle[offsets:, offsets:]
    # A column of which only rounding is left must not be scaled to unit length: hence the norm before.
    norms = np.linalg.norm(matrix[:, :free], axis=0)
    return reduced / np.where(norms > 0, norms, 1.0)


def null_space(matrix: Array) -> Array:
    """Orthonormal basis (n, k) of the null space of a matrix up to rounding."""
    _, singular, right = np.linalg.svd(matrix, full_matrices=True)
    rank = int((singular > _RANK_TOLERANCE * singular[0]).sum()) if singular.size else 0
    return right[rank:].T


def _groups(null: Array) -> list[tuple[int, ...]]:
    """Groups of parameters that share null directions: the blocks of the reduced echelon form of the null space."""
    rows = null.T.copy()
    pivots: list[int] = []
    for row in range(len(rows)):
        candidates = np.abs(rows[row:])
        candidates[:, pivots] = 0.0
        k, column = divmod(int(candidates.argmax()), candidates.shape[1])
        rows[[row, row + k]] = rows[[row + k, row]]
        rows[row] /= rows[row, column]
        for other in range(len(rows)):
            if other != row:
                rows[other] -= rows[other, column] * rows[row]
        pivots.append(column)
    groups: list[set[int]] = []
    for row in rows:
        together = {int(k) for k in np.flatnonzero(np.abs(row) > _ABSENT)}
        for group in [group for group in groups if group & together]:
            together |= group
            groups.remove(group)
        groups.append(together)
    return sorted(tuple(sorted(group)) for group in groups)


def _advise(problem: Problem, x: Array, rank: int) -> str:
    """Tries which additional knowledge or run would help: measured masses or lengths, or another payload."""
    extra = _with_another_payload(problem)
    options: list[tuple[str, Problem]] = []
    for text, base in (("", problem), ("add a run with another payload", extra)):
        for what, symbols in (("", ""), ("fix the masses", "m"), ("fix the masses and lengths", "ml")):
            kept = tuple(name for name in problem.free if symbol_of(name) not in symbols)
            if (text or what) and (not what or len(kept) < len(problem.free)):
                steps = " and ".join(filter(None, (text, what)))
                priors = {name: prior for name, prior in problem.priors.items() if name in kept}
                options.append((steps, replace(base, free=kept, priors=priors)))
    findings = []
    for steps, candidate in options:
        reached = _rank(candidate, candidate.start(problem.parameters(x)))
        findings.append((steps, reached, len(candidate.free)))
    full = [steps for steps, reached, count in findings if reached == count]
    if full:
        shortest = [steps for steps in full if not any(other != steps and other in steps for other in full)]
        return f"To determine the rest: {choices(shortest)}."
    steps, reached, count = max(findings, key=lambda finding: finding[1] - finding[2])
    return f"Best step: {steps} (then {reached} of {count})." if reached > rank or count < len(problem.free) else ""


def _rank(problem: Problem, x: Array) -> int:
    matrix = parameter_sensitivity(problem, x)
    return len(problem.free) - null_space(matrix).shape[1]


def _with_another_payload(problem: Problem) -> Problem:
    """The problem with its first experiment repeated, empty if it was loaded and loaded if it was empty."""
    first = problem.experiments[0]
    loaded = float(first.payload.max()) > 0
    repeated = Experiment(
        first.measured,
        first.volts,
        0.0 if loaded else _OTHER_PAYLOAD,
        Start(first.start.theta, first.start.omega, first.start.known),
        first.period,
        first.payload_model,
    )
    return replace(problem, experiments=(*problem.experiments, repeated))
