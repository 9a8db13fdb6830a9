import math

import numpy as np
import pytest

from dtwin.errors import IdentificationError
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.design import optimise, predict
from dtwin.identification.excitation.plan import PLAIN, Plan
from dtwin.identification.excitation.rig import Rig
from tests.support.identification import ARM, FREE, SETTINGS, blocks, truth

DEVIATION = 0.003


def test_bounds_scale_with_the_noise_and_shrink_with_more_runs() -> None:
    one = predict([Plan()], FREE, ARM, DEVIATION)
    assert predict([Plan()], FREE, ARM, 2 * DEVIATION).worst == pytest.approx(2 * one.worst)
    twice = predict([Plan(), Plan()], FREE, ARM, DEVIATION)
    assert twice.worst == pytest.approx(one.worst / math.sqrt(2))


def test_what_is_not_identifiable_has_no_bound() -> None:
    empty = predict([Plan(payload=0.0)], FREE, ARM, DEVIATION)
    assert empty.worst == math.inf
    assert math.isnan(empty.bounds["K1"])
    assert predict([Plan(payload=0.0), Plan()], FREE, ARM, DEVIATION).worst < 0.2


def test_the_optimised_signal_tells_three_times_as_much() -> None:
    """The signal keeps the voltages, the duration and the reach asked for, and a fit to it is that much better."""
    plan = optimise(Plan(), FREE, SETTINGS.known, DEVIATION, np.random.default_rng(0), trials=400)
    assert np.all(np.abs(plan.signal.amplitude) <= PLAIN.amplitude)
    assert plan.samples == Plan().samples
    plain, better = (predict([p], FREE, ARM, DEVIATION) for p in (Plan(), plan))
    assert better.worst < plain.worst / 3
    assert max(better.reach) < math.pi
    errors = []
    for seed in range(4):
        experiment = Rig(noise=0.010).measure(plan, blocks(), np.random.default_rng(seed))
        estimate = identify([experiment], SETTINGS)
        assert estimate.whiteness.white
        errors.append(np.array([estimate.values[name] for name in FREE]) / truth(FREE) - 1)
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < plain.worst / 3


def test_equal_seeds_design_equal_signals() -> None:
    first, second = (
        optimise(Plan(), FREE, ARM, DEVIATION, np.random.default_rng(3), trials=60).signal for _ in range(2)
    )
    assert first == second


def test_what_cannot_be_designed_is_said() -> None:
    with pytest.raises(IdentificationError, match=r"no signal of 20 tried keeps every joint within 0.1 rad"):
        optimise(Plan(), FREE, ARM, DEVIATION, np.random.default_rng(0), reach=0.1, trials=20)
