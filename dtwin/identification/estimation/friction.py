"""Which friction law the data ask for: viscous, Coulomb, or both, by the Bayesian information criterion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.identification.estimation.problem import symbol

Friction = Literal["viscous", "coulomb", "both"]
FRICTIONS: Final[tuple[Friction, ...]] = ("viscous", "coulomb", "both")

START_COULOMB: Final = 0.01
"""N m"""
_THREE_AT_ONCE: Final = 2.935
"""standard errors"""
_SYMBOLS: Final = {"viscous": ("D",), "coulomb": ("mu",), "both": ("D", "mu")}
_SUBSTEPS: Final = {"viscous": 4, "coulomb": 16, "both": 4}
"""RK4 steps a sample: without viscous damping a fit passes friction too steep for 4"""


@dataclass(frozen=True)
class Choice:
    """The friction laws tried, by name, and the one of least criterion among those whose residuals are white.

    Where none is white, the least criterion alone decides.
    """

    estimates: dict[Friction, Estimate]

    @property
    def best(self) -> Friction:
        sound = {name: e for name, e in self.estimates.items() if e.converged and e.whiteness.white}
        candidates = sound or self.estimates
        return min(candidates, key=lambda name: candidates[name].bic)


def with_friction(settings: EstimationSettings, friction: Friction) -> EstimationSettings:
    """The settings with a friction law's coefficients free and the other law's absent."""
    wanted = _SYMBOLS[friction]
    others = tuple(name for name in settings.free if symbol(name) not in ("D", "mu"))
    coefficients = tuple(f"{kind}{joint}" for kind in wanted for joint in (1, 2, 3))
    values = {f"mu{joint}": START_COULOMB if "mu" in wanted else 0.0 for joint in (1, 2, 3)}
    if "D" not in wanted:
        values |= {f"D{joint}": 0.0 for joint in (1, 2, 3)}
    return replace(
        settings,
        free=(*others, *coefficients),
        known=settings.known.with_values(values),
        substeps=max(settings.substeps, _SUBSTEPS[friction]),
    )


def choose(experiments: Sequence[Experiment], settings: EstimationSettings) -> Choice:
    """Fits every friction law.

    Raises:
        IdentificationError: as `identify`.
    """
    return Choice({friction: identify(experiments, with_friction(settings, friction)) for friction in FRICTIONS})


def indistinguishable_from_zero(estimate: Estimate) -> bool:
    """Whether the Coulomb coefficients' 99 % intervals hold 0, all three at once (Bonferroni)."""
    return all(
        value <= _THREE_AT_ONCE * estimate.standard_errors[name]
        for name, value in estimate.values.items()
        if symbol(name) == "mu"
    )
