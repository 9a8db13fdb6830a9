"""What a fitted machine leaves unexplained, in words: which torque, that no effect has, would explain how much."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from dtwin.identification.data import Array
from dtwin.identification.estimation.problem import Prior
from dtwin.identification.machine.fit import MachineFit
from dtwin.identification.machine.problem import MachineProblem
from dtwin.twin.machine import EXTRA_NAMES, MACHINE_NAMES

NOTICEABLE: Final = 0.1
"""Share of what is not explained from which on it is told that something would explain it."""
_UNIT: Final = {"sine": 0.01, "cosine": 0.01, "direction": 0.01, "speed": 0.01, "voltage": 0.001}
"""Sizes that the factors of these torques are compared with, SI units."""
_STEP: Final = 1e-4
"""Step of the difference quotients in these units."""
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


class Remainder:
    """What a fit leaves of its residuals, and what further numbers of the machine would explain of that.

    This is the score test of Rao (Proc. Cambridge Phil. Soc. 44, 1948): everything that was fitted, initial states
    among them, is fitted again with the further numbers, to first order.
    """

    def __init__(self, fit: MachineFit) -> None:
        self._fit = fit
        problem = fit.problem
        self._weights = [np.broadcast_to(1.0 / fit.noise, e.measured.shape) for e in problem.segments]
        linearised = problem.linearise(fit.x, self._weights)
        self._states = [np.linalg.qr(state)[0] for _, _, state in linearised]
        free = len(problem.free)
        known = np.vstack([*self._again([shared for _, shared, _ in linearised]), np.eye(free)])
        self._known = np.linalg.qr(known)[0]
        residual = np.concatenate([*self._again([residual for residual, _, _ in linearised]), np.zeros(free)])
        self.residual = residual - self._known @ (self._known.T @ residual)

    def columns(self, units: Mapping[str, float], vector: Array) -> Array:
        """Effects of further numbers on the residuals, (R, n), in their units; of a machine with a vector, (78,)."""
        problem = self._fit.problem
        priors = {name: Prior(0.0, unit) for name, unit in units.items()}
        further = MachineProblem(problem.segments, tuple(units), vector, priors)
        at = [vector[MACHINE_NAMES.index(name)] / unit for name, unit in units.items()]
        x = np.concatenate((at, self._fit.x[len(problem.free) :]))
        columns = np.zeros((len(self.residual), len(units)))
        base = further.simulate(x)
        for column in range(len(units)):
            moved = x.copy()
            moved[column] += _STEP
            pairs = zip(further.simulate(moved), base, self._weights, strict=True)
            rows = self._again([((readings - before) * weight).ravel() / _STEP for readings, before, weight in pairs])
            columns[: -len(problem.free), column] = np.concatenate(rows)
        found: Array = columns - self._known @ (self._known.T @ columns)
        return found

    def explained(self, columns: Array) -> tuple[float, Array]:
        """Share of the squares of what is left that columns, (R, n), explain together, and their factors, (n,)."""
        factors, *_ = np.linalg.lstsq(columns, -self.residual)
        after = self.residual + columns @ factors
        return 1.0 - float(after @ after / (self.residual @ self.residual)), factors

    def _again(self, parts: Sequence[Array]) -> list[Array]:
        """The same of every segment with its initial state fitted again."""
        return [part - basis @ (basis.T @ part) for part, basis in zip(parts, self._states, strict=True)]


def what_is_left(fit: MachineFit) -> tuple[Left, ...]:
    """The torques that would explain a noticeable share of the residuals, the largest share first, one at a time."""
    remainder = Remainder(fit)
    columns = remainder.columns({name: _UNIT[name[:-1]] for name in EXTRA_NAMES}, fit.vector)
    shares = [remainder.explained(column[:, None])[0] for column in columns.T]
    found = [Left(name[:-1], int(name[-1]), share) for name, share in zip(EXTRA_NAMES, shares, strict=True)]
    return tuple(sorted((each for each in found if each.share > NOTICEABLE), key=lambda each: -each.share))
