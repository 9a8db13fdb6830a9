"""The margins that the operator keeps are those that uploads have to keep."""

import msgspec
import pytest

from dtwin.controller.proposed import LeastMargins, ProposedSettings
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.recovery.margins import gains_with_margins
from dtwin.simulation.checks import Checker
from dtwin.simulation.proposal import controllable, tolerated
from dtwin.twin.effects import Effects
from tests.support.records import recorded

LACKING = LeastMargins(0.1, 3.0, 20.0, 1.0, 0.2)
REFUSED = ProposedSettings(ControlSettings(law="cascade"), (1.0, 2.0), LACKING, LACKING, 0.1, "too slow", [])


@pytest.mark.parametrize("rotors", [(0.001, 0.001, 0.001), (0.001, 0.001, 0.002), (0.001, 0.002, 0.001)])
def test_an_arm_too_slow_for_the_margins_keeps_its_gains_when_nothing_has_changed(
    rotors: tuple[float, float, float],
) -> None:
    """What is least may be where a box has been put down, and no motion ends: that counts for what is asked, too."""
    record = msgspec.structs.replace(
        recorded(Effects(delay=0.0134, lag=(0.0037,) * 3, rotor_inertia=rotors)), settings=REFUSED
    )
    settings = ControlSettings(law="cascade", gains=USUAL_GAINS["cascade"], model=controllable(record))
    checker = Checker(effects=record.effects)
    assert not checker.keeps_margins(settings, record.arm), "what is demanded of other arms"
    tolerated(record, settings.law, checker)
    assert checker.keeps_margins(settings, record.arm)
    assert gains_with_margins(settings, record.arm, record, 0.0) == settings.gains
