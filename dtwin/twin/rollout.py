"""The trajectory of the arm under given voltages, in one compiled call, and where many trajectories end."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.twin import dynamics
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, advance, coefficients, held_torque, integrate

_WEIGHT_ONLY: Final = {"point": False, "weight": True}


class Steps(NamedTuple):
    """How a motion is integrated.

    Attributes:
        period: time between samples, s.
        substeps: number of RK4 steps per sample.
        width: velocity over which Coulomb friction changes sign, rad/s.
    """

    period: float
    substeps: int
    width: float


def rollout(
    parameters: ArmParameters,
    state0: ArrayLike,
    volts: ArrayLike,
    payload: ArrayLike = 0.0,
    *,
    period: float = PERIOD,
    substeps: int = 4,
    payload_model: PayloadModel = "point",
    coulomb_width: float = COULOMB_WIDTH,
) -> Array:
    """Integrates the equations of motion by RK4; volts and payload are held over each sample.

    Args:
        parameters: parameters of the arm.
        state0: (6,), angles (rad), then velocities (rad/s) at the start.
        volts: (N, 3), voltages, V; they are clipped to the actuators' limit as in the emulation.
        payload: mass at the tip, kg; a number or one value per sample, (N,).
        period: time between samples, s.
        substeps: number of RK4 steps per sample.
        payload_model: "point" for a point mass at the tip, "weight" for its weight without inertia.
        coulomb_width: velocity over which Coulomb friction changes sign, rad/s.

    Returns:
        The states at the times 0, period, ..., N period: (N + 1, 6), angles in rad, then velocities in rad/s.

    Raises:
        ParameterError: a shape, number or option is wrong.
        DivergenceError: the state is no longer finite.
    """
    start = checked_array("state0", state0, (6,))
    commands = np.ascontiguousarray(volts, dtype=np.float64)
    commands = checked_array("volts", commands, (commands.shape[0] if commands.ndim else 0, 3))
    masses = checked_payload(payload, commands.shape[0])
    check_stepping(period, substeps, coulomb_width)
    states = np.empty((commands.shape[0] + 1, 6))
    states[0] = start
    vector = np.array(parameters.vector())
    weight_only = is_weight_only(payload_model)
    reached = integrate(vector, commands, masses, period, substeps, weight_only, coulomb_width, states)
    if reached < commands.shape[0]:
        raise DivergenceError("rollout of the analytic twin", reached * period, states[reached])
    return states


def rollout_ends(
    parameters: ArmParameters,
    starts: Array,
    volts: Array,
    payload: Array,
    *,
    period: float = PERIOD,
    substeps: int = 4,
) -> Array:
    """Where M trajectories of N samples end, each as `rollout` has it with a point mass at the tip.

    Args:
        parameters: parameters of the arm.
        starts: (M, 6), angles (rad), then velocities (rad/s) at the starts.
        volts: (M, N, 3), voltages, V.
        payload: (M, N), masses at the tip, kg.
        period, substeps: as for `rollout`.

    Returns:
        The states at the time N period, (M, 6); not finite where a trajectory diverges.

    Raises:
        ParameterError: a shape or number is wrong.
    """
    check_stepping(period, substeps, COULOMB_WIDTH)
    if (starts.shape[1:], volts.shape[::2], payload.shape) != ((6,), (len(starts), 3), volts.shape[:2]):
        shapes = f"{starts.shape}, {volts.shape}, {payload.shape}"
        raise ParameterError(f"starts, volts, payload: expected shapes (M, 6), (M, N, 3), (M, N), got {shapes}")
    states = np.array(starts, dtype=np.float64)
    _advance_each(np.array(parameters.vector()), volts, payload, period / substeps, substeps, COULOMB_WIDTH, states)
    return states


@kernel(uses=(dynamics,))
def _advance_each(
    p: Array, volts: Array, payload: Array, step: float, substeps: int, width: float, states: Array
) -> None:
    for j in range(states.shape[0]):
        x = (states[j, 0], states[j, 1], states[j, 2], states[j, 3], states[j, 4], states[j, 5])
        for k in range(volts.shape[1]):
            arm = coefficients(p, payload[j, k], False)
            x, _ = advance(x, held_torque(volts[j, k], arm), arm, width, step, substeps)
        for i in range(6):
            states[j, i] = x[i]


def checked_array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The values as a contiguous float64 array.

    Raises:
        ParameterError: the shape is another one, or a number is not finite.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ParameterError(f"{name}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ParameterError(f"{name}: expected finite numbers, got {array[where]} at {where}")
    return array


def checked_payload(payload: ArrayLike, samples: int) -> Array:
    """The payload (kg) of every sample, (samples,).

    Raises:
        ParameterError: the shape is another one, or a mass is negative or not finite.
    """
    masses = np.asarray(payload, dtype=np.float64)
    masses = checked_array("payload", np.full(samples, masses) if masses.ndim == 0 else masses, (samples,))
    if masses.size and masses.min() < 0:
        raise ParameterError(f"payload: expected at least 0 kg, got {masses.min()}")
    return masses


def check_stepping(period: float, substeps: int, coulomb_width: float) -> None:
    """Checks the numbers of an integration.

    Raises:
        ParameterError: the period (s) or the width (rad/s) is not finite and above 0, or substeps is below 1.
    """
    for name, value in (("period", period), ("coulomb_width", coulomb_width)):
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name}: expected a finite number above 0, got {value}")
    if substeps < 1:
        raise ParameterError(f"substeps: expected at least 1, got {substeps}")


def is_weight_only(payload_model: str) -> bool:
    """Whether a payload model is the one that the kernels call weight_only.

    Raises:
        ParameterError: there is no such payload model.
    """
    if payload_model not in _WEIGHT_ONLY:
        raise ParameterError(f"unknown payload model {payload_model!r}: expected {choices(_WEIGHT_ONLY)}")
    return _WEIGHT_ONLY[payload_model]
