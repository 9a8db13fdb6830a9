"""Friction, gears, cables and ripple never make energy: the balance of an arm that is swung and left alone."""

import pytest

from dtwin.emulation.machine.energy import balance_of
from dtwin.emulation.machine.sections import Machine
from evidence.integrators import BALANCED, BALANCED_ARMS, MINUTE, swing


@pytest.mark.parametrize("machine", BALANCED_ARMS, ids=lambda machine: machine.name)
def test_energy_is_balanced(machine: Machine) -> None:
    balance = balance_of(machine, lambda time: swing(time, MINUTE), MINUTE)
    assert balance.lost > 5.0
    assert abs(balance.residual) < BALANCED * balance.lost
    assert balance.gain < BALANCED * balance.lost
    assert balance.share < BALANCED
