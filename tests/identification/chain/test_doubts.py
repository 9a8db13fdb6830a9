"""What numbers bear: joints that stood, directions in which none slid, and efforts that are noise."""

from dataclasses import replace

import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.equations.rigid import regressor
from dtwin.identification.chain.delay import delays
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify
from dtwin.identification.chain.overlay import overlaid
from dtwin.identification.chain.result import as_object, doubts, moved, narrow, numbers, slid
from dtwin.measurements.measurement import Measurement
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import run
from tests.support.chains import drawn_arm, measured


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 11)


def standing(arm: Arm, joint: int) -> Measurement:
    """A log in which one joint stands, but for a step of its encoder to and fro."""
    plain = measured(arm, 25.0, 1, noise=0.01)
    assert plain.v is not None
    q, v = plain.q.copy(), plain.v.copy()
    generator = np.random.default_rng(2)
    q[:, joint] = 0.3 + 4e-4 * generator.integers(0, 2, len(q))
    v[:, joint] = 0.0
    torque = regressor(arm, q, v, np.gradient(v, 0.01, axis=0)) @ arm.parameters + 2.0 * np.tanh(v / 0.02) + 1.5 * v
    torque += 0.01 * torque.std(axis=0) * generator.normal(size=torque.shape)
    return replace(plain, q=q, v=v, effort=torque)


@pytest.fixture(scope="module")
def stood(arm: Arm) -> Identification:
    return identify(arm, [Sample(standing(arm, 1))], Settings(groups=("rotor",)))


def test_nothing_is_told_of_a_joint_that_stood(arm: Arm, stood: Identification) -> None:
    assert [moved(stood, joint) for joint in range(3)] == [True, False, True]
    told = [row.name for row in numbers(stood) if row.told]
    assert not [name for name in told if name.startswith("joint_2 ")]
    assert "joint_1 friction" in " ".join(told)
    assert not delays(stood)[1].told
    assert doubts(stood) == ["hardly moved, so that nothing is told of their friction, rotors and gears: joint_2"]
    assert as_object(stood)["doubts"] == doubts(stood)
    found = overlaid(stood)
    assert found.joints[1].friction == arm.joints[1].friction
    assert found.joints[0].friction.coulomb == pytest.approx(2.0, abs=0.6)


def test_friction_is_told_only_in_directions_in_which_the_joint_slid(arm: Arm) -> None:
    """A joint that turns one way and on: only so does anything say what it loses."""
    plain = measured(arm, 25.0, 1, noise=0.01)
    assert plain.v is not None
    q, v = plain.q.copy(), plain.v.copy()
    v[:, 0] = 0.1 + 0.05 * np.sin(plain.t)
    q[:, 0] = -1.0 + 0.1 * plain.t + 0.05 * (1.0 - np.cos(plain.t))
    a = np.gradient(v, 0.01, axis=0)
    torque = regressor(arm, q, v, a) @ arm.parameters + 2.0 * np.tanh(v / 0.02) + 1.5 * v
    log = replace(plain, q=q, v=v, effort=torque + 0.01 * np.random.default_rng(2).normal(size=torque.shape))
    found = identify(arm, [Sample(log)], Settings(groups=()))
    usual = found.design.scales[0].speed
    assert slid(found, 0, usual) > 10.0
    assert slid(found, 0, -usual) == 0.0
    told = {row.name for row in numbers(found) if row.told and row.name.startswith("joint_1 friction")}
    assert not [name for name in told if " at -" in name]


def test_a_joint_that_kept_to_a_part_of_its_range_is_named(arm: Arm) -> None:
    """Its friction and rotor were seen there alone."""
    plain = measured(arm, 25.0, 1, noise=0.01)
    assert plain.v is not None
    q, v = plain.q.copy(), plain.v.copy()
    share = 0.1 / q[:, 2].std()
    q[:, 2], v[:, 2] = share * q[:, 2], share * v[:, 2]
    torque = regressor(arm, q, v, np.gradient(v, 0.01, axis=0)) @ arm.parameters + 2.0 * np.tanh(v / 0.02) + 1.5 * v
    log = replace(plain, q=q, v=v, effort=torque + 0.01 * np.random.default_rng(2).normal(size=torque.shape))
    bounded = replace(arm, joints=tuple(replace(joint, lower=-1.5, upper=1.5) for joint in arm.joints))
    found = identify(bounded, [Sample(log)], Settings(groups=("rotor",)))
    assert [narrow(found, joint) for joint in range(3)] == [False, False, True]
    assert doubts(found) == ["kept to a small part of their ranges: motion beyond it is not identified: joint_3"]
    assert not [row.name for row in numbers(found) if row.told and row.name.startswith("joint_3 ")]


def test_an_effort_that_is_noise_is_named(arm: Arm) -> None:
    plain = measured(arm, 25.0, 1, noise=0.01)
    assert plain.effort is not None
    effort = plain.effort.copy()
    effort[:, 2] = np.random.default_rng(4).normal(size=len(effort))
    found = identify(arm, [Sample(replace(plain, effort=effort))])
    assert any(line.startswith("more than 70% of the effort") and "joint_3" in line for line in doubts(found))
    assert not delays(found)[2].told


def rubbing(arm: Arm) -> tuple[Identification, dict[str, float]]:
    """What was found of joints whose friction falls with speed, and that friction by the names of the numbers."""

    def friction(v: np.ndarray) -> np.ndarray:
        return np.asarray(2.0 * (1.0 + 0.5 * np.exp(-np.abs(v) / 0.1)) * np.tanh(v / 0.01) + 1.5 * v)

    plain = measured(arm, 60.0, 1)
    assert plain.v is not None
    torque = regressor(arm, plain.q, plain.v, np.gradient(plain.v, 0.01, axis=0)) @ arm.parameters + friction(plain.v)
    torque += 0.002 * torque.std(axis=0) * np.random.default_rng(2).normal(size=torque.shape)
    found = identify(arm, [Sample(replace(plain, effort=torque))], Settings(groups=()))
    names = [row.name for row in numbers(found) if " friction at " in row.name]
    return found, {name: float(friction(np.array(float(name.rpartition(" ")[2])))) for name in names}


def test_intervals_count_a_form_of_friction_that_no_term_has(arm: Arm) -> None:
    """What correlation in time alone would say is far too sure: the same is missed whenever a joint is as fast."""
    found, truth = rubbing(arm)
    sizes = []
    for each in (found, replace(found, bands=np.zeros_like(found.bands))):
        rows = [row for row in numbers(each) if row.name in truth]
        sizes.append(np.sqrt(np.mean([((row.value - truth[row.name]) / row.half) ** 2 for row in rows])))
    assert sizes[0] < 1.3
    assert sizes[1] > 4.0


def test_what_motion_tells_only_together_with_other_bodies_is_not_told() -> None:
    """The inertia at the shoulder is that of the upper arm and of the forearm's mass at the elbow: one number."""
    settings = ArmCell(arm="planar-2r", machine="nominal").settings(40.0, 3)
    told = {row.name for row in numbers(identify(settings.arm, [Sample(run(settings).measurement())])) if row.told}
    assert {"fore mcx", "fore Iyy"} <= told
    assert not {"upper m", "upper mcx", "upper Iyy", "fore m"} & told
