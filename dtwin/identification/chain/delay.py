"""How long before it acts the effort was logged, joint by joint: the delay between command and action.

A command that acts a time d later is what is asked for at t + d: i(t) = u(t + d) / K = (u + d u') / K for delays that
are short against the filter's period. So d is the coefficient of the derivative of the torque that was found,
estimated with all unknowns that act on the joint, so that neither inertia nor friction passes for a delay. It is
told, and not taken into account.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.identification.chain.design import Design
from dtwin.identification.chain.fit import Fit, Prior
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.intervals import convolved, correlation_of, longest_of
from dtwin.identification.chain.moments import Layout, columns
from dtwin.identification.chain.result import NINETY_FIVE, Number, moved, unclear

_LEAST: Final = 1e-3
"""Least delay that is told, s: stamps are no better."""
_UNKNOWN: Final = 0.3
"""Part of the effort that held-out motion leaves unexplained, from which on friction without a word may look late."""
_SURE: Final = 3.0
"""Standard deviations beyond which a delay is told."""


def delays(found: Identification) -> list[Number]:
    """The delay of every joint, s; below 0 where the effort was logged after it had acted, as measured ones are."""
    layout, fit = found.moments.layout, found.found
    numbers = []
    for joint, known in enumerate(found.arm.joints):
        value, deviation = _delay(found.design, layout, found.prior, fit, joint)
        sure = abs(value) > max(_SURE * deviation, _LEAST)
        told = bool(sure) and moved(found, joint) and not unclear(found, joint, _UNKNOWN)
        numbers.append(Number(f"{known.name} delay", value, NINETY_FIVE * deviation, told))
    return numbers


def _delay(design: Design, layout: Layout, prior: Prior, fit: Fit, joint: int) -> tuple[float, float]:
    """The delay of one joint and its standard deviation, s."""
    from scipy.interpolate import CubicSpline  # loaded for a fit alone

    places = layout.of_joint(joint)
    places = places[fit.used[places]]
    parts, efforts = [], []
    for rows in design.rows:
        mine = columns(layout, rows)[:, joint] / fit.gain[joint]
        t = rows.dt * np.arange(len(mine))
        rate = CubicSpline(t, mine @ fit.unknowns)(t, 1)
        parts.append(np.concatenate([mine[:, places], rate[:, None]], axis=1))
        efforts.append(rows.effort[:, joint])
    every, effort = np.concatenate(parts), np.concatenate(efforts)
    size = max(float(np.std(effort - every[:, :-1] @ fit.unknowns[places])), 1e-12)
    known = np.zeros((len(places) + 1, len(places) + 1))
    known[:-1, :-1] = prior.precision(places)
    share = min(1.0, 2.0 * design.filtering.cutoff * design.rows[0].dt)
    weight = share / size**2
    curvature = weight * every.T @ every + known
    scale = 1.0 / np.sqrt(np.diag(curvature) + 1e-300)
    inverse = np.linalg.pinv(curvature * scale * scale[:, None], rcond=1e-12, hermitian=True) * scale * scale[:, None]
    right = weight * every.T @ effort + known @ np.append(prior.mean[places], 0.0)
    solution = inverse @ right
    left = [mine - part @ solution for part, mine in zip(parts, efforts, strict=True)]
    correlation = correlation_of(left, longest_of(design))
    row = inverse[-1]
    meat = sum(_spread(weight * part @ row, correlation) for part in parts) + float(row @ known @ row)
    return float(solution[-1]), float(np.sqrt(meat))


def _spread(weights: Array, correlation: Array) -> float:
    """The variance of a weighted sum of residuals of this correlation."""
    return float(weights @ convolved(correlation, weights[:, None])[:, 0])


def said_of(numbers: list[Number]) -> str:
    """A sentence about the delays that are sure; "" where none is."""
    told = [
        f"{number.name.removesuffix(' delay')} {1e3 * number.value:.1f} +- {1e3 * number.half:.1f} ms"
        for number in numbers
        if number.told
    ]
    if not told:
        return ""
    return f"the effort was logged so long before it acts, which is not taken into account: {', '.join(told)}"
