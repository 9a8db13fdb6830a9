"""Sums of products of all columns and the effort: what linear least squares needs of the data, and nothing more.

They are kept joint by joint and fold by fold, so that other weights, other gains, other terms and other folds
cost no second pass over the samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array
from dtwin.identification.chain.design import Design, Rows

FOLDS: Final = 5
"""Contiguous parts of every stretch; each judges once what was fitted to the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Where each unknown stands in the vector of unknowns.

    First the inertial parameters of the links, (10 n), then ten of every load, in the frame of the last link, then
    the friction terms of joint 1 to n.

    Attributes:
        joints: number of joints n.
        loads: names of the loads.
        terms: number of friction terms of every joint.
    """

    joints: int
    loads: tuple[str, ...]
    terms: tuple[int, ...]

    @property
    def size(self) -> int:
        return 10 * self.joints + 10 * len(self.loads) + sum(self.terms)

    def of_joint(self, joint: int) -> NDArray[np.intp]:
        """The unknowns that act on a joint: links, loads, and its own friction."""
        mine = self.friction(joint)
        return np.concatenate([np.arange(self.inertial.stop), np.arange(mine.start, mine.stop)])

    @property
    def inertial(self) -> slice:
        """Links and loads together."""
        return slice(0, 10 * (self.joints + len(self.loads)))

    def load(self, name: str) -> slice:
        start = 10 * (self.joints + self.loads.index(name))
        return slice(start, start + 10)

    def friction(self, joint: int) -> slice:
        start = self.inertial.stop + sum(self.terms[:joint])
        return slice(start, start + self.terms[joint])


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums of products.

    Attributes:
        layout: where each unknown stands.
        products: (folds, n, size + 1, size + 1); the last row and column are those of the effort.
        counts: rows in every fold, (folds,).
        share: independent samples among the rows, as the filter leaves only 2 x corner of them a second.
    """

    layout: Layout
    products: Array
    counts: Array
    share: float

    def without(self, fold: int | None) -> tuple[Array, float]:
        """The products (n, size + 1, size + 1), not to be changed, and the number of rows without one fold."""
        if fold not in self._sums:
            kept = [k for k in range(len(self.counts)) if k != fold]
            self._sums[fold] = self.products[kept].sum(axis=0), float(self.counts[kept].sum())
        return self._sums[fold]

    def block(self, products: Array, joint: int, used: Array) -> tuple[NDArray[np.intp], Array]:
        """The unknowns that are used and act on a joint, (k,), and its products with them and the effort.

        Args:
            products: (n, size + 1, size + 1), such as those of `without`.
            joint: number of the joint.
            used: which unknowns are used, (size,).

        Returns:
            Places of the unknowns, and the matrix (k + 1, k + 1), whose last row and column are those of the effort.
        """
        places = self.layout.of_joint(joint)
        places = places[used[places]]
        ends = np.append(places, self.layout.size)
        return places, products[joint, ends[:, None], ends]

    @cached_property
    def _sums(self) -> dict[int | None, tuple[Array, float]]:
        return {}


def layout_of(design: Design) -> Layout:
    loads = tuple(dict.fromkeys(rows.load for rows in design.rows if rows.load))
    return Layout(len(design.arm), loads, tuple(len(names) for names in design.names))


def columns(layout: Layout, rows: Rows) -> Array:
    """All columns of all unknowns, (N, n, size): effort in N m (N) for a value of 1."""
    samples, n, _ = rows.rigid.shape
    found = np.zeros((samples, n, layout.size))
    found[:, :, : 10 * n] = rows.rigid
    if rows.load:  # what is held firmly moves as a part of the last link does
        found[:, :, layout.load(rows.load)] = rows.rigid[:, :, -10:]
    for joint, terms in enumerate(rows.terms):
        found[:, joint, layout.friction(joint)] = terms
    return found


def moments_of(design: Design, by_speed: bool = False) -> Moments:
    """The sums of products of a design.

    Args:
        design: the equations.
        by_speed: whether a fold is a band of the joint's own speed, instead of a part of every stretch; as many rows
            are in each.
    """
    layout = layout_of(design)
    n, size = layout.joints, layout.size
    products, counts = np.zeros((FOLDS, n, size + 1, size + 1)), np.zeros(FOLDS)
    for rows in design.rows:
        every = np.concatenate([columns(layout, rows), rows.effort[:, :, None]], axis=2)
        for joint in range(n):
            order = np.arange(len(every))
            if by_speed:
                order = np.argsort(np.abs(_speed(design, rows, joint)), kind="stable")
            parts = np.array_split(order, FOLDS)
            places = np.append(layout.of_joint(joint), size)
            mine = np.ascontiguousarray(every[:, joint, places])
            for fold, part in enumerate(parts):
                block = mine[part]
                products[fold, joint, places[:, None], places] += block.T @ block
        counts += [len(part) for part in np.array_split(np.arange(len(every)), FOLDS)]
    dt = float(np.median([rows.dt for rows in design.rows]))
    return Moments(layout, products, counts, min(1.0, 2.0 * design.filtering.cutoff * dt))


def _speed(design: Design, rows: Rows, joint: int) -> Array:
    """Velocity of a joint, filtered as the effort is, (N,)."""
    found: Array = rows.terms[joint][:, design.names[joint].index("viscous")]
    return found
