"""mujoco.sysid on a serial arm, for comparison: bodies, friction, rotors and offsets from motion and torque.

Its rollout is replaced, as its documentation provides for, by MuJoCo's inverse dynamics at the measured states, so
that it fits the torque that it is judged by. Simulated windows of the motion, its default, run away from what was
measured, as an arm is unstable under given torques, and end at bodies that explain no torque. Bodies have its
pseudo-inertia parameters; friction is MuJoCo's own, dry and a polynomial of the speed; offsets are biases of its
sensors.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array, steiner
from dtwin.emulation.chain.model import LOAD, chain_spec
from dtwin.emulation.peer import is_installed, quiet
from dtwin.errors import DtwinError

_EVALUATIONS: Final = 40
"""Steps of the search at most; it ends by itself."""
_SMALL: Final = 1e-3
"""Gain of a step that ends the search, in parts of the cost."""
_DIFFERENCE: Final = 1e-6
"""Relative step of its derivatives by differences; with its own, 1.5e-8, bodies that tell little are all noise."""
_STRETCH: Final = np.array([0.05, 20.0])
"""Bounds of how a body may be stretched along its axes, in parts of the description's."""
_SHEAR: Final = np.array([-1.0, 1.0])
"""Bounds of how a body may be sheared."""
_CENTRE: Final = np.array([-0.3, 0.3])
"""Bounds of how far a centre of mass may be from the description's, m."""
_MASS: Final = np.array([0.1, 10.0])
"""Bounds of a mass in parts of the description's."""


@dataclass(frozen=True, slots=True, eq=False)
class Posed:
    """A stretch of motion that is known, and what was measured of it.

    Attributes:
        q: positions, (N, n).
        v: velocities, (N, n).
        a: accelerations, (N, n).
        torque: measured torque after the filter, (K, n), N m.
        through: filter that the torque of the model passes to be compared with it: (N, n) to (K, n).
    """

    q: Array
    v: Array
    a: Array
    torque: Array
    through: Callable[[Array], Array]


class ChainPeerFit:
    """What mujoco.sysid found.

    Attributes:
        parameters: inertial parameters of all links, (10 n,), in the order of chain.INERTIAL.
        rotor: inertia of every rotor, (n,).
        offset: torque that is always there, (n,).
        seconds: time that the search took, s.
        start: root mean square of the residual where the search began, in parts of the torque's.
        end: the same where it ended.
    """

    def __init__(self, arm: Arm, model: Any, offset: Array, seconds: float, sizes: tuple[float, float]) -> None:
        self._model = model
        self.parameters, self.rotor = _bodies(arm, model), np.array(model.dof_armature)
        self.offset, self.seconds = offset, seconds
        self.start, self.end = sizes

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """What the model that was found needs for a motion, (N, n)."""
        return _inverse(self._model, mujoco.MjData(self._model), q, v, a) + self.offset


def fit_chain(arm: Arm, dt: float, motions: Sequence[Posed]) -> ChainPeerFit:
    """Identifies an arm by mujoco.sysid.

    Args:
        arm: the arm as it is known, where the search begins.
        dt: time from row to row, s.
        motions: stretches of motion.

    Raises:
        DtwinError: mujoco.sysid cannot be imported, or its search ends with an error.
    """
    if not is_installed():
        raise DtwinError("mujoco.sysid lacks packages: pip install 'mujoco[sysid]'")
    from mujoco import sysid

    spec = _spec(arm, dt)
    model = spec.compile()
    parameters = _parameters(arm, spec, model, np.max([np.abs(m.torque).max(axis=0) for m in motions], axis=0))
    transform = sysid.SignalTransform()
    for joint in arm.joints:
        transform.bias(_sensor(joint.name), parameters[f"{joint.name} offset"], target="predicted")
    sequences = [_sequence(sysid, arm, spec, model, number, motion) for number, motion in enumerate(motions)]
    residual = sysid.build_residual_fn(
        models_sequences=sequences, custom_rollout=_Inverse(motions), modify_residual=transform.apply, n_threads=1
    )
    try:
        began = time.perf_counter()
        with quiet():
            found, _ = sysid.optimize(
                parameters,
                residual,
                optimizer="scipy_parallel_fd",
                verbose=False,
                x_scale="jac",
                max_iters=_EVALUATIONS,
                ftol=_SMALL,
                diff_step=_DIFFERENCE,
            )
        seconds = time.perf_counter() - began
    except (ValueError, ArithmeticError, RuntimeError, mujoco.FatalError) as error:
        said = (str(error).splitlines() or [""])[0]
        raise DtwinError(f"mujoco.sysid ended with an error: {said or type(error).__name__}") from error
    offset = np.array([found[f"{joint.name} offset"].value[0] for joint in arm.joints])
    sizes = _size(residual, parameters, len(arm)), _size(residual, found, len(arm))
    return ChainPeerFit(arm, sysid.apply_param_modifiers(found, spec), offset, seconds, sizes)


def _size(residual: Any, parameters: Any, joints: int) -> float:
    """Root mean square of the residual in parts of the torque's, over joints and stretches.

    A column is divided by the norm of what was measured over the root of two (its `normalize_residual`).
    """
    parts = residual(parameters.as_vector(), parameters)[0]
    return float(np.sqrt(sum(np.sum(each**2) for each in parts) / (2.0 * joints * len(parts))))


def _spec(arm: Arm, dt: float) -> Any:
    spec = chain_spec(arm, dt)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.delete(spec.body(LOAD))
    for joint in arm.joints:
        spec.add_sensor(
            name=_sensor(joint.name),
            type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
        )
    return spec


def _sensor(joint: str) -> str:
    return f"{joint} torque"


def _sequence(sysid: Any, arm: Arm, spec: Any, model: Any, number: int, motion: Posed) -> Any:
    """A stretch as the toolbox wants it; its control is the number by which the rollout finds the motion."""
    times = np.arange(len(motion.torque), dtype=np.float64)
    return sysid.ModelSequences(
        arm.name,
        spec,
        f"stretch {number}",
        sysid.create_initial_state(model, motion.q[0], motion.v[0]),
        sysid.TimeSeries(times, np.full((len(times), 0), 0.0)),
        sysid.TimeSeries.from_names(times, motion.torque, model),
    )


class _Inverse:
    """The rollout: torque of each model at the states of the motion, through the filter."""

    def __init__(self, motions: Sequence[Posed]) -> None:
        self._of = {(*motion.q[0], *motion.v[0]): motion for motion in motions}

    def __call__(self, **given: Any) -> list[Any]:
        from mujoco import sysid

        found = []
        n = given["models"][0].nv
        for model, state, control in zip(
            given["models"], given["initial_states"], given["control_signal"], strict=True
        ):
            motion = self._of[tuple(state[1 : 2 * n + 1].tolist())]
            torque = motion.through(_inverse(model, given["datas"][0], motion.q, motion.v, motion.a))
            times = np.arange(len(torque), dtype=np.float64)
            sensed = sysid.TimeSeries(times, torque, given["rollout_signal_mapping"])
            states = sysid.TimeSeries(times, np.column_stack([times, np.zeros((len(times), len(state) - 1))]))
            found.append(sysid.SystemTrajectory(model, control, sensed, state, states))
        return found


def _inverse(model: Any, data: Any, q: Array, v: Array, a: Array) -> Array:
    """Torque of the drives by MuJoCo's inverse dynamics, (N, n)."""
    found = np.empty_like(q)
    for row in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[row], v[row], a[row]
        mujoco.mj_inverse(model, data)
        found[row] = data.qfrc_inverse
    return found


def _parameters(arm: Arm, spec: Any, model: Any, largest: Array) -> Any:
    """Bodies, and friction, rotor and offset of every joint from a guess in the middle of what they may be."""
    from mujoco import sysid

    found = sysid.ParameterDict()
    for link in arm.links:
        found.add(
            sysid.body_inertia_param(
                spec,
                model,
                link.name,
                sysid.InertiaType.Pseudo,
                mass_bound_mult=_MASS,
                ipos_bound_off=_CENTRE,
                stretch_bound_mult=_STRETCH,
                shear_bound_off=_SHEAR,
                modifier=_body_setter(link.name),
            )
        )
    for joint, most in zip(arm.joints, largest.tolist(), strict=True):
        for name, value, low, high in (
            ("damping", 0.05, 0.0, 2.0),
            ("damping by speed", 0.0, -1.0, 1.0),
            ("frictionloss", 0.05, 1e-4, 1.0),
            ("armature", 0.002, 0.0, 0.5),
        ):
            bounds = low * most, high * most
            setter = _setter(joint.name, name)
            found.add(sysid.Parameter(f"{joint.name} {name}", value * most, *bounds, modifier=setter))
        found.add(sysid.Parameter(f"{joint.name} offset", 0.0, -most, most, modifier=lambda spec, parameter: None))
    return found


def _setter(joint: str, name: str) -> Any:
    def set_value(spec: Any, parameter: Any) -> None:
        value, made = float(parameter.value[0]), spec.joint(joint)
        if name.startswith("damping"):
            made.damping[1 if name.endswith("speed") else 0] = value
        else:
            setattr(made, name, value)

    return set_value


def _body_setter(name: str) -> Any:
    """Sets a body by its pseudo-inertia parameters; its own setter compiles the model for each body anew."""
    from mujoco.sysid import model_modifier

    def set_body(spec: Any, parameter: Any) -> None:
        values = model_modifier.pi_from_theta(parameter.value)
        mass, centre = float(values[0]), values[1:4] / values[0]
        inertia = values[4:].reshape(3, 3) - mass * steiner(centre)
        body = spec.body(name)
        body.mass, body.ipos = mass, centre
        body.inertia, body.iquat = np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]

    return set_body


def _bodies(arm: Arm, model: Any) -> Array:
    bodies = []
    for link in arm.links:
        body = model.body(link.name)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        axes = turn.reshape(3, 3)
        mass, centre = float(body.mass[0]), np.array(body.ipos)
        inertia = axes @ np.diag(body.inertia) @ axes.T + mass * steiner(centre)
        bodies.append(np.array([mass, *(mass * centre), *inertia[np.tril_indices(3)]]))
    return np.concatenate(bodies)
