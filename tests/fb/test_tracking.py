"""PATH_PLANNER and COMPUTED_TORQUE_CONTROL_3 together on the true arm, pickup to red."""

import numpy as np
import pytest
from driven import Driven, step, triple

from dtwin.parameters import PICKUP

# largest error of any joint, rad: T -> (default law empty, 0.2 kg, row-sum law empty, 0.2 kg)
ERRORS = {
    1.0: (0.0101, 0.119, 0.0486, 0.0905),
    2.0: (0.0047, 0.0253, 0.0229, 0.0247),
    4.0: (0.0016, 0.0066, 0.0097, 0.0088),
    8.0: (0.00070, 0.0018, 0.0039, 0.0040),
}


def largest_error(duration: float, law: int, payload: float, weight_only: bool) -> tuple[float, bool]:
    """Over the motion and 2 s after it; and whether a voltage was limited."""
    planner, controller = Driven("PATH_PLANNER"), Driven("COMPUTED_TORQUE_CONTROL_3")
    state = np.array([*PICKUP.theta, 0.0, 0.0, 0.0])
    planner.fire("TIMING", T=duration)
    planner.fire("TARGET", DESTINATION="red", **triple("THETA", state[:3]))
    controller.fire("RESET", LAW=law, GRIPPED=payload > 0, PAYLOAD_MASS=payload, WEIGHT_ONLY=weight_only)
    largest, limited = 0.0, False
    for _ in range(round((duration + 2) / 0.01)):
        planner.fire("REQ")
        path = {f"{name}{j}": planner[f"{name}{j}"] for name in ("THETA_D", "OMEGA_D", "ALPHA_D") for j in (1, 2, 3)}
        controller.fire("REQ", **triple("THETA", state[:3]), **path)
        volts = controller.triple("V")
        largest = max(largest, float(np.abs(planner.triple("THETA_D") - state[:3]).max()))
        limited = limited or bool((np.abs(volts) >= 8).any())
        state = step(state, volts.tolist(), payload)
    return largest, limited


@pytest.mark.parametrize("duration", ERRORS)
@pytest.mark.parametrize(("law", "payload"), [(0, 0.0), (0, 0.2), (1, 0.0), (1, 0.2)])
def test_tracking_error_with_the_weight_of_the_box_known(duration: float, law: int, payload: float) -> None:
    expected = ERRORS[duration][2 * law + (payload > 0)]
    error, limited = largest_error(duration, law, payload, weight_only=True)
    assert error == pytest.approx(expected, rel=0.1)
    assert limited == (duration == 1.0 and payload > 0)


def test_tracking_with_the_inertia_of_the_box_known_is_as_good_as_without_a_box() -> None:
    error, limited = largest_error(2.0, 0, 0.2, weight_only=False)
    assert error < 0.005
    assert not limited
