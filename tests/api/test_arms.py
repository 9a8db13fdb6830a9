"""Other arms from Python: on the twin, and what is best for them."""

import numpy as np
import pytest

import dtwin


def test_the_twin_of_an_arm_works_with_other_settings() -> None:
    usual, soft, heavy = (
        np.abs(dtwin.simulate_arm("planar-2r", 4.0, pole=pole, payload=payload).error).max(axis=0)
        for pole, payload in ((None, 0.0), (6.0, 0.0), (None, 0.4))
    )
    assert (soft > usual).all()
    assert (heavy > usual).all()
    with pytest.raises(dtwin.DtwinError, match="pole: expected 1 to 60 rad/s, got 0"):
        dtwin.simulate_arm("planar-2r", pole=0.0)


def test_the_best_settings_of_an_arm_are_found() -> None:
    told: list[int] = []
    found = dtwin.optimise_arm(
        "planar-2r", cost={"tracking": 1.0}, arms=0, candidates=24, between=lambda done, best: told.append(done)
    )
    assert (found.best.broken, found.reference.cost) == ("", 1.0)
    assert found.best.cost <= 1.0
    assert told[-1] == len(found.scores) >= 24
    with pytest.raises(dtwin.DtwinError, match="candidates: expected at least"):
        dtwin.optimise_arm("planar-2r", candidates=3)
    with pytest.raises(dtwin.DtwinError, match=r"joints\.shoulder"):
        dtwin.optimise_arm("servo-2r")
