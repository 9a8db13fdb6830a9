from dataclasses import replace

import numpy as np

from dtwin.identification.estimation.estimate import identify
from dtwin.identification.estimation.friction import Friction, choose, indistinguishable_from_zero, with_friction
from dtwin.parameters import symbol_of
from tests.support.identification import ARM, SETTINGS, clean, measured, noisy


def test_viscous_is_preferred_on_a_viscous_arm() -> None:
    choice = choose([noisy(0, 0.005)], replace(SETTINGS, starts=3))
    assert choice.best == "viscous"
    both, coulomb = choice.estimates["both"], choice.estimates["coulomb"]
    assert both.whiteness.white
    assert indistinguishable_from_zero(both)
    assert both.values["D1"] == both.parameters.damping[0]
    assert abs(both.values["D1"] / 0.05 - 1) < 0.02
    # Coulomb alone ends in the best of its minima after several starts, and the residuals reject it.
    assert coulomb.starts > 1
    assert not coulomb.whiteness.white
    assert coulomb.bic > both.bic > choice.estimates["viscous"].bic


def test_coulomb_friction_is_found() -> None:
    mu = np.array([0.010, 0.008, 0.006])
    arm = ARM.with_values({f"mu{joint}": mu[joint - 1] for joint in (1, 2, 3)})
    rubbing = measured(seed=1, noise=0.005, arm=arm)
    both = identify([rubbing], with_friction(SETTINGS, "both"))
    assert both.whiteness.white
    assert not indistinguishable_from_zero(both)
    standard = np.array([both.standard_errors[f"mu{joint}"] for joint in (1, 2, 3)])
    assert np.all(np.abs(np.array(both.parameters.coulomb) - mu) < 4 * standard)
    assert standard[0] < 0.1 * mu[0]
    viscous = identify([rubbing], with_friction(SETTINGS, "viscous"))
    assert not viscous.whiteness.white
    assert viscous.bic > both.bic


def test_laws_free_their_own_coefficients() -> None:
    laws: tuple[tuple[Friction, str], ...] = (("viscous", "D"), ("coulomb", "mu"), ("both", "Dmu"))
    for law, free in laws:
        settings = with_friction(SETTINGS, law)
        names = {symbol_of(name) for name in settings.free}
        assert names - {"K", "I", "c"} == ({"D", "mu"} if free == "Dmu" else {free})
        assert (settings.known.coulomb[0] > 0) == ("mu" in names)
    assert len(clean()) == 350
