"""What the commands of an arm are held against: its motion, filtered."""

import numpy as np
import pytest

from dtwin.arm.chain import Array
from dtwin.emulation.chain.arms import arm_of
from dtwin.monitoring.chain.expected import EVERY, WINDOW, filtered

ARM = arm_of("planar-2r")


@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_samples_are_filtered_as_savitzky_and_golay_say(derivative: int) -> None:
    from scipy.signal import savgol_filter  # takes long to load

    q: Array = np.random.default_rng(4).normal(size=(200, len(ARM)))
    t: Array = ARM.period * np.arange(len(q), dtype=np.float64)
    log = filtered(ARM, t, q, np.zeros_like(q))
    middle = slice(WINDOW // 2, len(q) - WINDOW // 2, EVERY)
    known = savgol_filter(q, WINDOW, 3, derivative, ARM.period, axis=0)[middle]
    assert (log.q, log.qd, log.qdd)[derivative] == pytest.approx(known, rel=1e-9, abs=1e-9)
