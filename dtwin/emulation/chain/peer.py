"""mujoco.sysid on a serial arm, for comparison: bodies, viscous and dry friction and rotors from motion and torque.

It simulates windows of the motion from measured states and searches the parameters whose motion is that which was
measured, with derivatives by differences, as its documentation shows. Bodies have its pseudo-inertia parameters.
"""

from __future__ import annotations

import contextlib
import io
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Array, steiner
from dtwin.emulation.chain.model import chain_spec
from dtwin.emulation.peer import is_installed
from dtwin.errors import DtwinError

_WINDOW: Final = 0.5
"""Length of a window, s: longer ones run away from what was measured, as arms are unstable under given torques."""
_ITERATIONS: Final = 10
"""Steps of the search, each of which takes about a thousand simulations of the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class ChainPeerFit:
    """What mujoco.sysid found.

    Attributes:
        parameters: inertial parameters of all links, (10 n,), in the order of chain.INERTIAL.
        viscous: torque per velocity, (n,).
        coulomb: torque against the motion, (n,).
        rotor: inertia of every rotor, (n,).
        seconds: time that the search took, s.
    """

    parameters: Array
    viscous: Array
    coulomb: Array
    rotor: Array
    seconds: float


def fit_chain(arm: Arm, dt: float, motions: Sequence[tuple[Array, Array, Array]]) -> ChainPeerFit:
    """Identifies an arm by mujoco.sysid.

    Args:
        arm: the arm as it is known, where the search begins.
        dt: time from row to row, s.
        motions: positions, velocities and torques of the drives, (N, n) each, stretch by stretch.

    Raises:
        DtwinError: mujoco.sysid cannot be imported, or its search ends with an error.
    """
    if not is_installed():
        raise DtwinError("mujoco.sysid lacks packages: pip install 'mujoco[sysid]'")
    from mujoco import sysid

    spec = _spec(arm, dt)
    model = spec.compile()
    parameters = _parameters(arm, spec, model, np.max([np.abs(motion[2]).max(axis=0) for motion in motions], axis=0))
    rows = round(_WINDOW / dt)
    times = np.arange(rows) * dt
    parts = [
        [column[start : start + rows] for column in motion]
        for motion in motions
        for start in range(0, len(motion[0]) - rows, rows)
    ]
    sequences = sysid.ModelSequences(
        arm.name,
        spec,
        [f"window {k}" for k in range(len(parts))],
        [sysid.create_initial_state(model, q[0], v[0]) for q, v, _ in parts],
        [sysid.TimeSeries(times, torque) for _, _, torque in parts],
        [sysid.TimeSeries.from_names(times, np.hstack([q, v]), model) for q, v, _ in parts],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    level = logging.getLogger().level
    logging.getLogger().setLevel(logging.ERROR)
    try:
        began = time.perf_counter()
        # Its optimiser prints whatever `verbose` says.
        with contextlib.redirect_stdout(io.StringIO()):
            found, _ = sysid.optimize(
                parameters, residual, optimizer="mujoco", verbose=False, x_scale="jac", max_iters=_ITERATIONS
            )
        seconds = time.perf_counter() - began
    except (ValueError, ArithmeticError, RuntimeError, mujoco.FatalError) as error:
        said = (str(error).splitlines() or [""])[0]
        raise DtwinError(f"mujoco.sysid ended with an error: {said or type(error).__name__}") from error
    finally:
        logging.getLogger().setLevel(level)
    return _read(arm, sysid.apply_param_modifiers(found, spec), seconds)


def _spec(arm: Arm, dt: float) -> Any:
    spec = chain_spec(arm, dt)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.delete(spec.body("load"))
    for joint in arm.joints:
        actuator = spec.add_actuator(name=f"{joint.name} drive", target=joint.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.set_to_motor()
    for kind in (mujoco.mjtSensor.mjSENS_JOINTPOS, mujoco.mjtSensor.mjSENS_JOINTVEL):
        for joint in arm.joints:
            spec.add_sensor(
                name=f"{joint.name} {kind.name}", type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint.name
            )
    return spec


def _parameters(arm: Arm, spec: Any, model: Any, largest: Array) -> Any:
    """Bodies, and friction and rotors of every joint from a guess in the middle of what they may be."""
    from mujoco import sysid

    found = sysid.ParameterDict()
    for link in arm.links:
        kind = sysid.InertiaType.Pseudo
        found.add(sysid.body_inertia_param(spec, model, link.name, kind, modifier=_body_setter(link.name)))
    for joint, most in zip(arm.joints, largest.tolist(), strict=True):
        for name, value, top in (("damping", 0.05, 1.0), ("frictionloss", 0.05, 0.5), ("armature", 0.002, 0.5)):
            found.add(
                sysid.Parameter(
                    f"{joint.name} {name}", value * most, 1e-4, top * most, modifier=_setter(joint.name, name)
                )
            )
    return found


def _setter(joint: str, name: str) -> Any:
    def set_value(spec: Any, parameter: Any) -> None:
        value = float(parameter.value[0])
        setattr(spec.joint(joint), name, np.array([value, 0.0, 0.0]) if name == "damping" else value)

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


def _read(arm: Arm, model: Any, seconds: float) -> ChainPeerFit:
    bodies = []
    for link in arm.links:
        body = model.body(link.name)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        axes = turn.reshape(3, 3)
        mass, centre = float(body.mass[0]), np.array(body.ipos)
        inertia = axes @ np.diag(body.inertia) @ axes.T + mass * steiner(centre)
        bodies.append(np.array([mass, *(mass * centre), *inertia[np.tril_indices(3)]]))
    loss = np.array(model.dof_frictionloss)
    return ChainPeerFit(
        np.concatenate(bodies), np.array(model.dof_damping).ravel(), loss, np.array(model.dof_armature), seconds
    )
