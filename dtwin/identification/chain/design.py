"""From measurements to equations: what was measured, cleared of noise, and the columns that explain it.

A linear filter on both sides leaves a linear equation true (Gautier's parallel filtering). So the regressor is made
of positions, velocities and accelerations that are only lightly filtered, and its columns pass the same filter as the
measured effort: neither friction nor acceleration is flattened against the torque. Rows in which nobody knows what
the arm carries are 0 on both sides before the filter, so that what is held leaves no trace in those beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.equations.rigid import regressor
from dtwin.errors import IdentificationError
from dtwin.identification.chain.friction import Group, Scale, Terms, friction_terms
from dtwin.measurements.measurement import Effort, Measurement

_STEPS: Final = 1e-3
"""Standard deviation of a position that steps of its encoder make, rad or m; the least that `scales_of` tells."""
_STOOD: Final = 1e-3
"""Standard deviation of the position of a joint that stood, in parts of its range, a whole turn or 1 m at most."""


@dataclass(frozen=True, slots=True)
class Filtering:
    """How measurements are cleared of noise; zero-phase Butterworth filters.

    Attributes:
        cutoff: corner of the filter of both sides of the equations, Hz.
        fine: corner of the filter of positions before they are differentiated, in parts of `cutoff`.
        standstill: speed in parts of a joint's usual one below which all joints count as standing.
        edge: periods of the corner that are cut off at both ends of a stretch.
    """

    cutoff: float = 5.0
    fine: float = 4.0
    standstill: float = 0.03
    edge: float = 2.5


@dataclass(frozen=True, slots=True, eq=False)
class Smooth:
    """One stretch on an even grid.

    Attributes:
        dt: step of the grid, s.
        q: positions, (N, n).
        v: velocities, (N, n).
        a: accelerations, (N, n).
        effort: measured effort, (N, n), as logged.
        temperature: (N, n) or None.
        start: time of the first row in the log, s.
        motor: positions on the motors' side, (N, n), or None.
        command: commanded positions, (N, n), or None.
        known: whether it is known what the arm carries, (N,).
    """

    dt: float
    q: Array
    v: Array
    a: Array
    effort: Array
    temperature: Array | None
    start: float = 0.0
    motor: Array | None = None
    command: Array | None = None
    known: NDArray[np.bool_] | None = None

    def through(self, columns: Array, cutoff: float) -> Array:
        """Columns, (N, ...), of a side of the equations through its filter, with a corner in Hz."""
        if self.known is not None:
            columns = columns * self.known.reshape(-1, *[1] * (columns.ndim - 1))
        return low_passed(columns, self.dt, cutoff)

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Rows of the equations, (N,), that are not 0."""
        return np.ones(len(self.q), dtype=bool) if self.known is None else self.known


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The equations of one stretch after the filter, at the rate that is left: effort = rigid pi + terms c.

    Attributes:
        source: file that it comes from.
        dt: time from row to row, s.
        rigid: columns of the inertial parameters, (N, n, 10 n).
        terms: columns of friction, one array (N, terms) for each joint.
        effort: measured effort, (N, n), as logged.
        load: name of the load in the hand, "" if there is none.
    """

    source: str
    dt: float
    rigid: Array
    terms: tuple[Array, ...]
    effort: Array
    load: str


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """The equations of all measurements.

    Attributes:
        arm: the arm as it is known.
        rows: equations, stretch by stretch.
        names: names of the terms of each joint.
        groups: groups of the terms of each joint.
        scales: what is usual for each joint.
        filtering: how noise was taken away.
        kind: what the effort is.
    """

    arm: Arm
    rows: tuple[Rows, ...]
    names: tuple[tuple[str, ...], ...]
    groups: tuple[tuple[Group, ...], ...]
    scales: tuple[Scale, ...]
    filtering: Filtering
    kind: Effort = "torque"

    @property
    def still(self) -> NDArray[np.bool_]:
        """Joints that stood, (n,), but for steps of their encoders and what their gears yield.

        Their efforts tell nothing: dry friction may be anything up to its limit there.
        """
        reach = [min(j.upper - j.lower, 2.0 * np.pi if j.turns else 1.0) for j in self.arm.joints]
        travel = np.array([scale.travel for scale in self.scales])
        return travel <= np.maximum(_STEPS, _STOOD * np.array(reach))


def smooth(measurement: Measurement, filtering: Filtering) -> list[Smooth]:
    """The stretches of a measurement that are long enough, on an even grid.

    Raises:
        IdentificationError: nothing says how strongly the actuators acted, or rows come too seldom for the filter.
    """
    if measurement.effort is None:
        raise IdentificationError(
            f"{measurement.source}: expected columns of torque, current or voltage; positions alone tell neither "
            "masses nor friction (dtwin health tells what they do tell)"
        )
    dt = measurement.step
    if not dt or 1.0 / dt < 4.0 * filtering.cutoff:
        rate = 1.0 / dt if dt else 0.0
        raise IdentificationError(
            f"{measurement.source}: expected at least {4.0 * filtering.cutoff:g} rows a second for a filter of "
            f"{filtering.cutoff:g} Hz, got {rate:.3g}"
        )
    least = 4.0 * filtering.edge / filtering.cutoff
    parts = [measurement.rows(rows) for rows in measurement.stretches()]
    return [_even(part, dt, filtering) for part in parts if part.t[-1] - part.t[0] > least]


def _even(part: Measurement, dt: float, filtering: Filtering) -> Smooth:
    grid = np.arange(part.t[0], part.t[-1], dt)

    def on_grid(columns: Array) -> Array:
        return np.stack([np.interp(grid, part.t, column) for column in columns.T], axis=1)

    corner = min(filtering.fine * filtering.cutoff, 0.4 / dt)
    q = low_passed(on_grid(part.q), dt, corner, 2)
    v = np.gradient(q, dt, axis=0) if part.v is None else low_passed(on_grid(part.v), dt, corner, 2)
    a = np.gradient(v, dt, axis=0)
    assert part.effort is not None
    warm = None if part.temperature is None else on_grid(part.temperature)
    motor, command = (
        None if c is None else low_passed(on_grid(c), dt, corner, 2) for c in (part.motor, part.command)
    )
    known = None if part.gripped is None else ~_laden(part.gripped, part.t, grid)
    return Smooth(dt, q, v, a, on_grid(part.effort), warm, float(part.t[0]), motor, command, known)


def _laden(gripped: NDArray[np.bool_], t: Array, grid: Array) -> NDArray[np.bool_]:
    """Rows of a grid between or beside samples at which the gripper is closed, or was a sample ago."""
    held = gripped | np.concatenate([gripped[:1], gripped[:-1]])
    found: NDArray[np.bool_] = np.interp(grid, t, held.astype(np.float64)) > 0.0
    return found


def low_passed(columns: Array, dt: float, corner: float, order: int = 4) -> Array:
    """Columns along the first axis through a Butterworth filter, forward and backward."""
    from scipy.signal import butter, sosfiltfilt  # loaded for a fit alone: takes as long as all else of a command

    found: Array = sosfiltfilt(butter(order, corner, fs=1.0 / dt, output="sos"), columns, axis=0)
    return found


def scales_of(stretches: Sequence[Smooth]) -> tuple[Scale, ...]:
    """What is usual for each joint in all stretches."""
    q, v = (np.concatenate([getattr(s, name) for s in stretches]) for name in ("q", "v"))
    warm = [s.temperature for s in stretches if s.temperature is not None]
    means = np.concatenate(warm).mean(axis=0) if warm else np.zeros(q.shape[1])
    speed, travel = np.sqrt(np.mean(v**2, axis=0)), q.std(axis=0)
    return tuple(
        Scale(max(float(s), 1e-3), max(float(d), _STEPS), float(m))
        for s, d, m in zip(speed, travel, means, strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Rigid:
    """What the links ask of one stretch; it does not depend on any parameter.

    Attributes:
        full: columns of the inertial parameters before the filter, (N, n, 10 n).
        kept: numbers of the rows that are left after the filter, (K,).
        every: rows of the stretch from one of them to the next.
        filtered: the columns after the filter, (K, n, 10 n).
    """

    full: Array
    kept: np.ndarray
    every: int
    filtered: Array


def rigid_of(arm: Arm, stretch: Smooth, scales: Sequence[Scale], filtering: Filtering) -> Rigid:
    """What the links ask of one stretch.

    Args:
        arm: chain; its parameters are not looked at.
        stretch: the motion.
        scales: what is usual for each joint.
        filtering: the filter.
    """
    full = regressor(arm, stretch.q, stretch.v, stretch.a)
    every = _every(stretch, filtering)
    kept = kept_of(stretch, scales, filtering)
    filtered = np.zeros((len(kept), *full.shape[1:]))
    for joint in range(len(arm)):  # the links before a joint ask nothing of it
        beyond = slice(10 * joint, None)
        filtered[:, joint, beyond] = stretch.through(full[:, joint, beyond], filtering.cutoff)[kept]
    return Rigid(full, kept, every, filtered)


def kept_of(stretch: Smooth, scales: Sequence[Scale], filtering: Filtering) -> np.ndarray:
    """Numbers of the rows of a stretch that are left after the filter, (K,): moving, whole, known, not too many."""
    moving = _moving(stretch, scales, filtering)[:: _every(stretch, filtering)]
    return moving[stretch.usable[moving]]


def _every(stretch: Smooth, filtering: Filtering) -> int:
    return max(1, int(1.0 / (5.0 * filtering.cutoff * stretch.dt)))


def rows_of(
    rigid: Rigid,
    stretch: Smooth,
    scales: Sequence[Scale],
    filtering: Filtering,
    source: str,
    load: str = "",
    carried: Array | None = None,
) -> tuple[Rows, list[Terms]]:
    """The equations of one stretch.

    Args:
        rigid: what the links ask of it.
        stretch: motion and effort.
        scales: what is usual for each joint.
        filtering: the filter.
        source: file that it comes from.
        load: name of the load in the hand.
        carried: inertial parameters by which the torque is found that each gear carries, (10 n,); None leaves out
            friction that grows with it.

    Returns:
        The equations, and the terms before the filter.
    """
    sizes = None if carried is None else np.abs(rigid.full @ carried)
    terms = [
        friction_terms(
            scale,
            stretch.q[:, j],
            stretch.v[:, j],
            stretch.a[:, j],
            None if sizes is None else sizes[:, j],
            None if stretch.temperature is None else stretch.temperature[:, j],
        )
        for j, scale in enumerate(scales)
    ]

    def through(columns: Array) -> Array:
        return stretch.through(columns, filtering.cutoff)[rigid.kept]

    made = Rows(
        source,
        stretch.dt * rigid.every,
        rigid.filtered,
        tuple(through(t.values) for t in terms),
        through(stretch.effort),
        load,
    )
    return made, terms


def _moving(stretch: Smooth, scales: Sequence[Scale], filtering: Filtering) -> np.ndarray:
    """Numbers of the rows from the first to the last motion, without what the filter does at the ends."""
    speed = np.abs(low_passed(stretch.v, stretch.dt, filtering.cutoff))
    usual = np.array([scale.speed for scale in scales])
    moves = np.flatnonzero((speed > filtering.standstill * usual).any(axis=1))
    edge = round(filtering.edge / filtering.cutoff / stretch.dt)
    if not len(moves):
        return np.arange(0)
    return np.arange(max(moves[0], edge), min(moves[-1], len(speed) - edge))
