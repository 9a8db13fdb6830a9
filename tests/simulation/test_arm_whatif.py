"""What if a running arm were controlled otherwise: the chain twin under the real function blocks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

from dtwin.arm.chain import Arm, Array, Friction, holding
from dtwin.arm.model import ArmModel, ArmSettings
from dtwin.bus.chain.messages import JointCommands, JointQuestion, JointSensors, JointTick, JointTicks
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.native import DryFriction, NativeChain
from dtwin.equations.rigid import forward_dynamics, inverse_dynamics
from dtwin.errors import CommunicationError, ParameterError
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings, run
from dtwin.simulation.chain.predicting import SPAN, Predicting
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange

AS_IT_IS = ArmChange()


def settings(name: str = "planar-2r", machine: str = "nominal") -> ChainSettings:
    return ArmCell(arm=name, machine=machine).settings(4.0)


def without_effects(arm: Arm) -> Arm:
    joints = (replace(joint, friction=Friction(joint.friction.viscous), step=0.0) for joint in arm.joints)
    return replace(arm, joints=tuple(joints))


@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
def test_without_effects_the_twin_is_the_emulation(name: str) -> None:
    """Blocks and chain twin against blocks and MuJoCo, which know nothing of each other."""
    given = settings(name, "ideal")
    arm = without_effects(given.arm)
    given = replace(given, arm=arm, machine=replace(given.machine, arm=arm))
    emulated = run(given)
    found = ArmSimulator(given, ArmModel.of(arm)).run(given.poses.positions[0], AS_IT_IS, 4.0)
    assert np.abs(found.q - emulated.true).max() < 1e-9
    assert np.abs(found.target - emulated.target).max() < 1e-9


def test_dry_friction_balances_the_velocities_at_the_end_of_a_step() -> None:
    """Two steps against Runge-Kutta's method in Python with the equations of rigid.py, of an arm without rotors."""
    arm = without_effects(arm_of("six-axis"))
    n = len(arm)
    arm = replace(arm, joints=tuple(replace(j, actuator=replace(j.actuator, rotor=0.0)) for j in arm.joints))
    generator = np.random.default_rng(2)
    q, qd = generator.uniform(-1.0, 1.0, n), generator.uniform(-0.01, 0.01, n)
    torque = generator.uniform(-50.0, 50.0, n)
    coulomb, share, width, step = generator.uniform(1.0, 5.0, n), generator.uniform(0.0, 0.1, n), 0.05, 1e-4
    viscous = np.array([joint.friction.viscous for joint in arm.joints])
    moving = NativeChain(arm).moving(q, qd, step, 1, DryFriction(coulomb, share, width))
    carried = np.zeros(n)
    for _ in range(2):

        def accelerations(at: Array, speed: Array, friction: Array) -> Array:
            found: Array = forward_dynamics(arm, at[None], speed[None], (torque - viscous * speed - friction)[None])[
                0
            ]
            return found

        def unbalanced(
            friction: Array, q: Array = q, qd: Array = qd, most: Array = coulomb + share * carried
        ) -> Array:
            return friction - most * np.tanh((qd + step * accelerations(q, qd, friction)) / width)

        friction = root(unbalanced, np.zeros(n), tol=1e-13).x
        assert unbalanced(friction) == pytest.approx(0.0, abs=1e-9)
        v, a = [qd], [accelerations(q, qd, friction)]
        carried = np.abs(torque - viscous * qd - friction)
        for part in (0.5 * step, 0.5 * step, step):
            at, speed = q + part * v[-1], qd + part * a[-1]
            v.append(speed)
            a.append(accelerations(at, speed, friction))
        weights = np.array([1.0, 2.0, 2.0, 1.0])[:, None] * step / 6.0
        q, qd = q + np.sum(weights * np.array(v), axis=0), qd + np.sum(weights * np.array(a), axis=0)
        moving.advance(torque)
        assert moving.q == pytest.approx(q, abs=1e-9)
        assert moving.qd == pytest.approx(qd, abs=1e-9)


def test_an_arm_that_its_friction_can_hold_stands_still() -> None:
    """Friction of 1.2 times its weight, in steps as long as a tick; its width of 1 mrad/s lets it creep slower."""
    arm = without_effects(arm_of("six-axis"))
    n, start = len(arm), np.full(len(arm), 0.3)
    weight = inverse_dynamics(arm, start[None], np.zeros((1, n)), np.zeros((1, n)))[0]
    friction = DryFriction(1.2 * np.abs(weight), np.zeros(n), 1e-3)
    moving = NativeChain(arm).moving(start, np.zeros(n), arm.period, 1, friction)
    for _ in range(200):
        moving.advance(np.zeros(n))
        assert (np.abs(moving.qd) < 1.3e-3).all()


def test_with_friction_it_follows_its_path_as_the_emulation_does() -> None:
    given = settings("six-axis")
    emulated = np.sqrt(np.mean(run(given).error ** 2, axis=0))
    found = ArmSimulator(given, ArmModel.of(given.arm)).run(given.poses.positions[0], AS_IT_IS, 4.0)
    expected = np.sqrt(np.mean(found.error**2, axis=0))
    assert (np.abs(np.log(expected / emulated)) < np.log(1.5)).all()


def test_softer_gains_and_loads_lead_farther_from_the_path() -> None:
    given = settings()
    model, start = ArmModel.of(given.arm), given.poses.positions[0]
    now, soft, heavy, fast = (
        np.abs(ArmSimulator(given, model).run(start, change, 4.0).error).max(axis=0)
        for change in (AS_IT_IS, ArmChange(pole=6.0), ArmChange(payload=0.4), ArmChange(speed=1.6))
    )
    assert (soft > now).all()
    assert (heavy > 2.0 * now).all()
    assert not np.allclose(fast, now)
    usual, stiff = (ArmSimulator(given, model).loops(change) for change in (AS_IT_IS, ArmChange(pole=40.0)))
    assert min(one.modulus for one in stiff) < min(one.modulus for one in usual)


def test_a_faster_path_reaches_more_poses() -> None:
    given = settings()
    model, start = ArmModel.of(given.arm), given.poses.positions[0]
    slow, fast = (ArmSimulator(given, model).run(start, ArmChange(speed=s), 8.0).reached for s in (0.5, 1.5))
    assert fast > slow


def test_a_held_mass_is_a_load_of_the_emulation() -> None:
    arm = without_effects(arm_of("six-axis"))
    given = settings("six-axis", "ideal")
    start = np.full(len(arm), 0.3)
    plant = ChainPlant(replace(given.machine, arm=arm), start)
    plant.hold(2.0)
    moving = NativeChain(holding(arm, 2.0)).moving(start, np.zeros(len(arm)), arm.period / 4, 4)
    for _ in range(50):
        plant.apply([1.0] * len(arm))
        plant.advance()
        constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
        moving.advance(constant)
    assert np.abs(moving.q - plant.state[0]).max() < 1e-9


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pole": 0.0}, "pole: expected 1 to 60 rad/s, got 0"),
        ({"observer": 1e4}, "observer: expected 10 to 500 rad/s"),
        ({"speed": 9.0}, "speed: expected 0.1 to 2"),
        ({"payload": -1.0}, "payload: expected 0 to"),
    ],
)
def test_what_is_out_of_range_is_refused(change: dict[str, float], said: str) -> None:
    given = settings()
    with pytest.raises(ParameterError, match=said):
        ArmSimulator(given, ArmModel.of(given.arm)).run(given.poses.positions[0], ArmChange(**change), 1.0)


def test_predictions_stand_beside_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dtwin.simulation.chain.predicting.PATIENCE", 0.0)
    given = settings()
    predicting, model = Predicting(given), ArmModel.of(given.arm)
    with pytest.raises(CommunicationError, match="no sample"):
        predicting.answer(JointQuestion(), 3, ArmSettings(model))
    where = tuple(map(float, given.poses.positions[0]))

    def tick(k: int, off: float) -> JointTick:
        sensors = JointSensors(k, k * given.arm.period, where)
        return JointTick(sensors, JointCommands(k, sensors.time, (0.0, 0.0), (where[0] + off, where[1])))

    predicting.receive(JointTicks((tick(0, 0.0),)))
    assert predicting.answer(JointQuestion(), 3, ArmSettings(model)).measured is None
    assert not predicting.await_measured(0.0)
    for k in range(1, round(SPAN / given.arm.period) + 1):
        predicting.receive(JointTicks((tick(k, 0.002 * (k == 40)),)))
    assert predicting.await_measured(0.0)
    found = predicting.answer(JointQuestion(pole=8.0), 3, ArmSettings(model))
    assert found.version == 3
    assert found.measured == pytest.approx((0.002, 0.0))
    assert max(found.proposed.tracking) > max(found.now.tracking) > 0.0
    assert found.now.stable
    predicting.receive(JointTicks((tick(0, 0.0),)))
    assert predicting.answer(JointQuestion(), 3, ArmSettings(model)).measured is None
    assert not predicting.await_measured(0.0)
