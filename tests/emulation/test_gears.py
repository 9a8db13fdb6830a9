"""Gears that yield: torque = k dz(x) + d x', energy, play, the side of the encoder, and where it is said."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Array, Friction, Joint, Side, Transmission
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.faults import ChainFault
from dtwin.emulation.chain.machine import Machine, drawn, machine_of, rigid
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import inverse_dynamics
from dtwin.errors import ModelError

PLANAR = arm_of("planar-2r")
ROTOR = 0.01
K, D, PLAY = 400.0, 0.4, 0.02
START = np.array([0.3, -0.8])


def arm_with(gear: Transmission | None, friction: Friction | None = None) -> Arm:
    """The planar arm without gravity or friction, with such gears."""

    def made(joint: Joint) -> Joint:
        actuator = replace(joint.actuator, rotor=ROTOR, constant=1.0, limit=100.0)
        return replace(joint, actuator=actuator, friction=friction or Friction(), transmission=gear)

    return replace(PLANAR, gravity=np.zeros(3), joints=tuple(made(joint) for joint in PLANAR.joints))


def plant_of(arm: Arm, *faults: ChainFault) -> ChainPlant:
    return ChainPlant(Machine("made", arm, friction=False, encoders=False), START, faults=faults)


def moved(plant: ChainPlant, ticks: int, torque: tuple[float, float]) -> Array:
    """The twist of the first gear, a row for each tick."""
    rows = []
    for _ in range(ticks):
        plant.apply(torque)
        plant.advance()
        rows.append(plant.twist[0][0])
    return np.array(rows)


def energy(plant: ChainPlant, arm: Arm, stiffness: float, play: float) -> float:
    (q, qd), (x, xd) = plant.state, plant.twist
    tiled = np.tile(q, (2, 1))
    mass = inverse_dynamics(rotorless(arm), tiled, np.zeros((2, 2)), np.eye(2))
    spring = np.maximum(np.abs(x) - 0.5 * play, 0.0)
    return float(0.5 * qd @ mass @ qd + 0.5 * ROTOR * (qd + xd) @ (qd + xd) + 0.5 * stiffness * spring @ spring)


def rotorless(arm: Arm) -> Arm:
    return replace(arm, joints=tuple(replace(j, actuator=replace(j.actuator, rotor=0.0)) for j in arm.joints))


@pytest.mark.parametrize("play", [0.0, PLAY])
def test_without_damping_energy_stays(play: float) -> None:
    """In links, rotors and springs, and what stands in one goes to the others."""
    arm = arm_with(Transmission(K, 0.0, play))
    plant = plant_of(arm)
    moved(plant, 20, (1.0, -0.5))
    before, twists = energy(plant, arm, K, play), []
    for _ in range(50):
        twists.append(moved(plant, 1, (0.0, 0.0))[0])
        assert energy(plant, arm, K, play) == pytest.approx(before, rel=0.01)
    assert np.ptp(twists) > 2.0 * play or np.ptp(twists) > 1e-3


LOCKED = ChainFault("lock", 0, 0.0, 0.0), ChainFault("lock", 1, 0.0, 0.0)


@pytest.mark.parametrize("torque", [3.0, -2.0])
def test_at_rest_a_gear_is_twisted_by_its_torque_over_its_stiffness_and_half_its_play(torque: float) -> None:
    plant = plant_of(arm_with(Transmission(K, D, PLAY)), *LOCKED)
    twist = moved(plant, 200, (torque, 0.0))[-1]
    assert twist == pytest.approx(torque / K + np.sign(torque) * PLAY / 2, rel=1e-3)
    assert plant.state[0] == pytest.approx(START, abs=3e-4)


def test_from_one_side_to_the_other_the_motor_goes_through_its_play() -> None:
    plant, small = plant_of(arm_with(Transmission(K, D, PLAY)), *LOCKED), 0.05
    ends = [moved(plant, 400, (torque, 0.0))[-1] for torque in (small, -small)]
    assert ends[0] - ends[1] == pytest.approx(PLAY + 2.0 * small / K, rel=1e-3)


def test_a_motor_that_is_let_go_swings_on_its_gear_as_a_damped_spring_does() -> None:
    plant = plant_of(arm_with(Transmission(K, D)), *LOCKED)
    start = moved(plant, 300, (2.0, 0.0))[-1]
    found = moved(plant, 30, (0.0, 0.0))
    natural = np.sqrt(K / ROTOR)
    ratio = 0.5 * D / np.sqrt(K * ROTOR)
    damped, t = natural * np.sqrt(1.0 - ratio**2), PLANAR.period * np.arange(1, 31)
    swing = np.cos(damped * t) + ratio * natural / damped * np.sin(damped * t)
    assert found == pytest.approx(start * np.exp(-ratio * natural * t) * swing, abs=0.01 * start)


def test_a_stiff_gear_moves_its_joint_as_one_that_does_not_yield() -> None:
    ends = []
    for gear in (None, Transmission(2e4, 20.0)):
        plant = plant_of(arm_with(gear))
        moved(plant, 100, (0.4, -0.2))
        ends.append(plant.state[0])
    assert np.abs(ends[0] - START).max() > 0.5
    assert ends[1] == pytest.approx(ends[0], abs=1e-3)


@pytest.mark.parametrize("side", ["motor", "joint"])
def test_an_encoder_reads_its_side_of_the_gear(side: Side) -> None:
    plant = plant_of(arm_with(replace(Transmission(K, D, PLAY), encoder=side)), *LOCKED)
    moved(plant, 100, (3.0, -3.0))
    (q, _), (x, _) = plant.state, plant.twist
    assert np.abs(x).min() > 1e-3
    assert plant.read() == pytest.approx(q + x * (side == "motor"), abs=1e-12)


def test_friction_acts_on_the_motor_and_grows_with_what_the_gear_carries() -> None:
    """A motor that twists its gear against a standing joint, and is then held where it is by its friction."""
    arm = arm_with(Transmission(K, D), Friction(0.0, 0.3, 0.1))
    plant = ChainPlant(Machine("made", arm, encoders=False), START, faults=LOCKED)
    for torque in np.linspace(0.0, 3.0, 300).tolist():
        carried = moved(plant, 1, (torque, 0.0))[-1] * K
    assert carried == pytest.approx((3.0 - 0.3) / 1.1, rel=0.03)
    assert moved(plant, 100, (carried - 0.2, 0.0))[-1] * K == pytest.approx(carried, rel=0.01)
    assert moved(plant, 100, (carried - 1.0, 0.0))[-1] * K < 0.9 * carried


def test_a_number_draws_the_gears_beside_the_arm_that_it_draws_anyway() -> None:
    gear = Transmission(K, D, PLAY)
    one, other = drawn(arm_with(gear), 41), drawn(arm_with(None), 41)
    assert (one.parameters == other.parameters).all()
    assert rigid(one).joints[1].friction == other.joints[1].friction
    factors = np.array([[g.stiffness / K, g.damping / D, g.backlash / PLAY] for g in _gears(one)])
    assert len(np.unique(factors)) == 6
    assert (np.abs(np.log(factors)) < 4.0 * PLANAR.tolerances.gear).all()
    assert _gears(drawn(arm_with(gear), 41)) == _gears(one)
    assert machine_of("ideal", arm_with(gear)).arm.joints[0].transmission is None
    assert machine_of("nominal", arm_with(gear)).arm.joints[0].transmission == gear


def _gears(arm: Arm) -> list[Transmission]:
    return [joint.transmission for joint in arm.joints if joint.transmission is not None]


FILE = """
base = "41"
[joints.elbow]
rotor = 0.02
gear_stiffness = 300.0
gear_damping = 0.5
backlash = 1e-3
encoder_at = "joint"
"""


def test_a_file_changes_numbers_of_another_machine(tmp_path: Path) -> None:
    (tmp_path / "worn.toml").write_text(FILE)
    found, base = machine_of(str(tmp_path / "worn.toml"), PLANAR), machine_of("41", PLANAR)
    assert (found.name, found.friction, found.encoders) == ("worn", True, True)
    assert found.arm.joints[1].transmission == Transmission(300.0, 0.5, 1e-3, "joint")
    assert found.arm.joints[1].actuator == replace(base.arm.joints[1].actuator, rotor=0.02)
    assert found.arm.joints[0].friction == base.arm.joints[0].friction
    assert found.arm.joints[0].transmission is None
    assert (found.arm.parameters == base.arm.parameters).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("speed = 1", "speed: unknown key: expected base or joints"),
        ("base = 7", "base: expected ideal, nominal or a number as text, got 7"),
        ('base = "x"', "machine 'x': expected ideal, nominal, a number"),
        ("[joints.wrist]", "joints.wrist: expected a joint of the model, shoulder or elbow"),
        ("[joints.elbow]\nbacklash = 1e-3", "joints.elbow.backlash: expected gear_stiffness"),
        ("[joints.elbow]\ngear_stiffness = 5", "joints.elbow.gear_stiffness: expected rotor, above 0"),
        ('[joints.elbow]\nencoder_at = "tip"', "joints.elbow.encoder_at: expected motor or joint, got 'tip'"),
        ("[joints.elbow]\ngear_stiffness = 0", "joints.elbow.gear_stiffness: expected a number above 0"),
    ],
)
def test_what_a_file_says_wrongly_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(ModelError) as error:
        machine_of(str(path), PLANAR)
    assert str(error.value).startswith(f"{path}: {said}")


def test_a_gear_that_no_step_can_follow_is_refused_by_name() -> None:
    with pytest.raises(ModelError, match=r"joints\.elbow\.gear_stiffness: expected a gear that moves with at most"):
        plant_of(arm_with(Transmission(1e9)))


def test_an_arm_without_torque_falls_against_its_stops() -> None:
    """A little beyond the range of a joint, where paths never come, so that they change nothing within it."""
    free = tuple(replace(joint, friction=Friction()) for joint in PLANAR.joints)
    plant = ChainPlant(Machine("made", replace(PLANAR, joints=free), False, False, stops=True), START)
    highest = np.full(2, -np.inf)
    for _ in range(1000):
        plant.apply((2.0, 2.0))
        plant.advance()
        highest = np.maximum(highest, plant.state[0])
    upper = np.array([joint.upper for joint in PLANAR.joints])
    assert np.isfinite(upper).all()
    assert ((highest > upper) & (highest < upper + 0.3)).all(), highest - upper
    assert plant.state[0] == pytest.approx(upper + 0.05, abs=0.02), "it stands there"
