"""PATH_PLANNER and COMPUTED_TORQUE_CONTROL_3 together on the true arm, pickup to red."""

import numpy as np
import pytest

from dtwin.parameters import PICKUP, PLACES
from tests.support.driven import Array, Driven, step, to, triple

# largest error of any joint, rad: T -> (default law empty, 0.2 kg, row-sum law empty, 0.2 kg)
ERRORS = {
    1.0: (0.0101, 0.119, 0.0486, 0.0905),
    2.0: (0.0047, 0.0253, 0.0229, 0.0247),
    4.0: (0.0016, 0.0066, 0.0097, 0.0088),
    8.0: (0.00070, 0.0018, 0.0039, 0.0040),
}


def motion(
    colour: str, duration: float, hold: float, law: int, payload: float, weight_only: bool
) -> tuple[Array, bool]:
    """The largest joint error (rad) in each sample of the motion and of `hold` s after it, and whether a voltage
    was limited."""
    planner, controller = Driven("PATH_PLANNER"), Driven("COMPUTED_TORQUE_CONTROL_3")
    state = np.array([*PICKUP.theta, 0.0, 0.0, 0.0])
    planner.fire("TIMING", T=duration)
    planner.fire("TARGET", **to(colour), **triple("THETA", state[:3]))
    controller.fire("RESET", LAW=law, GRIPPED=payload > 0, PAYLOAD_MASS=payload, WEIGHT_ONLY=weight_only)
    errors, limited = [], False
    for _ in range(round((duration + hold) / 0.01)):
        planner.fire("REQ")
        path = {f"{name}{j}": planner[f"{name}{j}"] for name in ("THETA_D", "OMEGA_D", "ALPHA_D") for j in (1, 2, 3)}
        controller.fire("REQ", **triple("THETA", state[:3]), **path)
        volts = controller.triple("V")
        errors.append(np.abs(planner.triple("THETA_D") - state[:3]).max())
        limited = limited or bool((np.abs(volts) >= 8).any())
        state = step(state, volts.tolist(), payload)
    return np.array(errors), limited


@pytest.mark.parametrize("duration", ERRORS)
@pytest.mark.parametrize(("law", "payload"), [(0, 0.0), (0, 0.2), (1, 0.0), (1, 0.2)])
def test_tracking_error_with_the_weight_of_the_box_known(duration: float, law: int, payload: float) -> None:
    expected = ERRORS[duration][2 * law + (payload > 0)]
    errors, limited = motion("red", duration, 2.0, law, payload, weight_only=True)
    assert errors.max() == pytest.approx(expected, rel=0.1)
    assert limited == (duration == 1.0 and payload > 0)


@pytest.mark.parametrize("colour", sorted(PLACES))
def test_with_the_inertia_of_the_box_known_the_arm_tracks_and_holds(colour: str) -> None:
    errors, limited = motion(colour, 2.0, 6.0, 0, 0.2, weight_only=False)
    assert errors.max() < 0.01
    assert errors[-100:].max() < 5e-4
    assert not limited


def test_with_the_weight_alone_the_arm_does_not_hold_a_box_at_the_green_place() -> None:
    errors, _ = motion("green", 2.0, 6.0, 0, 0.2, weight_only=True)
    assert errors[-100:].max() > 0.02
