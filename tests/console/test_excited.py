"""The motion that the models are shown against, as a busy console hears it."""

import numpy as np
import pytest

from dtwin.bus.messages import Acted
from dtwin.bus.twin_messages import IdentificationState
from dtwin.console.calculations.excited import PIECE, excited_experiments
from dtwin.console.calculations.tasks import Excited
from dtwin.console.excited import ExcitedMotion
from dtwin.errors import ParameterError
from dtwin.identification.held_out import compare
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.signals import Sensors
from tests.support.identification import measured

LOST = {120, 121, 122, 190}


def heard() -> Excited:
    """What is kept of a signal of which samples were lost."""
    experiment, motion = measured(payload=0.0), ExcitedMotion()
    motion.update_state(IdentificationState("measuring", ""))
    rows = zip(experiment.measured.tolist(), experiment.volts.tolist(), strict=True)
    for number, (theta, volts) in enumerate(rows):
        time = number * PERIOD
        first, second, third = theta
        one, two, three = volts
        if number not in LOST:
            sensors = Sensors(number, time, (first, second, third), 0.9, False, "")
            motion.extend([(sensors, Acted(number, time, (one, two, three, 0.0), False))])
    motion.update_state(IdentificationState("estimating", ""))
    assert motion.last is not None
    return motion.last


def test_the_true_arm_fits_a_signal_of_which_samples_were_lost() -> None:
    experiments = excited_experiments(heard())
    assert [len(experiment) for experiment in experiments] == [120, 67, 159]
    assert (compare(experiments, ArmParameters(), np.zeros(3)).fit > 0.999).all()


def test_what_is_too_short_is_refused() -> None:
    whole = heard()
    torn = Excited(tuple(2 * number for number in whole.numbers), whole.theta, whole.volts, {})
    with pytest.raises(ParameterError, match=f"no {PIECE} samples"):
        excited_experiments(torn)
