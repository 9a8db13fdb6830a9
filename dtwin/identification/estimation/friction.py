"""Selects the friction law (viscous, Coulomb, or both) by the Bayesian information criterion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.parameters import symbol_of

Friction = Literal["viscous", "coulomb", "both"]
FRICTIONS: Final[tuple[Friction, ...]] = ("viscous", "coulomb", "both")

START_COULOMB: Final = 0.01
"""Start value of the Coulomb friction of every joint, N m."""
_THREE_AT_ONCE: Final = 2.935
"""Half width in standard errors of three 99 % confidence intervals that hold at once (Bonferroni)."""
_SYMBOLS: Final = {"viscous": ("D",), "coulomb": ("mu",), "both": ("D", "mu")}
_SUBSTEPS: Final = {"viscous": 4, "coulomb": 16, "both": 4}
"""Number of RK4 steps per sample: without viscous damping a fit passes friction too steep for 4 steps."""


@dataclass(frozen=True)
class Choice:
    """The estimates for the friction laws that were tried.

    Attributes:
        estimates: estimate for every friction law by its name.
    """

    estimates: dict[Friction, Estimate]

    @property
    def best(self) -> Friction:
        """The law of the lowest criterion among those that converged with white residuals.

        Where there is no such law, the criterion alone decides.
        """
        sound = {name: e for name, e in self.estimates.items() if e.converged and e.whiteness.white}
        candidates = sound or self.estimates
        return min(candidates, key=lambda name: candidates[name].bic)


def with_friction(settings: EstimationSettings, friction: Friction) -> EstimationSettings:
    """Settings in which the coefficients of a friction law are free and all other friction is 0."""
    wanted = _SYMBOLS[friction]
    others = tuple(name for name in settings.free if symbol_of(name) not in ("D", "mu"))
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
        IdentificationError: the data are too poor, or no starting point leads to a fit.
    """
    return Choice({friction: identify(experiments, with_friction(settings, friction)) for friction in FRICTIONS})


def indistinguishable_from_zero(estimate: Estimate) -> bool:
    """Whether 0 lies in the 99 % confidence intervals of all three Coulomb coefficients at once (Bonferroni)."""
    return all(
        estimate.values[name] <= _THREE_AT_ONCE * estimate.standard_errors[name]
        for name in estimate.problem.free
        if symbol_of(name) == "mu"
    )
