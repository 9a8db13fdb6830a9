"""Every effect of a transmission against a closed form."""

import math

import mujoco
import pytest

from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Drive, Machine, Transmission
from dtwin.emulation.plant import Plant
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters
from tests.emulation.machine.bench import ARM, INERTIA, STEP, K, joint, machine, with_damping

FRICTION = Transmission(coulomb=(0.03,) * 3)
STRIBECK = Transmission(coulomb=(0.03,) * 3, static=(0.045,) * 3, stribeck_velocity=(0.2,) * 3)


def push(plant: MachinePlant, torque: float, seconds: float) -> None:
    """Turns joint 3 with a torque (N m) of its motor."""
    plant.apply((0.0, 0.0, torque / K, 0.0))
    plant.advance(seconds)


def crept(load: float, inertia: float, seconds: float) -> float:
    """The angle (rad) by which a load may creep: 1e-4 of the velocity that it would give the inertia in a step."""
    return 1.01e-4 * load / inertia * STEP * seconds


@pytest.mark.parametrize("speed", [0.5, 2.0, -8.0])
def test_coulomb_friction_stops_a_joint_where_it_should(speed: float) -> None:
    """I w' = -mu sign(w): it stops after I w / mu, at I w^2 / (2 mu)."""
    plant = joint(machine(transmission=FRICTION), omega=speed)
    time = INERTIA * abs(speed) / 0.03
    steps = math.ceil(time / STEP)
    plant.advance(steps * STEP / 2 if steps % 2 == 0 else (steps - 1) * STEP / 2)
    half = plant.time
    assert plant.omega[2] == pytest.approx(math.copysign(abs(speed) - 0.03 / INERTIA * half, speed), rel=1e-9)
    plant.advance(20 * STEP + math.ceil(time / 2 / STEP) * STEP)
    assert abs(plant.omega[2]) < 1e-9
    # the last step, in which it stops, may be wrong by what it brakes in a step
    assert abs(plant.theta[2] - math.copysign(INERTIA * speed**2 / 0.06, speed)) < 0.03 / INERTIA * STEP**2


@pytest.mark.parametrize(("gear", "holds"), [(FRICTION, 0.03), (STRIBECK, 0.045)])
def test_friction_holds_a_load_up_to_its_bound(gear: Transmission, holds: float) -> None:
    plant = joint(machine(transmission=gear))
    push(plant, 0.95 * holds, 10.0)
    assert abs(plant.theta[2]) < crept(0.95 * holds, INERTIA, 10.0)
    push(plant, 1.05 * holds, 1.0)
    assert plant.theta[2] > 0.05


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.5])
def test_friction_follows_the_stribeck_curve(speed: float) -> None:
    """Under a constant torque the speed settles where the torque is F(w) + D w."""
    damping = 0.5  # steeper than the curve falls, so that every speed is stable
    torque = 0.03 + 0.015 * math.exp(-((speed / 0.2) ** 2)) + damping * speed
    plant = joint(machine(transmission=STRIBECK), with_damping(damping), omega=speed)
    push(plant, torque, 2.0)
    assert plant.omega[2] == pytest.approx(speed, rel=2e-3)


def test_a_fault_of_friction_comes_on_top() -> None:
    tested = machine(transmission=FRICTION)
    plant = joint(tested)
    plant.set_parameters(tested.arm(ARM).with_values({"mu3": 0.06}))
    push(plant, 0.055, 1.0)
    assert abs(plant.theta[2]) < 1e-4


def test_before_it_slides_a_contact_is_a_spring() -> None:
    gear = Transmission(coulomb=(0.03,) * 3, presliding=(30.0,) * 3)
    plant = joint(machine(transmission=gear), with_damping(0.02))
    push(plant, 0.012, 1.0)
    slipped = crept(0.012, 30.0 * STEP**2, 1.0)
    assert 0 <= plant.theta[2] - 0.012 / 30.0 < slipped + 1e-9
    push(plant, 0.0, 1.0)
    assert abs(plant.theta[2]) < slipped + 1e-9  # it comes back: nothing has slid
    push(plant, 0.035, 1.0)
    assert plant.theta[2] > 0.05


def test_a_rotor_is_inertia_of_the_first_link() -> None:
    tested = machine(transmission=Transmission(rotor_inertia=(0.002, 0.0, 0.0)))
    plant = MachinePlant(tested, ArmParameters())
    heavier = Plant(ArmParameters().with_values({"I1": ArmParameters().inertia[0] + 0.002}))
    for arm in (plant, heavier):
        arm.reset((0.3, -0.4, 0.5))
        arm.apply((1.0, 0.5, -0.5, 0.0))
        arm.advance(1.0)
    assert plant.theta == pytest.approx(heavier.theta, abs=1e-10)


def test_an_elastic_gear_swings_as_two_inertias_do() -> None:
    """Rotor J at w0 against a link I at rest: both go on with J w0 / (J + I) and swing against one another."""
    rotor, stiffness, speed = 0.002, 20.0, 1.0
    gear = Transmission(rotor_inertia=(0.0, 0.0, rotor), stiffness=(0.0, 0.0, stiffness), gear_damping=(0.0,) * 3)
    plant = joint(machine(transmission=gear))
    number = plant.model.joint("rotor_3").dofadr[0]
    plant.data.qvel[number] = speed
    frequency = math.sqrt(stiffness * (1 / rotor + 1 / INERTIA))
    for _ in range(40):
        plant.advance(STEP)
        swing = math.sin(frequency * plant.time) / frequency
        drift = rotor * speed / (rotor + INERTIA)
        # RK4's phase error in a time t is t w (w h)^4 / 120, of a swing of I / (J + I) w0 / w
        allowed = plant.time * speed * (frequency * STEP) ** 4 / 60 + 1e-7
        assert plant.theta[2] == pytest.approx(drift * (plant.time - swing), abs=allowed)
        motor = drift * plant.time + INERTIA * speed / (rotor + INERTIA) * swing
        assert plant.data.qpos[number] == pytest.approx(motor, abs=allowed)


def test_backlash_is_play_and_then_a_spring() -> None:
    """Friction holds the motor; a torque turns the link by half the play and by torque / stiffness."""
    gear = Transmission(
        coulomb=(0.0, 0.0, 0.4),
        rotor_inertia=(0.0, 0.0, 0.001),
        stiffness=(0.0, 0.0, 50.0),
        gear_damping=(0.0, 0.0, 0.05),
        backlash=(0.0, 0.0, 0.02),
    )
    plant = joint(machine(transmission=gear), with_damping(0.2))
    for torque in (0.1, -0.12):
        plant.data.qfrc_applied[2] = torque
        plant.advance(3.0)
        slipped = sum(crept(abs(load), 0.001, 3.0) for load in (0.1, -0.12))
        assert plant.theta[2] == pytest.approx(math.copysign(0.01, torque) + torque / 50.0, abs=slipped)
    plant.data.qfrc_applied[2] = 0.0
    plant.advance(3.0)
    assert abs(plant.theta[2]) <= 0.01 + 1e-6


def test_torque_ripple_is_a_sine_of_the_angle() -> None:
    gear = Transmission(ripple=(0.0, 0.0, 0.02), ripple_periods=(6.0, 6.0, 12.0), ripple_phase=(0.0, 0.0, 0.7))
    plant = joint(machine(Drive(back_emf=(0.0, 0.0, 0.1)), gear))
    for angle in (0.0, 0.1, 1.0, -2.5):
        plant.reset((0.0, 0.0, angle))
        plant.apply((0.0, 0.0, 1.0, 0.0))
        mujoco.mj_forward(plant.model, plant.data)
        assert plant.data.qfrc_actuator[2] == pytest.approx(K + 0.02 * math.sin(12 * angle + 0.7), abs=1e-9)


def test_cables_pull_as_a_spring() -> None:
    """I q'' = -k (q - q0) swings with sqrt(k / I) about q0."""
    gear = Transmission(cable=(0.0, 0.0, 0.5), cable_rest=(0.0, 0.0, 0.4))
    plant = joint(machine(transmission=gear))
    for _ in range(80):
        plant.advance(STEP)
        assert plant.theta[2] == pytest.approx(0.4 - 0.4 * math.cos(math.sqrt(0.5 / INERTIA) * plant.time), abs=1e-7)


def test_a_spring_that_the_step_cannot_follow_is_refused() -> None:
    gear = Transmission(rotor_inertia=(1e-5,) * 3, stiffness=(100.0,) * 3)
    with pytest.raises(ParameterError, match=r"joint 1 oscillates with \d+ rad/s on its spring, which needs a step"):
        MachinePlant(Machine("stiff", transmission=gear), ArmParameters())


def test_a_locked_joint_stays_locked_and_gets_its_rotor_back() -> None:
    tested = machine(transmission=Transmission(rotor_inertia=(0.001,) * 3, coulomb=(0.01,) * 3))
    plant = joint(tested)
    plant.apply((8.0, 8.0, 8.0, 0.0))
    plant.advance(0.5)
    assert abs(plant.theta[0]) < 1e-6
    plant.set_locked(())
    assert plant.model.dof_armature[:3].tolist() == [0.001] * 3
