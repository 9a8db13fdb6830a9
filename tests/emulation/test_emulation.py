"""The cell behind its seam: timing, determinism, grip, faults."""

import math

import pytest

from dtwin.emulation.emulation import Emulation
from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.plant import Plant
from dtwin.errors import DivergenceError, FaultError, ParameterError
from dtwin.parameters import (
    GRAVITY,
    HANGING,
    HOME,
    PERIOD,
    PICKUP,
    PLACES,
    ArmParameters,
    GripperParameters,
    JointVector,
)
from dtwin.signals import DriveVector, Event, Sensors, Truth, Voltages

GRIPPER = GripperParameters()
STILL: DriveVector = (0.0, 0.0, 0.0, 0.0)
CLOSE: DriveVector = (0.0, 0.0, 0.0, -GRIPPER.volts)
LOCKED = tuple(parse_fault(f"lock{joint}@0") for joint in (1, 2, 3))


def command(sensors: Sensors, volts: DriveVector = STILL, gripped: bool = False) -> Voltages:
    return Voltages(sensors.sequence, sensors.time, volts, gripped)


def run(
    cell: Emulation, ticks: int, volts: DriveVector = STILL, gripped: bool = False
) -> list[tuple[Sensors, Truth]]:
    samples = []
    for _ in range(ticks):
        sensors = cell.read()
        samples.append((sensors, cell.truth()))
        cell.apply(command(sensors, volts, gripped))
        cell.advance(PERIOD)
    return samples


def ticks(seconds: float) -> int:
    return round(seconds / PERIOD)


def kinds(events: list[Event]) -> list[str]:
    return [event.kind for event in events]


def with_waiting_box(theta: JointVector = PICKUP.theta, seed: int = 0, faults: tuple[str, ...] = ()) -> Emulation:
    """A cell whose arm is held in a pose, gripper closed, when the first box has come."""
    cell = Emulation(theta=theta, seed=seed, faults=(*LOCKED, *map(parse_fault, faults)))
    for _ in range(ticks(16)):
        run(cell, 1, CLOSE)
        if cell.read().box_present:
            break
    cell.drain_events()
    return cell


def test_first_sample_is_the_start() -> None:
    cell = Emulation(theta=(0.1, 0.2, 0.3))
    assert cell.read() == Sensors(0, 0.0, (0.1, 0.2, 0.3), GRIPPER.opened, False, "")
    assert cell.truth() == Truth(0.0, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0), GRIPPER.opened, 0.0)


def test_reading_twice_changes_nothing() -> None:
    cell = Emulation(noise=0.01)
    assert cell.read() is cell.read()


def test_time_does_not_drift() -> None:
    samples = run(Emulation(), ticks(60) + 1)
    assert [sensors.time for sensors, _ in samples] == [k / 100 for k in range(len(samples))]
    assert [sensors.sequence for sensors, _ in samples] == list(range(len(samples)))
    assert all(sensors.time == truth.time for sensors, truth in samples)


def test_the_plant_behind_the_seam_is_the_plant() -> None:
    volts = (1.0, -0.5, 0.3, 0.0)
    cell, plant = Emulation(theta=HOME), Plant()
    plant.reset(HOME)
    plant.apply(volts)
    for _, truth in run(cell, 200, volts):
        assert (truth.theta, truth.omega) == (plant.theta, plant.omega)
        plant.advance(PERIOD)


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_equal_seeds_give_equal_bits_and_noise_leaves_the_boxes_alone(kind: NoiseKind) -> None:
    first, second = (run(Emulation(seed=7, noise=0.01, noise_kind=kind), ticks(40)) for _ in range(2))
    assert first == second
    other = run(Emulation(seed=8, noise=0.01, noise_kind=kind), ticks(40))
    clean = run(Emulation(seed=7), ticks(40))
    assert [s.theta for s, _ in other] != [s.theta for s, _ in first]
    assert [(s.box_present, s.box_colour) for s, _ in clean] == [(s.box_present, s.box_colour) for s, _ in first]
    assert [truth for _, truth in clean] == [truth for _, truth in first]
    assert clean != first


def test_a_box_is_seen_from_the_tick_of_its_arrival() -> None:
    cell = Emulation(seed=1)
    samples = run(cell, ticks(16))
    arrived = cell.drain_events()[0]
    assert arrived.kind == "arrived"
    first = next(sensors for sensors, _ in samples if sensors.box_present)
    assert first.time == arrived.time
    assert first.box_colour in PLACES
    assert first.box_colour in arrived.text


def test_gripping_loads_the_arm_and_letting_go_unloads_it() -> None:
    cell = with_waiting_box()
    colour = cell.read().box_colour
    run(cell, 1, CLOSE, gripped=True)
    assert kinds(cell.drain_events()) == ["picked"]
    assert 0.190 <= cell.truth().payload_mass < 0.210
    assert (cell.read().box_present, cell.read().box_colour) == (False, "")
    run(cell, 10, CLOSE, gripped=True)
    assert cell.box_counts.picked == 1
    run(cell, 1, CLOSE, gripped=False)
    assert cell.truth().payload_mass == 0.0
    assert cell.box_counts.misplaced == 1
    assert colour in next(event.text for event in cell.drain_events() if event.kind == "misplaced")


def test_gripping_elsewhere_misses() -> None:
    cell = with_waiting_box(theta=HANGING)
    run(cell, 1, CLOSE, gripped=True)
    assert kinds(cell.drain_events()) == ["grip_missed"]
    assert cell.truth().payload_mass == 0.0
    assert cell.read().box_present


def test_payload_fault_changes_what_is_held() -> None:
    start = with_waiting_box().read().time
    cell = with_waiting_box(faults=(f"payload+=0.05@{start + 1}-{start + 2}",))
    run(cell, 1, CLOSE, gripped=True)
    mass = cell.truth().payload_mass
    masses = [truth.payload_mass for _, truth in run(cell, ticks(3), CLOSE, gripped=True)]
    assert sorted(set(masses)) == [mass, mass + 0.05]
    assert masses.count(mass + 0.05) == 100


def test_payload_fault_does_not_load_an_empty_gripper() -> None:
    cell = Emulation(faults=[parse_fault("payload=0.3@0.1")])
    run(cell, 20)
    assert cell.truth().payload_mass == 0.0


def test_slip_loses_the_box() -> None:
    start = with_waiting_box().read().time
    cell = with_waiting_box(faults=(f"slip@{start + 1}",))
    run(cell, ticks(2), CLOSE, gripped=True)
    assert cell.truth().payload_mass == 0.0
    assert [kind for kind in kinds(cell.drain_events()) if "arriv" not in kind] == ["picked", "fault", "slipped"]
    run(cell, 1, CLOSE, gripped=False)
    assert (cell.box_counts.picked, cell.box_counts.misplaced) == (1, 1)


def test_fault_acts_from_its_time_to_its_end() -> None:
    healthy, faulty = Emulation(theta=HOME), Emulation(theta=HOME, faults=[parse_fault("K1*=0.5@0.3-0.6")])
    volts = (4.0, 0.0, 0.0, 0.0)
    pairs = list(zip(run(healthy, 31, volts), run(faulty, 31, volts), strict=True))
    assert all(a == b for a, b in pairs[:31])
    assert run(healthy, 1, volts) != run(faulty, 1, volts)
    run(faulty, 60, volts)
    events = faulty.drain_events()
    assert [(event.time, event.kind) for event in events] == [(0.3, "fault"), (0.6, "fault")]
    assert faulty.drain_events() == []


def test_parameter_fault_is_the_plant_with_that_parameter() -> None:
    cell = Emulation(theta=HOME, faults=[parse_fault("m3*=1.5@0"), parse_fault("D2+=0.02@0")])
    plant = Plant(ArmParameters().with_values({"m3": 1.5 * ArmParameters().mass[2], "D2": 0.07}))
    plant.reset(HOME)
    for _, truth in run(cell, 100):
        assert truth.theta == plant.theta
        plant.advance(PERIOD)


def test_encoder_faults_reach_the_sensors_and_not_the_truth() -> None:
    texts = ("bias1+=0.02@0.5", "drift3+=0.1@0.5-1", "freeze2@0.7-0.9")
    cell = Emulation(theta=HOME, faults=map(parse_fault, texts))
    samples = run(cell, 120)
    healthy = run(Emulation(theta=HOME), 120)
    assert [truth for _, truth in samples] == [truth for _, truth in healthy]
    for k, (sensors, truth) in enumerate(samples):
        bias = 0.02 if k >= 50 else 0.0
        drift = 0.1 * (k - 50) / 100 if 50 <= k < 100 else 0.0
        assert sensors.theta[0] == pytest.approx(truth.theta[0] + bias, abs=1e-14)
        assert sensors.theta[1] == (samples[69][0].theta[1] if 70 <= k < 90 else truth.theta[1])
        assert sensors.theta[2] == pytest.approx(truth.theta[2] + drift, abs=1e-14)


def test_cut_motor_gets_no_voltage() -> None:
    cell, plant = Emulation(theta=HOME, faults=[parse_fault("cut2@0")]), Plant()
    plant.reset(HOME)
    plant.apply((2.0, 0.0, 1.0, 0.0))
    for _, truth in run(cell, 50, (2.0, 3.0, 1.0, 0.0)):
        assert truth.theta == plant.theta
        plant.advance(PERIOD)


def test_late_commands_act_one_period_later() -> None:
    late, cell = Emulation(faults=[parse_fault("late@0.1-0.2")]), Emulation()
    volts = [(0.1 * k, -0.05 * k, 0.02 * k, 0.0) for k in range(30)]
    shifted = [volts[k - 1] if 10 <= k < 20 else volts[k] for k in range(30)]
    for sent, acting in zip(volts, shifted, strict=True):
        late.apply(command(late.read(), sent))
        cell.apply(command(cell.read(), acting))
        late.advance(PERIOD)
        cell.advance(PERIOD)
        assert late.truth() == cell.truth()


def test_a_push_is_a_torque_on_its_joint() -> None:
    """A torque that balances the weight of a stretched arm holds its first joint, and the arm falls without it."""
    arm = ArmParameters()
    reach = (arm.get("c1"), arm.get("l1") + arm.get("c2"), arm.get("l1") + arm.get("l2") + arm.get("c3"))
    weight = GRAVITY * sum(mass * x for mass, x in zip(arm.mass, reach, strict=True))
    locks = [parse_fault(f"lock{joint}@0") for joint in (2, 3)]
    cell = Emulation(theta=(0.0, 0.0, 0.0), faults=[*locks, parse_fault(f"push1+={weight}@0-0.5")])
    held = run(cell, 50)[-1][1]
    assert held.theta == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert run(cell, 10)[-1][1].theta[0] < -0.01


def test_locked_joint_is_released_at_the_end() -> None:
    cell = Emulation(theta=HOME, faults=[parse_fault("lock1@0-1")])
    samples = run(cell, 150)
    assert max(abs(truth.theta[0]) for _, truth in samples[:100]) < 1e-6
    assert abs(samples[-1][1].theta[0]) > 0.1


def test_unusable_command_ends_the_run() -> None:
    cell = Emulation()
    run(cell, 10)
    with pytest.raises(DivergenceError, match=r"voltage command diverged at t = 0\.1000 s"):
        cell.apply(command(cell.read(), (math.nan, 0.0, 0.0, 0.0)))


def test_bad_arguments() -> None:
    with pytest.raises(ParameterError, match="seed"):
        Emulation(seed=-1)
    with pytest.raises(ParameterError, match="start angles"):
        Emulation(theta=(math.nan, 0.0, 0.0))
    with pytest.raises(FaultError, match=r"fault m1=-1@2: m1 \(mass\)"):
        Emulation(faults=[parse_fault("m1=-1@2")])
    with pytest.raises(ParameterError, match="whole multiple"):
        Emulation().advance(0.001)
