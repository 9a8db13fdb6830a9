"""Identification of drawn arms, whose parameters are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Actuator, Arm
from dtwin.arm.poses import drawn_poses
from dtwin.arm.urdf import read_urdf
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.errors import IdentificationError
from dtwin.identification.chain.baseline import Baseline
from dtwin.identification.chain.consistency import body_of, is_possible, mended, nearest_possible, pseudo_inertia
from dtwin.identification.chain.design import Filtering
from dtwin.identification.chain.friction import dahl
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify, unexplained
from dtwin.identification.chain.overlay import write_urdf
from dtwin.identification.chain.result import as_object, numbers, write_toml
from dtwin.measurements.measurement import Measurement
from dtwin.run.chain import ChainSettings, run
from tests.support.chains import drawn_arm, drawn_urdf, measured

JOINTS = 3
GAIN = np.array([8.0, 12.0, 5.0])


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), JOINTS, 11)


def believed(arm: Arm) -> Arm:
    """A data sheet that is 20 % wrong about every body."""
    return arm.with_parameters(1.2 * arm.parameters)


@pytest.fixture(scope="module")
def found(arm: Arm) -> Identification:
    empty, full = measured(arm, 25.0, 1, noise=0.02), measured(arm, 25.0, 2, noise=0.02, load=1.5)
    return identify(believed(arm), [Sample(empty), Sample(full, "box")])


def test_a_load_is_found_within_its_interval(found: Identification) -> None:
    mass, deviation = found.load("box")
    assert abs(mass - 1.5) < 2.5 * deviation
    assert deviation < 0.05


def test_intervals_hold_what_is_true(arm: Arm, found: Identification) -> None:
    """Friction is 2 + 1.5 v in every joint; told at the joint's usual speed and at a tenth of it."""
    rows = [row for row in numbers(found) if " friction at " in row.name]
    speeds = [float(row.name.rpartition(" ")[2]) for row in rows]
    right = [
        abs(row.value - (np.sign(v) * 2.0 + 1.5 * v)) < row.half + 0.03 for row, v in zip(rows, speeds, strict=True)
    ]
    assert np.mean(right) > 0.8
    assert any("rotor" in row.name for row in rows) == ("rotor" in found.groups)


def test_motion_that_was_not_fitted_is_explained_better_than_by_least_squares(
    arm: Arm, found: Identification
) -> None:
    other = measured(arm, 15.0, 7, noise=0.02)
    ours = unexplained(*found.predicted(other))
    training = measured(arm, 25.0, 1, noise=0.02)
    theirs = unexplained(*Baseline(arm, [training], np.ones(JOINTS), Filtering()).predicted(other))
    assert (ours < 0.05).all()
    assert np.exp(np.mean(np.log(ours / theirs))) < 0.9


def test_every_body_is_possible(found: Identification) -> None:
    assert all(is_possible(link.parameters) for link in found.arm.links)


def in_amperes(measurement: Measurement) -> Measurement:
    assert measurement.effort is not None
    return replace(measurement, effort=measurement.effort / GAIN, kind="current")


def driven(arm: Arm, constant: float | None) -> Arm:
    actuator = Actuator("current", constant)
    return replace(arm, joints=tuple(replace(joint, actuator=actuator) for joint in arm.joints))


def test_gains_are_found_when_a_known_load_was_carried(arm: Arm) -> None:
    empty, full = measured(arm, 25.0, 1, noise=0.01), measured(arm, 25.0, 2, noise=0.01, load=1.5)
    samples = [Sample(in_amperes(empty)), Sample(in_amperes(full), "box")]
    result = identify(driven(believed(arm), None), samples, Settings({"box": 1.5}, groups=()))
    assert np.abs(result.found.gain / GAIN - 1.0).max() < 0.05
    assert (np.abs(result.found.gain / GAIN - 1.0) < 3.0 * result.gain_deviations() + 0.005).all()


def test_the_constant_of_a_commanded_torque_is_no_scale_of_a_current(arm: Arm) -> None:
    """A file of an arm that says nothing of its drives has torques with a constant of 1."""
    actuator = Actuator("torque", 1.0, tolerance=0.05)
    silent = replace(believed(arm), joints=tuple(replace(joint, actuator=actuator) for joint in arm.joints))
    empty, full = measured(arm, 25.0, 1, noise=0.01), measured(arm, 25.0, 2, noise=0.01, load=1.5)
    with pytest.raises(IdentificationError, match="the currents have no scale"):
        identify(silent, [Sample(in_amperes(empty))])
    samples = [Sample(in_amperes(empty)), Sample(in_amperes(full), "box")]
    result = identify(silent, samples, Settings({"box": 1.5}, groups=()))
    assert np.abs(result.found.gain / GAIN - 1.0).max() < 0.05


def test_currents_without_any_scale_are_refused(arm: Arm) -> None:
    empty = in_amperes(measured(arm, 10.0, 1))
    with pytest.raises(IdentificationError, match="the currents have no scale"):
        identify(driven(arm, None), [Sample(empty)])
    unnamed = replace(empty, kind=None)
    with pytest.raises(IdentificationError, match="nobody says the unit of the effort"):
        identify(arm, [Sample(unnamed)])
    with pytest.raises(IdentificationError, match="expected columns of torque, current or voltage"):
        identify(arm, [Sample(replace(empty, effort=None, kind="torque"))])
    two = replace(empty, q=empty.q[:, :2])
    with pytest.raises(IdentificationError, match="expected 3 joints"):
        identify(arm, [Sample(two)])


def test_what_was_found_is_written_for_people_and_programs(found: Identification, tmp_path: Path) -> None:
    content = as_object(found)
    assert set(content["not_told"]) < set(content["numbers"])
    write_toml(found, tmp_path / "found.toml")
    assert '"load box m"' in (tmp_path / "found.toml").read_text()
    template = tmp_path / "template.urdf"
    template.write_text(drawn_urdf(JOINTS, 11))
    write_urdf(found, template, tmp_path / "found.urdf")
    again = read_urdf(tmp_path / "found.urdf")
    assert np.allclose(again.parameters, found.arm.parameters, rtol=1e-6, atol=1e-8)


def drawn_bodies(count: int, seed: int) -> np.ndarray:
    """Parameters of bodies that can be, (10 count,)."""
    roots = np.random.default_rng(seed).normal(size=(count, 4, 4)) * np.array([0.1, 0.1, 0.1, 1.0])[:, None]
    return np.concatenate([body_of(root @ root.T) for root in roots])


def test_every_body_has_its_pseudo_inertia() -> None:
    body = drawn_bodies(1, 0)
    assert is_possible(body)
    assert np.allclose(body_of(pseudo_inertia(body)), body)
    assert np.allclose(mended(body), body)


def test_the_nearest_body_keeps_what_is_possible_and_mends_what_is_not() -> None:
    good = drawn_bodies(1, 0)
    assert nearest_possible(good, np.eye(10), good) is good
    bad = good.copy()
    bad[0] = -0.1
    nearest = nearest_possible(bad, np.eye(10), good)
    assert is_possible(nearest)
    assert np.linalg.norm(nearest - bad) < 1.0


@pytest.mark.parametrize("seed", range(5))
def test_no_possible_bodies_are_nearer_than_the_nearest(seed: int) -> None:
    """Known to a thousandth in some directions and hardly at all in others, as the bodies of an arm are.

    The problem is convex: of the nearest point, no way to a possible one begins with a way nearer.
    """
    generator = np.random.default_rng(seed)
    truth, sheet = drawn_bodies(3, seed), drawn_bodies(3, seed + 100)
    turn = np.linalg.qr(generator.normal(size=(30, 30)))[0]
    deviations = np.exp(generator.uniform(np.log(1e-3), np.log(3.0), 30))
    precision = turn / deviations**2 @ turn.T
    estimate = truth + turn @ (deviations * generator.normal(size=30))
    assert not all(is_possible(body) for body in estimate.reshape(-1, 10))
    nearest = nearest_possible(estimate, precision, sheet)
    assert all(is_possible(body) for body in nearest.reshape(-1, 10))
    assert (truth - nearest) @ precision @ (nearest - estimate) > -0.05


def test_dahls_element_turns_over_with_travel() -> None:
    q = np.concatenate([np.linspace(0.0, 1.0, 400), np.linspace(1.0, 0.0, 400)])
    state = dahl(q, 0.1)
    assert np.isclose(state[399], 1.0 - np.exp(-10.0), atol=1e-6)
    turned = 400 + 40  # a tenth of the way back is one length
    assert np.isclose(state[turned], -1.0 + 2.0 * np.exp(-1.0), atol=0.02)


def test_the_dry_friction_of_an_emulated_arm_is_found_in_its_form() -> None:
    """A machine drawn from the tolerances, whose joints come to rest often; without the form a tenth more is left."""
    arm = arm_of("planar-2r")
    machine = machine_of("1901", arm)
    logs = [
        run(ChainSettings(arm, machine, drawn_poses(arm, 40, np.random.default_rng(k)), duration=30.0, seed=k))
        for k in (1, 2)
    ]
    fitted, other = (log.measurement() for log in logs)
    found = identify(arm, [Sample(fitted)])
    without = identify(arm, [Sample(fitted)], Settings(groups=("curve", "presliding")))
    assert "soft" in found.groups
    left = unexplained(*found.predicted(other))
    assert (left < 0.01).all()
    assert np.exp(np.mean(np.log(left / unexplained(*without.predicted(other))))) < 0.9
