"""The equations of a serial chain as machine code: forward dynamics, and the motion under given torques.

The same equations as in `rigid`, written for speed in chain.c; a test holds both together. The machine code is made
once by the system's C compiler and kept.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, aligned
from dtwin.errors import ModelError
from iec61499.native.build import load
from iec61499.native.unit import Unit

_FOLDER: Final = Path(__file__).parent
_NAME: Final = "chain"
_MOST: Final = 32
_SIZE: Final = 25
"""Numbers of a link; see chain.c."""


class NativeChain:
    """The equations of one arm.

    Args:
        arm: the chain; viscous friction and rotors are part of its equations.

    Raises:
        NativeError: there is no C compiler.
        ModelError: the arm has too many joints.
    """

    def __init__(self, arm: Arm) -> None:
        if len(arm) > _MOST:
            raise ModelError(f"arm {arm.name}: expected at most {_MOST} joints, got {len(arm)}")
        self._library = _library()
        self._n = len(arm)
        self._links = _numbers(arm)
        self._gravity = np.ascontiguousarray(arm.gravity, dtype=np.float64)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array) -> Array:
        """The accelerations of N states under torques of the drives, (N, n) each, by friction and rotors too."""
        q, qd, tau = (self._rows(values) for values in (q, qd, tau))
        found = np.empty_like(q)
        self._library.chain_forward_many(
            len(q), self._n, *map(_pointer, (self._links, self._gravity, q, qd, tau, found))
        )
        return found

    def rollout(self, q: Array, qd: Array, tau: Array, step: float, steps: int) -> tuple[Array, Array]:
        """The motion under torques that are constant in every tick.

        Args:
            q: positions at the beginning, (n,).
            qd: velocities at the beginning, (n,).
            tau: torques of the drives, a row for each tick, (N, n), N m or N.
            step: step of the Runge-Kutta method of fourth order, s.
            steps: steps in a tick.

        Returns:
            Positions and velocities at the beginning of every tick and at the end, (N + 1, n) each.
        """
        tau = self._rows(tau)
        q, qd = (np.array(values, dtype=np.float64) for values in (q, qd))
        positions, velocities = np.empty_like(tau), np.empty_like(tau)
        self._library.chain_rollout(
            len(tau),
            self._n,
            *map(_pointer, (self._links, self._gravity, q, qd, tau)),
            ctypes.c_double(step),
            steps,
            *map(_pointer, (positions, velocities)),
        )
        return np.vstack([positions, q]), np.vstack([velocities, qd])

    def _rows(self, values: Array) -> Array:
        return np.ascontiguousarray(values, dtype=np.float64).reshape(-1, self._n)


def _numbers(arm: Arm) -> Array:
    """The numbers of all links, (n, 25), in the frames whose z axes are the axes of the joints."""
    chain = aligned(arm)
    found = np.empty((len(arm), _SIZE))
    for row, joint, link in zip(found, chain.joints, chain.links, strict=True):
        row[:9], row[9:12] = joint.rotation.ravel(), joint.translation
        row[12:22] = link.parameters
        row[22:] = float(joint.turns), joint.actuator.rotor or 0.0, joint.friction.viscous
    return found


def _pointer(values: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    source, header = ((_FOLDER / f"{_NAME}.{ending}").read_text() for ending in "ch")
    return load(source + header, _NAME, lambda: Unit(header, source))
