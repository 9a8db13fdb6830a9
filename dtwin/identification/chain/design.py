"""From measurements to equations: what was measured, cleared of noise, and the columns that explain it.

A linear filter on both sides leaves a linear equation true (Gautier's parallel filtering). So the regressor is made
of positions, velocities and accelerations that are only lightly filtered, and its columns pass the same filter as the
measured effort: neither friction nor acceleration is flattened against the torque. Rows that do not count are 0 on
both sides before the filter, so that they leave no trace in those beside them.

A box that nobody has weighed is one mass at the tool from when the gripper has closed until it opens. What it adds to
the torque of a joint, and to friction that grows with that torque, is taken out of all columns and of the effort,
joint by joint (unknowns of no interest, Frisch and Waugh 1933): motion with a box is often the only one in which a
joint turns the other way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, steiner
from dtwin.arm.differences import rates
from dtwin.equations.rigid import regressor
from dtwin.errors import IdentificationError
from dtwin.identification.chain.friction import Group, Scale, Terms, friction_terms
from dtwin.measurements.measurement import Effort, Measurement

_STEPS: Final = 1e-3
"""Standard deviation of a position that steps of its encoder make, rad or m; the least that `scales_of` tells."""
_STOOD: Final = 1e-3
"""Standard deviation of the position of a joint that stood, in parts of its range, a whole turn or 1 m at most."""
_CLOSING: Final = 0.3
"""Time in which the gripper takes its load up, s."""
_OPENING: Final = 2
"""Rows before it is open, in which the effort may be that of either side."""
_SAME: Final = 1e-6
"""Singular value, in parts of the largest one, below which columns are the same."""


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
        known: rows that count, (N,): by default those in which it is known what the arm carries.
        held: number of what the gripper holds, whose mass nobody knows, (N,), 0 for nothing; None if that is nowhere.
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
    held: NDArray[np.intp] | None = None

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


def smooth(measurement: Measurement, filtering: Filtering, held: bool = False) -> list[Smooth]:
    """The stretches of a measurement that are long enough, on an even grid.

    Args:
        measurement: the measurement.
        filtering: how noise is taken away.
        held: whether rows count in which something is held that nobody has weighed, beside what it explains.

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
    return [_even(part, dt, filtering, held) for part in parts if part.t[-1] - part.t[0] > least]


def _even(part: Measurement, dt: float, filtering: Filtering, held: bool) -> Smooth:
    grid = np.arange(part.t[0], part.t[-1], dt)

    def on_grid(columns: Array) -> Array:
        return np.stack([np.interp(grid, part.t, column) for column in columns.T], axis=1)

    corner = min(filtering.fine * filtering.cutoff, 0.4 / dt)
    q = low_passed(on_grid(part.q), dt, corner, 2)
    v = rates(q, dt) if part.v is None else low_passed(on_grid(part.v), dt, corner, 2)
    a = rates(v, dt)
    assert part.effort is not None
    warm = None if part.temperature is None else on_grid(part.temperature)
    motor, command = (
        None if c is None else low_passed(on_grid(c), dt, corner, 2) for c in (part.motor, part.command)
    )
    known = numbers = None
    if part.gripped is not None:
        laden = _laden(part.gripped, part.t, grid)
        known = ~laden
        if held:
            numbers, counts = numbered(laden, dt)
            known |= counts & np.isfinite(on_grid(part.effort)).all(axis=1)
    effort = on_grid(np.nan_to_num(part.effort))
    return Smooth(dt, q, v, a, effort, warm, float(part.t[0]), motor, command, known, numbers)


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
        point: what a kilogram at the tool asks before the filter, (N, n).
    """

    full: Array
    kept: np.ndarray
    every: int
    filtered: Array
    point: Array


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
    mass = np.array([1.0, *arm.tool, *steiner(arm.tool)[np.tril_indices(3)]])
    return Rigid(full, kept, every, filtered, full[:, :, -10:] @ mass)


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
    torques = None if carried is None else rigid.full @ carried
    sizes = None if torques is None else np.abs(torques)
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
    if stretch.held is None or not stretch.held.any():
        return made, terms
    senses = np.stack([term.values[:, term.names.index("coulomb")] for term in terms], axis=1)
    parts = [rigid.point] if torques is None else [rigid.point, rigid.point * np.sign(torques) * senses]
    return beside_loads(made, parts, stretch.held, through), terms


def _moving(stretch: Smooth, scales: Sequence[Scale], filtering: Filtering) -> np.ndarray:
    """Numbers of the rows from the first to the last motion, without what the filter does at the ends."""
    speed = np.abs(low_passed(stretch.v, stretch.dt, filtering.cutoff))
    usual = np.array([scale.speed for scale in scales])
    moves = np.flatnonzero((speed > filtering.standstill * usual).any(axis=1))
    edge = round(filtering.edge / filtering.cutoff / stretch.dt)
    if not len(moves):
        return np.arange(0)
    return np.arange(max(moves[0], edge), min(moves[-1], len(speed) - edge))


def numbered(laden: NDArray[np.bool_], dt: float) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Number of what is held, (N,), 0 for nothing, and whether it is held firmly, (N,).

    Args:
        laden: whether the gripper is closed, (N,).
        dt: time between two rows, s.
    """
    since = _run(laden)
    left = _run(laden[::-1])[::-1]
    numbers = np.where(laden, np.cumsum(laden & (since == 1)), 0)
    return numbers, laden & (since > round(_CLOSING / dt)) & (left > _OPENING)


def _run(laden: NDArray[np.bool_]) -> NDArray[np.intp]:
    """How many rows up to each one and with it are laden, (N,)."""
    index = np.arange(1, len(laden) + 1)
    found: NDArray[np.intp] = index - np.maximum.accumulate(np.where(laden, 0, index))
    return found


def beside_loads(
    rows: Rows, parts: Sequence[Array], held: NDArray[np.intp], through: Callable[[Array], Array]
) -> Rows:
    """The equations without what loads explain of them.

    Args:
        rows: the equations after the filter.
        parts: what a kilogram adds to every joint before the filter, (N, n) each.
        held: number of what is held, (N,).
        through: the filter, to the rows that are left.
    """
    each = held[:, None] == np.unique(held[held > 0])
    rigid, effort, terms = rows.rigid.copy(), rows.effort.copy(), []
    for joint, friction in enumerate(rows.terms):
        loads = np.concatenate([through(part[:, joint, None] * each) for part in parts], axis=1)
        loads = loads[:, np.any(loads != 0.0, axis=0)]
        left, sizes, _ = np.linalg.svd(loads / np.linalg.norm(loads, axis=0), full_matrices=False)
        base = left[:, sizes > _SAME * max(sizes.max(initial=0.0), _SAME)]
        rigid[:, joint] -= base @ (base.T @ rigid[:, joint])
        effort[:, joint] -= base @ (base.T @ effort[:, joint])
        terms.append(friction - base @ (base.T @ friction))
    return replace(rows, rigid=rigid, terms=tuple(terms), effort=effort)
