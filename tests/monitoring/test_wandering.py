"""What is said and allowed of a healthy arm that changes while it is watched, as one that warms."""

from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.learning.wandering import longer, wandered, warmed
from dtwin.monitoring.offline import stream
from tests.support.records import HEALTHY


def test_friction_that_grows_while_an_arm_is_watched_is_seen_to(belief: Belief, run_cell: Callable[..., Log]) -> None:
    found = wandered(belief, stream(run_cell(180.0, 3, "D2*=1.2@65")))
    earlier, later = found["D2"]
    assert 60.0 * earlier == pytest.approx(0.2, abs=0.06)
    assert abs(later) < 0.3 * earlier


def test_an_arm_that_stays_as_it_is_has_no_rates(belief: Belief, run_cell: Callable[..., Log]) -> None:
    assert wandered(belief, stream(run_cell(180.0, 3))) == {}


def test_a_short_log_tells_nothing(belief: Belief, run_cell: Callable[..., Log]) -> None:
    assert wandered(belief, stream(run_cell(30.0, 3))) == {}


def test_what_changes_may_wander_as_fast(belief: Belief) -> None:
    """A change of a tenth in 100 s: as far in a minute as a random walk of 0.77 % in a second."""
    usual, warming = belief, replace(belief, rates={"D2": (2e-3, 1e-3)})
    gained = [Estimator(each, Tuning()).arrays()["walk"][0, INDEX["D2"]] for each in (usual, warming)]
    assert gained[1] / gained[0] == pytest.approx((2e-3 * 60.0**0.5 / Tuning().walk) ** 2)


@pytest.mark.parametrize(
    ("rates", "seconds"),
    [((1e-3, 5e-5), 0.0), ((2e-3, 1e-3), 400.0), ((1e-3, 1e-3), None), ((1e-3, -1e-3), None)],
    ids=["over", "dies away", "goes on", "turns"],
)
def test_how_long_an_arm_goes_on_changing(rates: tuple[float, float], seconds: float | None) -> None:
    assert longer({"K1": rates}, 300.0) == seconds


def test_commissioning_says_what_to_do() -> None:
    assert not warmed(HEALTHY)
    told = warmed(msgspec.structs.replace(HEALTHY, duration=300.0, rates={"D1": (-2e-3, -1e-3)}))
    assert "in the last 100 s D1 by -10.0 %" in told
    assert "let it work for 7 minutes more" in told
