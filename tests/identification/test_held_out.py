"""Motion that was not used to identify a model judges it."""

import numpy as np
import pytest

from dtwin.identification.data import Experiment
from dtwin.identification.excitation.plan import HELD_OUT
from dtwin.identification.held_out import compare
from tests.support.identification import ARM, SETTINGS, measured


def test_held_out_motion_judges_a_model() -> None:
    judged = measured(signal=HELD_OUT, noise=0.002, seed=9)
    offset = np.full(3, 0.001)
    right = compare([judged], ARM, offset)
    wrong = compare([judged], SETTINGS.known, offset)
    assert right.fit.min() > 0.99
    assert wrong.fit.max() < 0.9
    unknown = Experiment(judged.measured, judged.volts, judged.payload, None, payload_model=judged.payload_model)
    assert compare([unknown], ARM, offset).fit == pytest.approx(right.fit, abs=1e-3)
