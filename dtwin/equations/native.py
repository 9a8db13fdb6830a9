"""The equations of a serial chain as machine code: forward dynamics, and the motion under given torques.

The same equations as in `rigid`, written for speed in chain.c; a test holds both together. The machine code is made
once for a number of joints by the system's C compiler and kept.
"""

from __future__ import annotations

import ctypes
import platform
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.arm.chain import Arm, Array, aligned
from dtwin.errors import ModelError
from iec61499.native.build import load

_FOLDER: Final = Path(__file__).parent
_FILES: Final = ("chain.h", "chain.c", "moving.h", "moving.c")
_MOST: Final = 32

_FLAGS: Final = ("-std=c99", "-O3", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
"""Of the C compiler: it may reorder operations, but not change what they give."""
_PROCESSOR: Final = Path("/proc/cpuinfo")
_OWN: Final = ("-march=native",) if platform.machine() == "x86_64" and _PROCESSOR.is_file() else ()
"""Further ones, by which it may use all that this processor can do."""
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
        self._library = _library(len(arm))
        self._n = len(arm)
        self._links = _numbers(arm)
        self._gravity = np.ascontiguousarray(arm.gravity, dtype=np.float64)
        self._code = _Code(self._library.chain_move, self._links, self._gravity)

    def forward_dynamics(self, q: Array, qd: Array, tau: Array) -> Array:
        """The accelerations of N states under torques of the drives, (N, n) each, by friction and rotors too."""
        q, qd, tau = (self._rows(values) for values in (q, qd, tau))
        found = np.empty_like(q)
        self._library.chain_forward_many(len(q), *map(_pointer, (self._links, self._gravity, q, qd, tau, found)))
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
            *map(_pointer, (self._links, self._gravity, q, qd, tau)),
            ctypes.c_double(step),
            steps,
            *map(_pointer, (positions, velocities)),
        )
        return np.vstack([positions, q]), np.vstack([velocities, qd])

    def moving(self, q: Array, qd: Array, step: float, steps: int, dry: DryFriction | None = None) -> MovingChain:
        """The arm in motion from a state on, (n,) each; a tick has some short steps (s)."""
        return MovingChain(self._code, (q, qd), step, steps, dry)

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

    def __post_init__(self) -> None:
        for name in ("coulomb", "share"):  # the machine code reads them where they are
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=np.float64))


class _Dry(ctypes.Structure):
    _fields_ = (
        ("coulomb", ctypes.c_void_p),
        ("share", ctypes.c_void_p),
        ("carried", ctypes.c_void_p),
        ("width", ctypes.c_double),
    )


class _Plant(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int32) for name in ("steps", "known", "wait")),
        ("step", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("links", "gravity", "dry", "state")),
    )


class _Code:
    """What moves an arm: the function, its numbers of the links and gravity, and the addresses of all three."""

    def __init__(self, function: Any, links: Array, gravity: Array) -> None:
        self.function, self.kept = function, (links, gravity)
        self.address: int = ctypes.cast(function, ctypes.c_void_p).value or 0
        self.links, self.gravity = links.ctypes.data, gravity.ctypes.data


class MovingChain:
    """An arm that goes on tick by tick.

    Args:
        code: what moves it.
        state: positions and velocities at the beginning, (n,) each.
        step: a short step, of the Runge-Kutta method of fourth order, s.
        steps: short steps in a tick, which has a single one where that is as exact.
        dry: its dry friction; None for none.

    Attributes:
        q: positions, (n,), rad or m.
        qd: velocities, (n,).
        move: address of `int32_t move(void *plant, const double *torque)`.
        plant: address of what it moves.
    """

    def __init__(
        self,
        code: _Code,
        state: tuple[Array, Array],
        step: float,
        steps: int,
        dry: DryFriction | None,
    ) -> None:
        n = len(state[0])
        kept = np.zeros((n + 5, n))  # `struct state`
        kept[0], kept[1] = state
        self.q, self.qd = kept[0], kept[1]
        place, friction = kept.ctypes.data, None
        if dry is not None:
            friction = _Dry(dry.coulomb.ctypes.data, dry.share.ctypes.data, place + 16 * n, dry.width)
        dried = None if friction is None else ctypes.addressof(friction)
        made = _Plant(steps, 0, 0, step, code.links, code.gravity, dried, place)
        self._kept = code, dry, friction, kept, made  # the machine code has their addresses
        self._move, self.move = code.function, code.address
        self.plant = ctypes.addressof(made)

    def advance(self, torque: Array) -> bool:
        """Goes on by a tick under torques of the drives, (n,), that are held; whether the motion is finite."""
        held = np.ascontiguousarray(torque, dtype=np.float64)
        return bool(self._move(ctypes.c_void_p(self.plant), _pointer(held)))


def _numbers(arm: Arm) -> Array:
    """The numbers of all links, (25, n), in the frames whose z axes are the axes of the joints: `struct links`."""
    chain = aligned(arm)
    found = np.empty((len(arm), 25))
    for row, joint, link in zip(found, chain.joints, chain.links, strict=True):
        row[:9], row[9:12] = joint.rotation.ravel(), joint.translation
        row[12:22] = link.parameters
        row[22:] = float(joint.turns), joint.actuator.rotor or 0.0, joint.friction.viscous
    return np.ascontiguousarray(found.T)


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


@cache
def _library(joints: int) -> ctypes.CDLL:
    texts = {name: (_FOLDER / name).read_text() for name in _FILES}
    texts["constants.h"] = f"#define JOINTS {joints}\n"
    subject = "".join([*texts.values(), _processor() if _OWN else ""])
    return load(subject, "chain", lambda: texts, (*_FLAGS, *_OWN))


def _processor() -> str:
    """What this processor can do: machine code that is kept for it is of no use on another one."""
    lines = _PROCESSOR.read_text().splitlines()
    return next((line for line in lines if line.startswith("flags")), "")
