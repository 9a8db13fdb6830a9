"""The MuJoCo plant: known motions of the unpowered arm, agreement with the twin, and what it refuses."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.plant import Plant
from dtwin.errors import DivergenceError, ModelError, ParameterError
from dtwin.parameters import (
    COULOMB_WIDTH,
    GRAVITY,
    HANGING,
    HOME,
    PERIOD,
    PHYSICS_STEP,
    PICKUP,
    PLACES,
    VOLTAGE_LIMIT,
    ArmParameters,
    GripperParameters,
    JointVector,
    scaled,
)
from dtwin.twin import dynamics
from tests.support.examples import examples

ARM = ArmParameters()
GRIPPER = GripperParameters()
PLANT = Plant()


def lowest(plant: Plant, duration: float) -> tuple[float, float]:
    """Smallest theta_1 (rad) and when (s)."""
    best = (math.inf, 0.0)
    for _ in range(round(duration / PHYSICS_STEP)):
        plant.advance(PHYSICS_STEP)
        best = min(best, (plant.theta[0], plant.time))
    return best


def energy(plant: Plant, arm: ArmParameters, payload: float) -> float:
    """Kinetic plus potential energy (J), from each mass's own position and speed."""
    angle = rate = x = z = vx = vz = total = 0.0
    for i in range(3):
        angle += plant.theta[i]
        rate += plant.omega[i]
        cos, sin = math.cos(angle), math.sin(angle)
        c, l, m = arm.com[i], arm.length[i], arm.mass[i]
        speed = (vx - c * sin * rate) ** 2 + (vz + c * cos * rate) ** 2
        total += m * speed / 2 + arm.inertia[i] * rate**2 / 2 + m * GRAVITY * (z + c * sin)
        x, z, vx, vz = x + l * cos, z + l * sin, vx - l * sin * rate, vz + l * cos * rate
    return total + payload * ((vx**2 + vz**2) / 2 + GRAVITY * z)


@pytest.mark.parametrize(
    ("arm", "angle", "time"),
    [
        (ARM, -2.3422, 0.670),
        (scaled(ARM, "m", 1.5), -2.4867, 0.6575),
        (scaled(ARM, "I", 2.0), -2.3475, 0.680),
    ],
    ids=["default", "masses x 1.5", "inertias x 2"],
)
def test_drop_from_home(arm: ArmParameters, angle: float, time: float) -> None:
    plant = Plant(arm)
    plant.reset(HOME)
    assert lowest(plant, 2.0) == (pytest.approx(angle, abs=5e-5), pytest.approx(time, abs=1e-9))


def test_dropped_arm_comes_to_rest_hanging() -> None:
    plant = Plant()
    plant.reset(HOME)
    for _ in range(2000):
        plant.advance(PERIOD)
    assert plant.theta == pytest.approx(HANGING, abs=1e-4)
    assert plant.time == 20.0


def test_upright_arm_falls_from_rounding_alone() -> None:
    plant = Plant()
    plant.reset((math.pi / 2, 0.0, 0.0))
    for _ in range(750):
        plant.advance(PERIOD)
    assert plant.theta[0] > 1.5
    for _ in range(150):
        plant.advance(PERIOD)
    assert plant.theta[0] < 0


def test_energy_is_kept_without_damping_and_voltage() -> None:
    arm = scaled(ARM, "D", 0.0)
    plant = Plant(arm)
    plant.set_payload(0.2)
    plant.reset((0.3, -0.2, 0.5), (1.0, -2.0, 3.0))
    before = energy(plant, arm, 0.2)
    for _ in range(400):
        plant.advance(PHYSICS_STEP)
    # RK4 loses O(h^4): 1e-4 of the energy exchanged, measured 2e-6 J at this step.
    assert energy(plant, arm, 0.2) == pytest.approx(before, abs=2e-5)


values = st.floats(0.5, 2.0)


@examples(200)
@given(
    factors=st.lists(values, min_size=18, max_size=18),
    coulomb=st.sampled_from((0.0, 0.01, 0.05)),
    payload=st.sampled_from((0.0, 0.19, 0.35)),
    theta=st.tuples(*[st.floats(-7.0, 7.0)] * 3),
    omega=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
    volts=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
)
def test_accelerations_are_those_of_the_analytic_twin(
    factors: list[float], coulomb: float, payload: float, theta: JointVector, omega: JointVector, volts: JointVector
) -> None:
    scaled_values = [factor * value for factor, value in zip(factors, ARM.vector()[:18], strict=True)]
    arm = ArmParameters.from_vector((*scaled_values, coulomb, coulomb, coulomb))
    PLANT.set_parameters(arm)
    PLANT.set_payload(payload)
    expected = dynamics.forward_dynamics(np.array(theta + omega), np.array(volts), np.array(arm.vector()), payload)
    got = PLANT.acceleration(theta, omega, (*volts, 0.0))
    assert np.abs(got - expected).max() <= 1e-10 * max(1.0, np.abs(expected).max())


def test_parameters_and_payload_can_be_taken_back_exactly() -> None:
    plant, fresh = Plant(scaled(ARM, "c", 0.5)), Plant()
    plant.set_parameters(scaled(ARM, "m", 2.0))
    plant.set_payload(0.2)
    plant.set_locked({2})
    plant.set_parameters(ARM)
    plant.set_payload(0.0)
    plant.set_locked(())
    state = (0.1, 0.2, 0.3), (1.0, 2.0, 3.0), (1.0, 0.0, -1.0, 0.0)
    assert plant.acceleration(*state) == fresh.acceleration(*state)


def test_file_agrees_with_the_default_parameters() -> None:
    file = mujoco.MjModel.from_xml_path(str(MODEL_FILE))
    own = Plant().model
    for i in range(3):
        for field in ("body_mass", "body_inertia", "body_ipos", "body_pos"):
            link, same = file.body(f"link_{i + 1}").id, own.body(f"link_{i + 1}").id
            assert getattr(file, field)[link].tolist() == getattr(own, field)[same].tolist(), field
    assert file.body("tip").pos.tolist() == own.body("tip").pos.tolist() == [ARM.length[2], 0.0, 0.0]
    for field in ("dof_damping", "dof_armature", "actuator_gainprm", "actuator_ctrlrange"):
        assert getattr(file, field).tolist() == getattr(own, field).tolist(), field
    assert file.joint("gripper").range.tolist() == [GRIPPER.closed, GRIPPER.opened]
    assert file.actuator("motor_1").ctrlrange.tolist() == [-VOLTAGE_LIMIT, VOLTAGE_LIMIT]
    assert file.opt.timestep == PHYSICS_STEP
    assert file.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
    assert file.opt.gravity.tolist() == [0.0, 0.0, -GRAVITY]
    for name, place in (("pickup", PICKUP), *PLACES.items()):
        body = file.body(file.site(name).bodyid[0])
        assert (body.pos + file.site(name).pos).tolist() == [place.x, 0.0, place.y], name


def test_file_has_named_elements_whose_shapes_weigh_nothing() -> None:
    file = mujoco.MjModel.from_xml_path(str(MODEL_FILE))
    for kind, count in (("geom", file.ngeom), ("body", file.nbody), ("camera", file.ncam), ("light", file.nlight)):
        assert all(getattr(file, kind)(i).name for i in range(count)), kind
    assert {file.key(i).name for i in range(file.nkey)} == {"home", "hanging", "pickup"}
    assert file.body_mass.sum() == pytest.approx(sum(ARM.mass), abs=2e-14)
    assert file.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT


def test_tip_at_the_places() -> None:
    plant = Plant()
    for place in (PICKUP, *PLACES.values()):
        plant.reset(place.theta)
        assert plant.tip() == pytest.approx((place.x, place.y), abs=1e-4)


def test_gripper_moves_between_its_stops_and_rests_there() -> None:
    plant = Plant()
    plant.reset(HANGING)
    plant.apply((0.0, 0.0, 0.0, -GRIPPER.volts))
    angles = []
    for _ in range(100):
        plant.advance(PERIOD)
        angles.append(plant.gripper)
    # I q'' = K V - D q' from rest: q = opened - K V / D (t - I/D (1 - exp(-D t / I)))
    t, lag = 30 * PERIOD, GRIPPER.inertia / GRIPPER.damping
    speed = GRIPPER.voltage_constant * GRIPPER.volts / GRIPPER.damping
    assert angles[29] == pytest.approx(GRIPPER.opened - speed * (t - lag * (1 - math.exp(-t / lag))), abs=1e-9)
    assert angles[60:] == [GRIPPER.closed] * 40
    plant.apply((0.0, 0.0, 0.0, GRIPPER.volts))
    for _ in range(100):
        plant.advance(PERIOD)
    assert plant.gripper == GRIPPER.opened


def test_gripper_does_not_disturb_the_arm() -> None:
    still, moving = Plant(), Plant()
    moving.apply((0.0, 0.0, 0.0, -8.0))
    for _ in range(200):
        still.advance(PERIOD)
        moving.advance(PERIOD)
    assert moving.gripper == GRIPPER.closed
    assert moving.theta == pytest.approx(still.theta, abs=1e-13)


def test_locked_joint_stays_while_the_others_move() -> None:
    plant = Plant()
    plant.reset((0.5, 0.4, 0.3), (1.0, 1.0, 1.0))
    plant.set_locked({2})
    for _ in range(300):
        plant.advance(PERIOD)
    assert plant.theta[1] == pytest.approx(0.4, abs=1e-6)
    assert abs(plant.theta[0] - 0.5) > 1.0
    plant.set_locked(())
    plant.apply((0.0, 8.0, 0.0, 0.0))
    plant.advance(0.1)
    assert plant.theta[1] > 0.5


def test_coulomb_friction_takes_its_work_from_the_motion() -> None:
    mu = 0.02
    arm = scaled(ARM, "D", 0.0).with_values({"mu1": mu, "mu2": mu, "mu3": mu})
    plant = Plant(arm, step=PHYSICS_STEP / 4)
    plant.reset(HOME)
    before = energy(plant, arm, 0.0)
    work = 0.0
    for _ in range(800):
        plant.advance(plant.step)
        work += plant.step * sum(mu * math.tanh(w / COULOMB_WIDTH) * w for w in plant.omega)
    assert work > 0.05
    # The sum is of first order in the step: measured 0.2 % of the work.
    assert before - energy(plant, arm, 0.0) == pytest.approx(work, rel=1e-2)


def test_voltage_is_clipped_at_its_limit() -> None:
    plant = Plant()
    at_limit = plant.acceleration(HANGING, HOME, (VOLTAGE_LIMIT, 0.0, 0.0, 0.0))
    assert plant.acceleration(HANGING, HOME, (100.0, 0.0, 0.0, 0.0)) == at_limit
    assert plant.acceleration(HANGING, HOME, (VOLTAGE_LIMIT - 0.1, 0.0, 0.0, 0.0)) != at_limit


def test_divergence_is_an_error_with_time_and_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plant = Plant(scaled(ARM, "D", 200.0))
    plant.reset(HOME, (0.0, 1.0, 0.0))
    with pytest.raises(DivergenceError, match=r"emulation diverged at t = \d\.\d+ s, last state \(") as caught:
        plant.advance(1.0)
    assert caught.value.time == plant.time
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e12])
def test_unusable_voltage_is_refused(bad: float) -> None:
    plant = Plant()
    with pytest.raises(DivergenceError, match="voltage command"):
        plant.apply((0.0, bad, 0.0, 0.0))
    plant.advance(PERIOD)
    assert all(map(math.isfinite, plant.theta))


@pytest.mark.parametrize("period", [0.0, -0.01, 0.004, math.nan, math.inf, 0.0024])
def test_period_must_be_whole_steps(period: float) -> None:
    with pytest.raises(ParameterError, match=r"whole multiple.*0\.0025"):
        Plant().advance(period)


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan])
def test_step_must_be_positive(step: float) -> None:
    with pytest.raises(ParameterError, match="integration step"):
        Plant(step=step)


@pytest.mark.parametrize("mass", [-0.1, math.nan, math.inf])
def test_payload_must_be_a_mass(mass: float) -> None:
    with pytest.raises(ParameterError, match="payload"):
        Plant().set_payload(mass)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<joint name="joint_1" class="arm"/>', '<joint name="joint_1" class="arm" spin="3"/>', r":\d+: .*spin"),
        ("</mujoco>", "", r"arm\.xml:\d+: "),
        ('"motor_2"', '"motor_two"', r"no actuator is named 'motor_2', expected actuators motor_1, "),
        ('<site name="red"', '<site name="rot"', r"no site is named 'red'"),
        ('<body name="rack"', '<body name="rack"><joint/', r"arm\.xml"),
    ],
)
def test_unusable_file_is_named_in_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "arm.xml"
    text = MODEL_FILE.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(ModelError, match=message) as caught:
        Plant(model_file=file)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_joints_besides_the_four_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(
        MODEL_FILE.read_text().replace('<joint name="joint_2"', '<joint name="more"/><joint name="joint_2"')
    )
    with pytest.raises(ModelError, match="joints are joint_1, more, joint_2, joint_3, gripper, expected exactly"):
        Plant(model_file=file)


def test_plants_of_one_file_are_apart_and_a_changed_file_is_read_anew(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(MODEL_FILE.read_text())
    first, heavier = Plant(model_file=file), Plant(ArmParameters(mass=(0.2, 0.2, 0.2)), model_file=file)
    assert first.model.body("link_1").mass == ArmParameters().mass[0]
    assert heavier.model.body("link_1").mass == 0.2
    old = '<option timestep="0.0025" integrator="RK4"'
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, '<option timestep="0.0025" integrator="Euler"'))
    assert Plant(model_file=file).model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert first.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


def test_a_file_that_includes_another_is_read_anew_when_that_has_changed(tmp_path: Path) -> None:
    before, option, rest = MODEL_FILE.read_text().partition("<option ")
    option, end, after = (option + rest).partition("</option>")
    included, whole = tmp_path / "option.xml", tmp_path / "arm.xml"
    whole.write_text(f"{before}<include file = 'option.xml'/>{after}")
    for integrator in ("RK4", "Euler"):
        included.write_text(f"<mujoco>{(option + end).replace('RK4', integrator)}</mujoco>")
        found = Plant(model_file=whole).model.opt.integrator
        assert found == getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")


def test_a_step_does_not_read_the_clock() -> None:
    """MuJoCo's own timers take longer than some of what they time."""
    plant = Plant()
    plant.data.timer.number[:] = 0
    mujoco.mj_step(plant.model, plant.data)
    assert plant.data.timer.number[mujoco.mjtTimer.mjTIMER_STEP] == 1
    assert not plant.data.timer.duration.any()


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"nowhere\.xml"):
        Plant(model_file=tmp_path / "nowhere.xml")
