"""The equations of a serial chain as machine code: forward dynamics, and the motion under given torques.

The same equations as in `rigid`, written for speed in chain.c; a test holds both together. The machine code is made
once by the system's C compiler and kept.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, aligned
from dtwin.errors import ModelError
from iec61499.native.build import load

_FOLDER: Final = Path(__file__).parent
_FILES: Final = ("chain.h", "chain.c")
_MOST: Final = 32
_SIZE: Final = 25
"""Numbers of a link; see chain.c."""


_FLAGS: Final = ("-std=c99", "-O3", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
"""Of the C compiler: it may reorder operations, but not change what they give."""
_WIDTH: Final = 0.01
"""Least velocity over which dry friction changes its sign, rad/s or m/s."""


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

    def moving(self, q: Array, qd: Array, step: float, steps: int, dry: DryFriction | None = None) -> MovingChain:
        """The arm in motion from a state on, (n,) each, by steps (s) of the Runge-Kutta method in each tick."""
        return MovingChain(self._library, (self._links, self._gravity), (q, qd), step, steps, dry)

    def _rows(self, values: Array) -> Array:
        return np.ascontiguousarray(values, dtype=np.float64).reshape(-1, self._n)


@dataclass(frozen=True, slots=True, eq=False)
class DryFriction:
    """Friction that does not grow with the velocity, smooth over a width of it.

    Attributes:
        coulomb: torques against the motion, (n,), N m or N.
        share: further ones in parts of the torque that each gear carries, (n,).
        width: velocity over which they change their sign, rad/s or m/s.
    """

    coulomb: Array
    share: Array
    width: float


class _Dry(ctypes.Structure):
    _fields_ = (
        ("coulomb", ctypes.c_void_p),
        ("share", ctypes.c_void_p),
        ("carried", ctypes.c_void_p),
        ("width", ctypes.c_double),
    )


class _Plant(ctypes.Structure):
    _fields_ = (
        ("joints", ctypes.c_int32),
        ("steps", ctypes.c_int32),
        ("step", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("links", "gravity", "q", "qd", "dry")),
    )


class MovingChain:
    """An arm that goes on tick by tick.

    Args:
        library: the machine code.
        numbers: of the links, and gravity.
        state: positions and velocities at the beginning, (n,) each.
        step: step of the Runge-Kutta method of fourth order, s.
        steps: steps in a tick.
        dry: its dry friction; None for none.

    Attributes:
        q: positions, (n,), rad or m.
        qd: velocities, (n,).
        move: address of `int32_t move(void *plant, const double *torque)`.
        plant: address of what it moves.
    """

    def __init__(
        self,
        library: ctypes.CDLL,
        numbers: tuple[Array, Array],
        state: tuple[Array, Array],
        step: float,
        steps: int,
        dry: DryFriction | None,
    ) -> None:
        self.q, self.qd = (np.array(values, dtype=np.float64) for values in state)
        n = len(self.q)
        friction: _Dry | None = None
        rows: tuple[Array, ...] = ()
        if dry is not None:
            rows = tuple(np.array(values, dtype=np.float64) for values in (dry.coulomb, dry.share, np.zeros(n)))
            friction = _Dry(*(row.ctypes.data for row in rows), dry.width)
        places = (each.ctypes.data for each in (*numbers, self.q, self.qd))
        made = _Plant(n, steps, step, *places, None if friction is None else ctypes.addressof(friction))
        self._kept = numbers, rows, friction, made  # the machine code has their addresses
        self._move = library.chain_move
        self.move: int = ctypes.cast(self._move, ctypes.c_void_p).value or 0
        self.plant = ctypes.addressof(made)

    def advance(self, torque: Array) -> bool:
        """Goes on by a tick under torques of the drives, (n,), that are held; whether the motion is finite."""
        held = np.ascontiguousarray(torque, dtype=np.float64)
        return bool(self._move(ctypes.c_void_p(self.plant), _pointer(held)))


def _numbers(arm: Arm) -> Array:
    """The numbers of all links, (n, 25), in the frames whose z axes are the axes of the joints."""
    chain = aligned(arm)
    found = np.empty((len(arm), _SIZE))
    for row, joint, link in zip(found, chain.joints, chain.links, strict=True):
        row[:9], row[9:12] = joint.rotation.ravel(), joint.translation
        row[12:22] = link.parameters
        row[22:] = float(joint.turns), joint.actuator.rotor or 0.0, joint.friction.viscous
    return found


def width_of(arm: Arm, step: float) -> float:
    """A velocity over which dry friction changes its sign so slowly that explicit steps stay stable.

    Runge-Kutta's method of fourth order is stable up to rates of 2.78 a step (Hairer and Wanner, IV.2). With this
    width friction makes a rate of at most 1 a step where a joint moves its own link and rotor alone, and less where
    it moves more.
    """
    widths = [_WIDTH]
    for joint, link in zip(arm.joints, arm.links, strict=True):
        own = link.inertia @ joint.axis @ joint.axis if joint.turns else link.mass
        dry = joint.friction.coulomb + joint.friction.load * min(joint.largest, 1e4)
        inertia = (joint.actuator.rotor or 0.0) + float(own)
        if dry > 0.0 and inertia > 0.0:
            widths.append(step * dry / inertia)
    return float(max(widths))


def _pointer(values: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    texts = {name: (_FOLDER / name).read_text() for name in _FILES}
    return load("".join(texts.values()), "chain", lambda: texts, _FLAGS)
