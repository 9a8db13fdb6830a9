"""JOINT_DRIVE: what a command makes good of dry friction."""

import pytest

from tests.support.driven import Driven

COULOMB = 4.0


@pytest.mark.parametrize(("slides", "full"), [(False, 0.05), (True, 0.005)])
def test_dry_friction_is_made_good_in_full_from_a_slow_velocity_on(slides: bool, full: float) -> None:
    block = Driven("JOINT_DRIVE")
    block.fire("INIT", COULOMB=COULOMB, SLIDES=slides)
    for part in (-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0):
        block.fire("REQ", QD=part * full)
        assert block["COMMAND"] == pytest.approx(COULOMB * max(-1.0, min(1.0, part)))
