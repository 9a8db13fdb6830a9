"""What change of an arm its controller stands: margins of every joint's loop, at drawn poses, at rest.

The loop is sampled. The plant is the linearised arm, whose commands are held for a tick. The controller is that of
the block JOINT_FEEDBACK with the mass matrix of CHAIN_LINK, in its linear range. One command is broken at a time
while the other joints stay under control. Where the loop gain is L, a gain margin is the least factor k > 1, or the
largest one below 1, at which 1 + k L = 0 is met on the unit circle; a delay margin is the least time that does so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, without_servos
from dtwin.arm.poses import drawn_poses
from dtwin.controller.chain.application import Control
from dtwin.equations.rigid import inverse_dynamics, mass_matrix
from dtwin.errors import ModelError

_FREQUENCIES: Final = 600
"""Frequencies from the lowest one to half of the sampling rate at which the loop is looked at."""
_LOWEST: Final = 0.05
"""Lowest frequency, rad/s."""

_COARSE: Final = 8
"""Every such frequency is looked at before all of them where a margin is asked for."""

_NOTHING: Final = 1e-12
"""Inertia that counts as none, kg m^2 or kg."""
_SINGULAR: Final = 1e-9
"""Least eigenvalue of a mass matrix whose diagonal is scaled to 1."""


Loop = tuple[Array, Array, Array, Array]
"""Matrices A, B, C and D of a sampled system."""


@dataclass(frozen=True, slots=True, eq=False)
class JointMargins:
    """Margins of one joint, the least over all poses.

    Attributes:
        gain: factor of the drive's constant up to which the loop is stable; inf where none is too large.
        weakest: factor down to which it is stable; 0 where none is too small.
        phase: phase margin, rad.
        delay: further delay of the command, s.
        modulus: least distance of the loop gain from -1.
        stable: whether the loop is stable at every pose.
    """

    gain: float
    weakest: float
    phase: float
    delay: float
    modulus: float
    stable: bool


def margins(arm: Arm, control: Control, poses: int = 16, seed: int = 0, late: int = 0) -> tuple[JointMargins, ...]:
    """The margins of every joint.

    Args:
        arm: the arm; the model in the blocks is the same one.
        control: how it is controlled.
        poses: number of poses that are drawn from the ranges of the joints.
        seed: number of their generator.
        late: ticks from a command until it acts.

    Raises:
        ModelError: a motion of the joints meets no resistance at one of the poses, or a drive has a loop of its own.
    """
    return margins_of(posed_plants(arm, poses, seed, late), control)


@dataclass(frozen=True, slots=True, eq=False)
class PosedPlant:
    """An arm at rest in a pose, of which nothing has to be computed anew for another control.

    Attributes:
        arm: the arm.
        masses: its mass matrix there with the rotors, (n, n), kg m^2.
        plant: from torques to what encoders read, sampled.
        w: frequencies, (N,), rad/s.
        motion: the response of that plant at each of them, (N, n, n).
    """

    arm: Arm
    masses: Array
    plant: Loop
    w: Array
    motion: NDArray[np.complex128]

    def margins(self, control: Control) -> list[JointMargins]:
        """The margins of every joint under a control."""
        stable = self._stable(control)
        return [_margins(loop, self.w, stable) for loop in self._loops(control, slice(None))]

    def keeps(self, control: Control, modulus: float) -> bool:
        """Whether the loop of every joint is stable and nowhere nearer to -1 than a modulus.

        A few frequencies are looked at first, since most controls that do not keep it show so there.
        """
        for which in (slice(None, None, _COARSE), slice(None)):
            if min(_modulus(loop) for loop in self._loops(control, which)) < modulus:
                return False
        return self._stable(control)

    def _stable(self, control: Control) -> bool:
        closed = _closed(self.arm, self.plant, _law(control, self.arm.period), self.masses)
        return bool(np.abs(np.linalg.eigvals(closed)).max() < 1.0)

    def _loops(self, control: Control, which: slice) -> list[NDArray[np.complex128]]:
        """The gain of the loop of each joint while the others are closed, (N,) each.

        With the blocks' K and the plant's P, S = (I - K P)^-1 leads from what is added to the torques to the torques.
        What joint k sees of a torque of its own, while the others are closed, is S_kk = 1 / (1 + L_k) (Skogestad and
        Postlethwaite, 3.2).
        """
        arm, law = self.arm, _law(control, self.arm.period)
        u, friction = (_response(*law[:3], _turned(self.w[which], arm)) + law[3])[:, :, 0].T
        blocks = u[:, None, None] * self.masses + friction[:, None, None] * _viscous(arm)
        seen: NDArray[np.complex128] = np.linalg.inv(np.eye(len(arm)) - blocks @ self.motion[which])
        return [1.0 / seen[:, k, k] - 1.0 for k in range(len(arm))]


def posed_plants(arm: Arm, poses: int, seed: int = 0, late: int = 0) -> list[PosedPlant]:
    """The arm at poses that are drawn; the arguments and the errors are those of `margins`."""
    without_servos(arm, "margins")
    drawn = drawn_poses(arm, poses, np.random.default_rng(seed), 1.0).positions
    rotors = np.diag([joint.actuator.rotor or 0.0 for joint in arm.joints])
    w = np.geomspace(_LOWEST, np.pi / arm.period, _FREQUENCIES)
    found = []
    for q, masses in zip(drawn, mass_matrix(arm, drawn) + rotors, strict=True):
        plant = _plant(arm, q, masses, late)
        found.append(PosedPlant(arm, masses, plant, w, _response(*plant[:3], _turned(w, arm))))
    return found


def margins_of(plants: list[PosedPlant], control: Control) -> tuple[JointMargins, ...]:
    """The margins of every joint of an arm, the least over its poses."""
    return tuple(_least(list(row)) for row in zip(*(plant.margins(control) for plant in plants), strict=True))


def _turned(w: Array, arm: Arm) -> NDArray[np.complex128]:
    """The points of the unit circle at frequencies w, (N,), rad/s."""
    points: NDArray[np.complex128] = np.exp(1j * w * arm.period)
    return points


def _least(found: list[JointMargins]) -> JointMargins:
    return JointMargins(
        min(one.gain for one in found),
        max(one.weakest for one in found),
        min(one.phase for one in found),
        min(one.delay for one in found),
        min(one.modulus for one in found),
        all(one.stable for one in found),
    )


def _check_masses(arm: Arm, masses: Array) -> None:
    """Raises ModelError if a motion of the joints meets no resistance, such as with links that are points."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(masses), _NOTHING))
    values, vectors = np.linalg.eigh(masses * scale * scale[:, None])
    if values[0] < _SINGULAR:
        joint = arm.joints[int(np.argmax(np.abs(vectors[:, 0])))]
        raise ModelError(
            f"arm {arm.name}: nothing resists a motion of {joint.name} at some poses: expected links with inertia "
            "in the model, or a rotor of the joint in the arm's file"
        )


def _plant(arm: Arm, q: Array, masses: Array, late: int) -> Loop:
    """From torques to what encoders read, both (n,), held for a tick and late by whole ticks.

    States are the positions of the joints, what motors are ahead of those whose gears yield, the velocities of all
    that, and what waits.
    """
    from scipy.linalg import expm  # loaded for margins alone: who checks bounds before each tick needs none

    n = len(arm)
    _check_masses(arm, masses)
    inertia, damping, stiffness, driven, read = _moving(arm, q, masses)
    moving = len(inertia)
    inverse = np.linalg.inv(inertia)
    wide = np.zeros((2 * moving + n, 2 * moving + n))
    wide[:moving, moving : 2 * moving] = np.eye(moving)
    wide[moving : 2 * moving] = np.hstack([-inverse @ stiffness, -inverse @ damping, inverse @ driven])
    flow = expm(wide * arm.period)
    first = 2 * moving
    size = first + late * n
    a, b, c = np.zeros((size, size)), np.zeros((size, n)), np.zeros((n, size))
    a[:first, :first] = flow[:first, :first]
    c[:, :moving] = read
    if not late:
        b[:first] = flow[:first, first:]
        return a, b, c, np.zeros((n, n))
    a[:first, first : first + n] = flow[:first, first:]
    for k in range(late - 1):
        a[first + k * n : first + (k + 1) * n, first + (k + 1) * n : first + (k + 2) * n] = np.eye(n)
    b[-n:] = np.eye(n)
    return a, b, c, np.zeros((n, n))


def _moving(arm: Arm, q: Array, masses: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Inertia, damping and stiffness of what moves, (m, m) each, how torques drive it, (m, n), and encoders read it.

    That are the n joints, and for each whose gear yields what its motor is ahead (Spong 1987). Play is left out.
    """
    n = len(arm)
    still, step = np.zeros((n, n)), 1e-30
    weight = inverse_dynamics(arm, q[None] + 1j * step * np.eye(n), still, still).imag.T / step
    gears = [(k, joint.transmission) for k, joint in enumerate(arm.joints) if joint.transmission is not None]
    ahead = np.eye(n)[:, [k for k, _ in gears]]
    motors = np.hstack([np.eye(n), ahead])  # positions of the motors from those of all that moves
    rotors = np.diag([joint.actuator.rotor or 0.0 for joint in arm.joints])
    none = np.zeros((n, len(gears)))
    inertia = motors.T @ rotors @ motors
    inertia[:n, :n] += masses - rotors
    damping = motors.T @ _viscous(arm) @ motors
    damping[n:, n:] += np.diag([gear.damping for _, gear in gears])
    stiffness = np.block([[weight, none], [none.T, np.diag([gear.stiffness for _, gear in gears])]])
    read = motors.copy()
    for column, (k, gear) in enumerate(gears):
        read[k, n + column] = float(gear.encoder == "motor")
    return inertia, damping, stiffness, motors.T, read


def _law(control: Control, ts: float) -> Loop:
    """From the position of a joint to its acceleration, and to the velocity of its viscous friction, in the blocks.

    The states are TH, OM, SUM, EXPECTED and LAST of JOINT_FEEDBACK.
    """
    delay = control.delay
    kp, ki, kd = control.gains
    pole = np.exp(-ts * control.observer)
    # each row is one quantity, as weights of the states TH, OM, SUM, EXPECTED, LAST and of the input
    th, om, total, expected, last, y = np.eye(6)
    acting = expected + delay / ts * (last - expected)
    moved = th + ts * (om + 0.5 * ts * acting)
    away = y - moved
    th_after = moved + (1.0 - pole**2) * away
    om_after = om + ts * acting + (1.0 - pole) ** 2 / ts * away
    error = -(y + delay * (om_after + 0.5 * delay * expected))
    rate = -(om_after + delay * expected)
    total_after = total + ts * ki * error
    expected_after = kp * error + kd * rate
    states = np.array([th_after, om_after, total_after, expected_after, expected])
    answer = np.array([expected_after + total_after, (kp * error + total_after) / max(kd, 1.0)])
    return states[:, :5], states[:, 5:], answer[:, :5], answer[:, 5:]


def _viscous(arm: Arm) -> Array:
    return np.diag([joint.friction.viscous for joint in arm.joints])


def _closed(arm: Arm, plant: Loop, law: Loop, masses: Array) -> Array:
    """Matrix of plant and blocks together."""
    (a, b, c, _), (f, g, h, j) = plant, law
    one, viscous = np.eye(len(arm)), _viscous(arm)
    fed = np.kron(masses, h[0]) + np.kron(viscous, h[1])
    direct = masses * j[0] + viscous * j[1]
    return np.block([[a + b @ direct @ c, b @ fed], [np.kron(one, g) @ c, np.kron(one, f)]])


def _response(a: Array, b: Array, c: Array, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """C (z - A)^-1 B at every z, (N, p, m), with one Schur form of A for all (Laub 1981, there with Hessenberg's)."""
    from scipy.linalg import schur

    triangle, turn = schur(a, output="complex", check_finite=False)
    right, left = turn.conj().T @ b, c @ turn
    states = np.zeros((len(right), right.shape[1], len(z)), dtype=np.complex128)
    for row in range(len(right) - 1, -1, -1):
        after = np.tensordot(triangle[row, row + 1 :], states[row + 1 :], 1)
        states[row] = (right[row, :, None] + after) / (z - triangle[row, row])
    found: NDArray[np.complex128] = np.einsum("pk,kmn->npm", left, states, optimize=True)
    return found


def _margins(loop: NDArray[np.complex128], w: Array, stable: bool) -> JointMargins:
    """Margins of a loop gain L, whose closed loop is 1 / (1 + L), at frequencies w, rad/s."""
    turns = np.flatnonzero((loop.imag[:-1] * loop.imag[1:] <= 0.0) & (loop.real[:-1] < 0.0))
    parts = loop.imag[turns] / (loop.imag[turns] - loop.imag[turns + 1] + 1e-300)
    sizes = np.abs(loop.real[turns] + parts * (loop.real[turns + 1] - loop.real[turns]))
    below = 1.0 / sizes[sizes > 1.0]
    above = 1.0 / sizes[(sizes > 0.0) & (sizes <= 1.0)]
    size = np.abs(loop)
    crossings = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) <= 0.0)
    phases = np.mod(np.angle(loop[crossings]) + np.pi, 2.0 * np.pi)
    return JointMargins(
        float(above.min(initial=np.inf)),
        float(below.max(initial=0.0)),
        float(np.minimum(phases, 2.0 * np.pi - phases).min(initial=np.pi)),
        float((phases / w[crossings]).min(initial=np.inf)),
        _modulus(loop),
        stable,
    )


def _modulus(loop: NDArray[np.complex128]) -> float:
    return float(np.abs(1.0 + loop).min())
