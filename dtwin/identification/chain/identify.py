"""From measurements of an arm to its parameters, with intervals and what the data do not tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.errors import IdentificationError
from dtwin.identification.chain.consistency import nearest_possible
from dtwin.identification.chain.design import Design, Filtering, Rigid, Smooth, rigid_of, rows_of, scales_of, smooth
from dtwin.identification.chain.fit import Fit, Prior, fit, squares
from dtwin.identification.chain.friction import CANDIDATES, Group
from dtwin.identification.chain.intervals import covariance_of, inverse
from dtwin.identification.chain.moments import FOLDS, Moments, columns, layout_of, moments_of
from dtwin.identification.chain.prior import USUAL, constant_of, likeliest, prior_of
from dtwin.measurements.measurement import Measurement

_BETTER: Final = 0.99
"""Held-out error, relative to that without, below which a group of terms has proved itself."""
_SESSION: Final = 0.01
"""Relative standard deviation of a drive's constant between sessions: 0.1 % a kelvin for usual magnets, 10 K."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A measurement and what the arm held meanwhile.

    Attributes:
        measurement: the measurement; rows in which its gripper is closed count beside what a mass at the tool
            explains, as nobody has weighed what it holds then, unless the load says what that is.
        load: name of the load; "" for an empty hand.
    """

    measurement: Measurement
    load: str = ""

    def stretches(self, filtering: Filtering, held: bool = False) -> list[Smooth]:
        """The stretches of the measurement, as `smooth` finds them."""
        measured = replace(self.measurement, gripped=None) if self.load else self.measurement
        return smooth(measured, filtering, held)


@dataclass(frozen=True, slots=True)
class Settings:
    """How an arm is identified.

    Attributes:
        masses: mass of each load that was weighed, kg, by its name; others are found.
        groups: friction terms beside the basic ones; None lets held-out motion choose.
        filtering: how measurements are cleared of noise.
    """

    masses: Mapping[str, float] = field(default_factory=dict)
    groups: tuple[Group, ...] | None = None
    filtering: Filtering = field(default_factory=Filtering)


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """How sure an estimate is with what was known before.

    Attributes:
        prior: what was known before.
        covariance: of the used unknowns, then of the logarithms of the gains.
        guessed: the part of it that comes from how far bodies may be from the data sheet.
    """

    prior: Prior
    covariance: Array
    guessed: Array


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """An identified arm.

    Attributes:
        arm: the arm with the parameters that were found; each link is a body that can be.
        design: the equations.
        moments: their sums.
        prior: what was known before.
        away: how far the arm is from its data sheet, in parts of its tolerances; None where these say nothing.
        found: the estimate, with bodies that can be.
        plain: the estimate before that.
        bands: what leaving out one band of every joint's speed would change of the unknowns and of the logarithms of
            the gains, (bands, size + n).
        covariance: of the used unknowns, then of the logarithms of the gains.
        alone: how sure the data alone would make of it, with bodies and friction that are told widely.
        groups: friction terms that proved themselves.
        held_out: error of each choice of groups on motion that it was not fitted to, in parts of the effort, (n,).
    """

    arm: Arm
    design: Design
    moments: Moments
    prior: Prior
    away: float | None
    found: Fit
    plain: Fit
    bands: Array
    covariance: Array
    alone: Spread
    groups: tuple[Group, ...]
    held_out: Mapping[tuple[Group, ...], Array]

    def deviation(self, position: int) -> float:
        """Standard deviation of an unknown; inf where it was not used."""
        used = np.flatnonzero(self.found.used)
        place = np.searchsorted(used, position)
        if place >= len(used) or used[place] != position:
            return float("inf")
        return float(np.sqrt(self.covariance[place, place]))

    def combined(self, weights: Array) -> tuple[float, float]:
        """A weighted sum of the unknowns, (size,) weights, and its standard deviation.

        Friction has a form which no terms have, and what that misses is the same whenever a joint is as fast, so that
        no correlation in time shows it. The unknowns would change with the speeds that are looked at (Hausman 1978),
        which the jackknife over bands of speed counts, beside what the correlation in time makes of them.
        """
        deviation = np.hypot(
            self._deviation(weights, self.covariance), _jackknife(self.bands[:, : len(weights)] @ weights)
        )
        return float(weights @ self.found.unknowns), float(deviation)

    def by_data(self, weights: Array) -> float:
        """Standard deviation of a weighted sum of the unknowns, (size,) weights, as the data alone would tell it."""
        form = _jackknife(self.bands[:, : len(weights)] @ weights)
        return float(np.hypot(self._deviation(weights, self.alone.covariance), form))

    def guess(self, weights: Array) -> float:
        """The part of its variance that is the guess of bodies, which are told widely.

        Motion tells some bodies only together (base parameters, Gautier and Khalil 1990): how the sum is shared among
        them is as wide as it was guessed, far wider than arms of one kind differ.
        """
        share = self._deviation(weights, self.alone.guessed) / max(self.by_data(weights), 1e-150)
        return share * share

    def _deviation(self, weights: Array, covariance: Array) -> float:
        used = np.flatnonzero(self.found.used)
        inner = covariance[: len(used), : len(used)]
        variance = float(weights[used] @ inner @ weights[used])
        return max(variance, 0.0) ** 0.5

    def gain_deviations(self) -> Array:
        """Relative standard deviations of the gains, (n,); the form of friction counts as in `combined`."""
        n = len(self.arm)
        deviations: Array = np.hypot(np.sqrt(np.diag(self.covariance)[-n:]), _jackknife(self.bands[:, -n:]))
        return deviations

    def carried(self, load: str = "") -> Array:
        """Inertial parameters of the links, the last one with what it holds, (10 n,)."""
        return _with_load(self.moments, self.found, load)

    def load(self, name: str) -> tuple[float, float]:
        """Mass of a load and its standard deviation, kg; drives that warm up from session to session are in it."""
        weights = np.zeros(self.moments.layout.size)
        weights[self.moments.layout.load(name).start] = 1.0
        mass, deviation = self.combined(weights)
        return mass, float(np.hypot(deviation, _SESSION * mass))

    def predicted(self, measurement: Measurement, load: str = "") -> tuple[Array, Array]:
        """Effort of another measurement as measured and as predicted, both filtered, (N, n), N m (N)."""
        design = self.design
        carried = _with_load(self.moments, self.found, load)
        rows = [
            rows_of(rigid, stretch, design.scales, design.filtering, measurement.source, load, carried)[0]
            for stretch in Sample(measurement, load).stretches(design.filtering)
            for rigid in (rigid_of(self.arm, stretch, design.scales, design.filtering),)
        ]
        if not rows:
            raise IdentificationError(f"{measurement.source}: expected a longer stretch without a gap")
        layout = self.moments.layout
        expected = [columns(layout, row) @ self.found.unknowns for row in rows]
        return np.concatenate([row.effort * self.found.gain for row in rows]), np.concatenate(expected)


def _jackknife(changes: Array) -> Array:
    """Standard deviations of what changes so when each of some parts of the data is left out, (parts, ...)."""
    count = len(changes)
    found: Array = np.sqrt((count - 1) / count * np.sum(changes**2, axis=0))
    return found


def unexplained(measured: Array, predicted: Array) -> Array:
    """Root mean square of what is not explained, in parts of the standard deviation of what was measured, (n,)."""
    share: Array = np.sqrt(np.mean((measured - predicted) ** 2, axis=0)) / measured.std(axis=0)
    return share


def identify(arm: Arm, samples: Sequence[Sample], settings: Settings | None = None) -> Identification:
    """Identifies an arm.

    Args:
        arm: the arm as it is known; its parameters are the prior.
        samples: measurements with what was held.
        settings: how.

    Raises:
        IdentificationError: the measurements do not tell enough, such as currents without any known gain or load.
    """
    settings = settings or Settings()
    _check(arm, samples, settings)
    stretches = [(s, part) for s in samples for part in s.stretches(settings.filtering, held=True)]
    if not stretches:
        raise IdentificationError("expected a stretch of motion without a gap of at least two seconds")
    scales = scales_of([stretch for _, stretch in stretches])
    rigid = [rigid_of(arm, stretch, scales, settings.filtering) for _, stretch in stretches]
    rough, every = moments_of(first := _design(arm, stretches, rigid, settings, None)), _used(first, CANDIDATES)
    away: float | None = USUAL
    while True:
        start = fit(rough, prior_of(first, rough, settings.masses, away), every)
        carried = {sample.load: _with_load(rough, start, sample.load) for sample in samples}
        moments = moments_of(design := _design(arm, stretches, rigid, settings, carried))
        if away != USUAL:
            prior = prior_of(design, moments, settings.masses, away)
            break
        away, prior = likeliest(design, moments, settings.masses, _used(design, CANDIDATES))
        if away == USUAL:
            break
    groups, held_out = _chosen(design, moments, prior, settings)
    found = fit(moments, prior, _used(design, groups))
    bands = _by_band(design, prior, found)
    covariance, _ = covariance_of(design, moments, prior, found)
    wide = prior_of(design, moments, settings.masses)
    alone = Spread(wide, *covariance_of(design, moments, wide, found))
    possible = _possible(moments, prior, found, covariance)
    inertial = possible.unknowns[: 10 * len(arm)]
    new = arm.with_parameters(inertial)
    return Identification(
        new, design, moments, prior, away, possible, found, bands, covariance, alone, groups, held_out
    )


def _check(arm: Arm, samples: Sequence[Sample], settings: Settings) -> None:
    for sample in samples:
        if sample.measurement.q.shape[1] != len(arm):
            got = f"{sample.measurement.q.shape[1]} in {sample.measurement.source}"
            raise IdentificationError(f"expected {len(arm)} joints, as {arm.name} has, got {got}")
        if sample.measurement.kind is None and sample.measurement.effort is not None:
            raise IdentificationError(
                f"{sample.measurement.source}: nobody says the unit of the effort: expected it in a map of columns"
            )
    kinds = {str(sample.measurement.kind) for sample in samples}
    if len(kinds) > 1:
        raise IdentificationError(
            f"expected one kind of effort in all measurements, got {' and '.join(sorted(kinds))}"
        )
    kind = kinds.pop()
    known = all(constant_of(joint.actuator, kind) is not None for joint in arm.joints)
    if kind != "torque" and not known and not settings.masses:
        raise IdentificationError(
            f"the {kind}s have no scale: expected the constant of every actuator in the arm's file, or a "
            "measurement with a load whose mass is known"
        )
    for name in settings.masses:
        if name not in {sample.load for sample in samples}:
            raise IdentificationError(f"load {name!r}: expected a measurement with it")


def _design(
    arm: Arm,
    stretches: Sequence[tuple[Sample, Smooth]],
    rigid: Sequence[Rigid],
    settings: Settings,
    carried: Mapping[str, Array] | None,
) -> Design:
    scales = scales_of([stretch for _, stretch in stretches])
    rows, terms = [], None
    for (sample, stretch), known in zip(stretches, rigid, strict=True):
        by_load = None if carried is None else carried[sample.load]
        source = sample.measurement.source
        row, terms = rows_of(known, stretch, scales, settings.filtering, source, sample.load, by_load)
        if len(row.effort):
            rows.append(row)
    if not rows or terms is None:
        raise IdentificationError("expected motion, but no joint moves")
    names, groups = tuple(t.names for t in terms), tuple(t.groups for t in terms)
    kind = stretches[0][0].measurement.kind or "torque"
    return Design(arm, tuple(rows), names, groups, scales, settings.filtering, kind)


def _with_load(moments: Moments, found: Fit, load: str) -> Array:
    """Inertial parameters of the links, the last one with what it holds, (10 n,)."""
    layout = moments.layout
    carried = found.unknowns[: 10 * layout.joints].copy()
    if load and load in layout.loads:
        carried[-10:] += found.unknowns[layout.load(load)]
    return carried


def _used(design: Design, groups: Sequence[Group]) -> np.ndarray:
    """Which unknowns are estimated with these groups of terms, (size,)."""
    layout = layout_of(design)
    used = np.ones(layout.size, dtype=bool)
    for joint, mine in enumerate(design.groups):
        used[layout.friction(joint)] = [group == "basic" or group in groups for group in mine]
    return used


def _by_band(design: Design, prior: Prior, found: Fit) -> Array:
    """What leaving out each band of speed would change of unknowns and logarithms of gains, (bands, size + n)."""
    moments = moments_of(design, by_speed=True)
    made = [fit(moments, prior, found.used, band, found, gains_too=True) for band in range(len(moments.counts))]
    return np.stack([np.append(one.unknowns - found.unknowns, np.log(one.gain / found.gain)) for one in made])


def _known_groups(design: Design) -> tuple[Group, ...]:
    """Groups of terms that the data sheet has itself, so that they need no proof."""
    joints = design.arm.joints
    known = {"rotor": any(j.actuator.rotor for j in joints), "load": any(j.friction.load for j in joints)}
    return tuple(group for group in CANDIDATES if known.get(group))


def _chosen(
    design: Design, moments: Moments, prior: Prior, settings: Settings
) -> tuple[tuple[Group, ...], dict[tuple[Group, ...], Array]]:
    """The groups of terms that make the error less on motion that they were not fitted to, one after the other."""
    there = {group for groups in design.groups for group in groups}
    if settings.groups is not None:
        return settings.groups, {}
    errors: dict[tuple[Group, ...], Array] = {}
    start = fit(moments, prior, _used(design, ()))

    def error(groups: tuple[Group, ...]) -> float:
        errors[groups] = _held_out(moments, prior, _used(design, groups), start)
        moving = errors[groups][~prior.still] if not prior.still.all() else errors[groups]
        return float(np.exp(np.log(moving).mean()))

    chosen = _known_groups(design)
    best = error(chosen)
    left = [group for group in CANDIDATES if group in there and group not in chosen]
    while left:
        tried = {group: error((*chosen, group)) for group in left}
        group = min(tried, key=lambda name: tried[name])
        if tried[group] > _BETTER * best:
            break
        chosen, best = (*chosen, group), tried[group]
        left.remove(group)
    return chosen, errors


def _held_out(moments: Moments, prior: Prior, used: np.ndarray, start: Fit) -> Array:
    """Error on each fold of what was fitted to the others, in parts of the effort, (n,)."""
    total = np.zeros(moments.layout.joints)
    for fold in range(FOLDS):
        found = fit(moments, prior, used, fold, start)
        total += squares(moments, fold, found)
    effort = moments.products[:, :, -1, -1].sum(axis=0)
    share: Array = np.sqrt(total / effort)
    return share


def _possible(moments: Moments, prior: Prior, found: Fit, covariance: Array) -> Fit:
    """The estimate with bodies that can be, the nearest by what is known of them; the rest goes with it.

    The nearest in the metric of least squares alone would move what is well known: it takes correlated residuals for
    white ones.
    """
    inertial = moments.layout.inertial.stop
    used = np.flatnonzero(found.used)
    estimate = found.unknowns[:inertial]
    start = prior.mean[:inertial].copy()
    for name in moments.layout.loads:
        place = moments.layout.load(name)
        mass = abs(estimate[place.start]) + 1e-3
        start[place] = [mass, 0.0, 0.0, 0.0, *(1e-2 * mass * np.array([1.0, 0.0, 1.0, 0.0, 0.0, 1.0]))]
    precision = inverse(covariance[:inertial, :inertial])
    bodies = nearest_possible(estimate, precision, start)
    change = covariance[:, :inertial] @ precision @ (bodies - estimate)
    unknowns = found.unknowns.copy()
    unknowns[used] += change[: len(used)]
    unknowns[:inertial] = bodies
    gain = found.gain * np.exp(change[len(used) :])
    return Fit(unknowns, gain, found.noise, found.used)
