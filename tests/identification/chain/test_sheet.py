"""What a data sheet with its tolerances adds to the motion, and when it is not believed."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Friction, Link, Tolerances
from dtwin.equations.rigid import regressor
from dtwin.identification.chain.identify import Sample, Settings, identify, unexplained
from dtwin.identification.chain.prior import _differs
from dtwin.measurements.measurement import Measurement
from tests.support.chains import drawn_arm, measured


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 11)


def rubbing(arm: Arm) -> Arm:
    """The arm with the friction that `measured` gives its joints, on its data sheet."""
    return replace(arm, joints=tuple(replace(joint, friction=Friction(1.5, 2.0)) for joint in arm.joints))


def held(arm: Arm, joint: int, stuck: float) -> Measurement:
    """A log in which one joint stands, held by dry friction with `stuck` N m more than it needs."""
    plain = measured(arm, 25.0, 1, noise=0.01)
    assert plain.v is not None
    q, v = plain.q.copy(), plain.v.copy()
    q[:, joint], v[:, joint] = 0.3, 0.0
    torque = regressor(arm, q, v, np.gradient(v, 0.01, axis=0)) @ arm.parameters + 2.0 * np.tanh(v / 0.02) + 1.5 * v
    torque[:, joint] += stuck * np.sin(0.2 * plain.t)
    return replace(plain, q=q, v=v, effort=torque)


def test_the_effort_of_a_joint_that_stood_says_nothing_of_the_links(arm: Arm) -> None:
    """Friction holds it with anything up to its limit, which is no weight."""
    free, stuck = (identify(rubbing(arm), [Sample(held(arm, 1, size))], Settings(groups=())) for size in (0.0, 1.8))
    assert list(free.design.still) == [False, True, False]
    assert stuck.arm.parameters == pytest.approx(free.arm.parameters, abs=1e-6)


def test_the_friction_of_a_joint_that_stood_is_the_data_sheets(arm: Arm) -> None:
    found = identify(rubbing(arm), [Sample(held(arm, 1, 1.0))], Settings(groups=()))
    left = unexplained(*found.predicted(measured(arm, 15.0, 7, noise=0.01)))
    assert found.away == 1.0
    assert (left < 0.06).all()


def off(arm: Arm) -> Arm:
    """The arm with masses that are half as large again on its data sheet, all else as in truth."""
    bodies = [replace(link, mass=1.5 * link.mass, inertia=1.5 * link.inertia) for link in arm.links]
    return replace(arm, links=tuple(bodies))


def test_a_data_sheet_that_is_far_off_is_not_believed(arm: Arm) -> None:
    log = Sample(measured(arm, 25.0, 1, noise=0.01))
    near, far = identify(arm, [log], Settings(groups=())), identify(off(arm), [log], Settings(groups=()))
    assert near.away == 1.0
    assert far.away is None or far.away > 2.0


def test_tolerances_make_the_covariance_of_bodies_that_are_drawn_from_them() -> None:
    link = Link("link", 3.0, np.array([0.1, -0.05, 0.2]), np.diag([0.02, 0.03, 0.01]))
    spread = Tolerances()
    generator = np.random.default_rng(3)
    drawn = []
    for _ in range(4000):
        mass, inertia = np.exp(np.array([spread.mass, spread.inertia]) * generator.standard_normal(2))
        centre = link.centre + spread.centre * generator.standard_normal(3)
        drawn.append(Link("link", mass * link.mass, centre, mass * inertia * link.inertia).parameters)
    found, seen = _differs(link, spread, 1.0), np.cov(np.array(drawn).T)
    size = np.sqrt(np.diag(found))
    # Entries of an inertia may each differ a little by themselves beside that.
    assert found[:4, :4] / np.outer(size, size)[:4, :4] == pytest.approx(
        seen[:4, :4] / np.outer(size, size)[:4, :4], abs=0.08
    )
    assert (np.diag(seen) <= 1.1 * np.diag(found)).all()
