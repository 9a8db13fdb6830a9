"""The arm under given volts: a trajectory in one compiled call."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from dtwin.errors import DivergenceError, ParameterError, choices
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.twin.dynamics import Array, integrate

_WEIGHT_ONLY: Final = {"point": False, "weight": True}


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
    """Integrates the equations of motion by RK4, volts and payload held over each sample.

    Args:
        parameters: of the arm.
        state0: (6,), theta rad then omega rad/s.
        volts: (N, 3), V, clipped to the actuators' limit as in the emulation.
        payload: kg at the tip, a number or (N,).
        period: s, between samples.
        substeps: RK4 steps a sample.
        payload_model: "point" is a point mass at the tip, "weight" its weight without inertia.
        coulomb_width: rad/s, over which Coulomb friction changes sign.

    Returns:
        (N + 1, 6): the state at 0, period, ..., N period.

    Raises:
        ParameterError: a shape, number or option is wrong.
        DivergenceError: the state left the finite numbers.
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


def checked_array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The values as a contiguous finite float64 array of the shape, or a ParameterError."""
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ParameterError(f"{name}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise ParameterError(f"{name}: expected finite numbers, got {array[where]} at {where}")
    return array


def checked_payload(payload: ArrayLike, samples: int) -> Array:
    """The payload as (samples,), kg, none negative, or a ParameterError."""
    masses = np.asarray(payload, dtype=np.float64)
    masses = checked_array("payload", np.full(samples, masses) if masses.ndim == 0 else masses, (samples,))
    if masses.size and masses.min() < 0:
        raise ParameterError(f"payload: expected at least 0 kg, got {masses.min()}")
    return masses


def check_stepping(period: float, substeps: int, coulomb_width: float) -> None:
    """Raises ParameterError unless period and width are positive and finite and substeps at least 1."""
    for name, value in (("period", period), ("coulomb_width", coulomb_width)):
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"{name}: expected a finite number above 0, got {value}")
    if substeps < 1:
        raise ParameterError(f"substeps: expected at least 1, got {substeps}")


def is_weight_only(payload_model: str) -> bool:
    """The kernels' flag for a payload model's name, or a ParameterError."""
    if payload_model not in _WEIGHT_ONLY:
        raise ParameterError(f"unknown payload model {payload_model!r}: expected {choices(_WEIGHT_ONLY)}")
    return _WEIGHT_ONLY[payload_model]
