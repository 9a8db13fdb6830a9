"""Errors of integrators and steps, and the page that tells them."""

import numpy as np
import pytest

from dtwin.campaign.spread import Workforce
from dtwin.emulation.machine.energy import EnergyBalance
from dtwin.emulation.machine.integration import driven
from dtwin.emulation.machine.sections import IDEAL
from evidence.integrators import (
    ARMS,
    BALANCED_ARMS,
    CHOICES,
    integration_report,
    integration_study,
    is_balanced,
)


def test_the_errors_of_integrators_have_their_order() -> None:
    """implicitfast is of first order, RK4 of fourth."""
    exact = driven(IDEAL, "RK4", 2.5e-4, 0.5)
    coarse, fine = (np.abs(driven(IDEAL, "implicitfast", step, 0.5) - exact).max() for step in (2.5e-3, 1.25e-3))
    assert coarse / fine == pytest.approx(2.0, rel=0.1)
    coarse, fine = (np.abs(driven(IDEAL, "RK4", step, 0.5) - exact).max() for step in (2.5e-3, 1.25e-3))
    assert 12 < coarse / fine < 24


def test_the_page_tells_every_arm_and_the_balances() -> None:
    told: list[tuple[int, int]] = []
    study = integration_study(ARMS[-1:], BALANCED_ARMS[:1], 0.02, 0.2, Workforce(1), lambda *now: told.append(now))
    assert told == [(1, 2), (2, 2)]
    assert all(len(values) == len(CHOICES) and max(values) < 1e-3 for values in study.errors.values())
    text = integration_report(study).text
    for name in (ARMS[-1].name, BALANCED_ARMS[0].name):
        assert f"\n| {name} | " in text


@pytest.mark.parametrize(
    ("residual", "gain", "balanced"), [(9e-4, 9e-4, True), (-2e-3, 0.0, False), (0.0, 2e-3, False)]
)
def test_energy_that_comes_or_goes_is_told(residual: float, gain: float, balanced: bool) -> None:
    assert is_balanced([EnergyBalance(0.0, 0.0, 1.0), EnergyBalance(residual, gain, 1.0)]) is balanced
