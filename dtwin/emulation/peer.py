"""MuJoCo's own identification toolbox, mujoco.sysid, at its best settings, for comparison in benchmarks.

Its default settings lose digits on this task, so four of them are changed. Predicted sensor values are moved back by
one model step, because mujoco.sysid stamps them one step late. Commands are given at every model step, because it
would interpolate them. Residuals are not normalised. Unknowns are scaled by the Jacobian. The toolbox needs the
packages of `pip install 'mujoco[sysid]'`.
"""

from __future__ import annotations

import contextlib
import io
import logging
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.model import ACTUATORS, JOINT_NAMES, LINKS
from dtwin.errors import DtwinError
from dtwin.parameters import PARAMETER_NAMES, PERIOD, PHYSICS_STEP, VOLTAGE_LIMIT, ArmParameters

Array = NDArray[np.float64]

SENSORS: Final = ("theta_1", "theta_2", "theta_3")
_FEATHER: Final = 1e-9
"""Mass of the tip, kg; negative gravity compensation on it makes the load, a weight without inertia."""


@dataclass(frozen=True, slots=True)
class PeerFit:
    """Result of mujoco.sysid: estimated values by name in SI units, and the duration of the fit in s."""

    values: Mapping[str, float]
    seconds: float


def is_installed() -> bool:
    """Whether mujoco.sysid and what it needs can be imported."""
    try:
        from mujoco import sysid

        return hasattr(sysid, "optimize")
    except ImportError:
        return False


def fit(
    measured: Array,
    volts: Array,
    theta: Array,
    weight: float,
    start: ArmParameters,
    bounds: Mapping[str, tuple[float, float]],
) -> PeerFit:
    """Least squares by mujoco.sysid over parameters and three encoder biases.

    Args:
        measured: (N, 3), measured angles at the controller's period, rad.
        volts: (N, 3), voltages held over a period, V.
        theta: (3,), known angles at the start, where the arm is at rest, rad.
        weight: mass of the load at the tip, whose inertia does not act, kg.
        start: values of all parameters; the search starts there, and those without bounds keep them.
        bounds: lower and upper bound of every estimated parameter by name (K, I, c, D of a joint), SI units.

    Raises:
        DtwinError: mujoco.sysid cannot be imported.
    """
    if not is_installed():
        raise DtwinError("mujoco.sysid lacks packages: pip install 'mujoco[sysid]'")
    from mujoco import sysid

    spec = _spec(start, weight)
    parameters = sysid.ParameterDict()
    for name, (low, high) in bounds.items():
        parameters.add(sysid.Parameter(name, start.get(name), low, high, modifier=_modifier(name)))
    transform = sysid.SignalTransform(normalize=False)
    delay = sysid.Parameter("delay", -PHYSICS_STEP, -PHYSICS_STEP, -PHYSICS_STEP, frozen=True)
    parameters.add(delay)
    transform.delay("*", delay)
    for sensor in SENSORS:
        bias = sysid.Parameter(f"bias_{sensor}", 0.0, -0.1, 0.1)
        parameters.add(bias)
        transform.bias(sensor, bias, target="predicted")

    model = spec.compile()
    substeps = round(PERIOD / PHYSICS_STEP)
    held = np.zeros((substeps * (len(volts) - 1) + 1, len(ACTUATORS)))
    held[:-1, :3] = np.repeat(np.clip(volts[:-1], -VOLTAGE_LIMIT, VOLTAGE_LIMIT), substeps, axis=0)
    data = mujoco.MjData(model)
    data.qpos[:3] = theta
    state = sysid.create_initial_state(model, data.qpos, data.qvel, data.act)
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        "measured",
        state,
        sysid.TimeSeries(np.arange(len(held)) * PHYSICS_STEP, held),
        sysid.TimeSeries.from_names(np.arange(len(measured)) * PERIOD, measured, model),
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences], modify_residual=transform.apply)
    with quiet():
        began = time.perf_counter()
        found, _ = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False, x_scale="jac")
        seconds = time.perf_counter() - began
    return PeerFit({name: float(found[name].value[0]) for name in bounds}, seconds)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Lets mujoco.sysid say nothing meanwhile; its optimiser prints whatever `verbose` says."""
    level = logging.getLogger().level
    logging.getLogger().setLevel(logging.ERROR)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        logging.getLogger().setLevel(level)


def _spec(arm: ArmParameters, weight: float) -> Any:
    """The moving part of the cell with the parameters of an arm and a load (kg) at its tip."""
    spec = mujoco.MjSpec.from_file(str(MODEL_FILE))
    for element in (*spec.geoms, *spec.cameras, *spec.lights, *spec.keys, *spec.sites):
        spec.delete(element)
    for sensor in spec.sensors:
        if sensor.name not in SENSORS:
            spec.delete(sensor)
    for body in spec.bodies:
        if body.name not in ("world", *LINKS, "jaw", "tip"):
            spec.delete(body)
    spec.option.timestep = PHYSICS_STEP
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    for name in PARAMETER_NAMES:
        if not name.startswith("mu"):
            _set(spec, name, arm.get(name))
    tip = spec.body("tip")
    tip.mass = _FEATHER
    tip.gravcomp = -weight / _FEATHER
    spec.body("jaw").gravcomp = 1.0  # MuJoCo looks at gravity compensation only if some body's is above 0
    return spec


def _modifier(name: str) -> Callable[[Any, Any], None]:
    return lambda spec, parameter: _set(spec, name, float(parameter.value[0]))


def _set(spec: Any, name: str, value: float) -> None:
    """Writes one parameter of the arm into a spec."""
    symbol, joint = name[0], int(name[1:])
    link = spec.body(LINKS[joint - 1])
    if symbol == "m":
        link.mass = value
    elif symbol == "I":
        link.inertia = (0.1 * value, value, value)
    elif symbol == "c":
        link.ipos = (value, 0.0, 0.0)
    elif symbol == "l":
        spec.body((*LINKS[1:], "tip")[joint - 1]).pos = (value, 0.0, 0.0)
    elif symbol == "D":
        spec.joint(JOINT_NAMES[joint - 1]).damping[0] = value
    else:
        spec.actuator(ACTUATORS[joint - 1]).gainprm[0] = value
