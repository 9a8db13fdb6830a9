"""What a fitted machine leaves unexplained, in words: which torque, that no effect has, would explain how much."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from dtwin.identification.data import Array
from dtwin.identification.estimation.problem import Prior
from dtwin.identification.machine.fit import MachineFit
from dtwin.identification.machine.problem import MachineProblem
from dtwin.twin.machine import EXTRA_NAMES

NOTICEABLE: Final = 0.1
"""Share of what is not explained from which on a torque that would explain it is told."""
_UNIT: Final = {"sine": 0.01, "cosine": 0.01, "direction": 0.01, "speed": 0.01, "voltage": 0.001}
"""Sizes that the factors of these torques are compared with, SI units."""
_WORDS: Final = {
    "sine": ("angle", "a weight or a spring"),
    "cosine": ("angle", "a weight or a spring"),
    "direction": ("direction of motion", "friction"),
    "speed": ("speed", "friction that grows faster than speed"),
    "voltage": ("voltage", "a drive whose torque is not in proportion to its voltage"),
}


class Left(NamedTuple):
    """A torque that would explain some of what is left: its shape, its joint (1 to 3), its share of the squares."""

    shape: str
    joint: int
    share: float

    def text(self) -> str:
        """What is left, in words."""
        on, lacks = _WORDS[self.shape]
        depends = f"{self.share:.0%} of what is left depends on the {on} of joint {self.joint}"
        return f"{depends}: {lacks} that the model lacks"


def what_is_left(fit: MachineFit) -> tuple[Left, ...]:
    """The torques that would explain a noticeable share of the residuals, the largest share first.

    This is the score test of Rao (Proc. Cambridge Phil. Soc. 44, 1948) for one further factor at a time, with
    everything that was fitted, initial states among them, fitted again.
    """
    problem = fit.problem
    priors = {**problem.priors, **{name: Prior(0.0, _UNIT[name[:-1]]) for name in EXTRA_NAMES}}
    wider = MachineProblem(problem.segments, (*problem.free, *EXTRA_NAMES), fit.vector, priors)
    free = len(problem.free)
    x = np.concatenate((fit.x[:free], np.zeros(len(EXTRA_NAMES)), fit.x[free:]))
    weights = [np.broadcast_to(1.0 / fit.noise, e.measured.shape) for e in problem.segments]
    rows, residuals = [], []
    for residual, shared, local in wider.linearise(x, weights):
        basis = np.linalg.qr(local)[0]
        rows.append(shared - basis @ (basis.T @ shared))
        residuals.append(residual - basis @ (basis.T @ residual))
    known = np.vstack([np.vstack(rows)[:, :free], np.eye(free)])
    further = np.vstack([np.vstack(rows)[:, free:], np.zeros((free, len(EXTRA_NAMES)))])
    residual = np.concatenate([*residuals, np.zeros(free)])
    basis = np.linalg.qr(known)[0]
    further -= basis @ (basis.T @ further)
    residual -= basis @ (basis.T @ residual)
    shares = _shares(further, residual)
    found = [Left(name[:-1], int(name[-1]), share) for name, share in zip(EXTRA_NAMES, shares, strict=True)]
    return tuple(sorted((each for each in found if each.share > NOTICEABLE), key=lambda each: -each.share))


def _shares(columns: Array, residual: Array) -> list[float]:
    """Share of the squares of a residual, (R,), that each of some columns, (R, n), explains alone."""
    squares = np.maximum(np.sum(columns**2, axis=0), np.finfo(float).tiny)
    shares: list[float] = ((columns.T @ residual) ** 2 / squares / float(residual @ residual)).tolist()
    return shares
