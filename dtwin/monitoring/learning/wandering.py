"""How the parameters of a healthy arm change while it works, as those of motors and gears do that warm.

The log is watched with parameters that may wander ten times as fast as they usually do, and what they are at the ends
of its thirds is compared. What has changed by more than the estimate's own doubt was no error of the identification:
the arm itself changes, and goes on changing. The monitor lets such a parameter wander as fast as it was seen to, so
that it is followed and not reported.

A change that dies away as that of a body that warms, by the same share in every third, tells how long it goes on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Final

from dtwin.identification.machine.record import LEARNED, Healthy
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.layout import ARM_NAMES, INDEX
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream
from dtwin.parameters import PERIOD

FAST: Final = 2e-3
"""Standard deviation, as a share, that a parameter may gain in one second while its changes are looked for."""
LEAST: Final = 0.01
"""Smallest share by which a parameter has changed in a third of a log that is told. It and SURE were chosen on three
healthy machines, 905511, 3001 and 3002, which tell of no change, and on 3001 with bearings that warm, which tells of
all three D."""
SURE: Final = 4.0
"""Standard deviations by which it has to have changed."""
SHORTEST: Final = 180.0
"""Shortest log whose thirds are compared, s."""
_MOST: Final = 3600.0
"""Longest time that is told, s."""
_WATCHED: Final = tuple(name for name in LEARNED if name in ARM_NAMES)


def wandered(belief: Belief, seen: Stream) -> dict[str, tuple[float, float]]:
    """At what rates parameters have changed from the first third to the second, and from there to the last.

    Args:
        belief: the arm as it was identified, with what its model lacks.
        seen: what sensors and commands said of the healthy arm at work.

    Returns:
        these rates, as shares, 1/s, of the parameters that certainly changed; none of a log shorter than SHORTEST.
    """
    if len(seen) * PERIOD < SHORTEST:
        return {}
    third = len(seen) / 3 * PERIOD
    fast = FAST / math.sqrt(60.0)
    monitor = Monitor(replace(belief, rates=dict.fromkeys(_WATCHED, (fast, fast))))
    monitor.threshold = math.inf
    known: list[dict[str, tuple[float, float]]] = []
    for k in range(3):
        seen.feed(monitor, k * len(seen) // 3, (k + 1) * len(seen) // 3)
        estimator = monitor.estimator
        known.append({name: (float(estimator.x[INDEX[name]]), estimator.deviation(name)) for name in _WATCHED})
    found = {}
    for name in _WATCHED:
        about = max(abs(belief.arm.get(name)), 1e-9)
        changes, sure = [], False
        for before, after in pairwise(known):
            (was, unsure), (now, doubt) = before[name], after[name]
            changes.append((now - was) / about)
            sure = sure or abs(now - was) > max(SURE * math.hypot(unsure, doubt), LEAST * about)
        if sure:
            found[name] = changes[0] / third, changes[1] / third
    return found


def longer(rates: Mapping[str, tuple[float, float]], duration: float) -> float | None:
    """For how long an arm has to go on working until nothing changes by LEAST in a third of the time watched.

    Args:
        rates: what `wandered` found, by name.
        duration: length of the log that it found them in, s.

    Returns:
        that time, s; None where the changes do not die away.
    """
    third, thirds = duration / 3.0, 0.0
    for first, last in rates.values():
        if abs(last) * third <= LEAST:
            continue
        if abs(last) >= abs(first) or first * last < 0.0:
            return None
        thirds = max(thirds, math.log(abs(last) * third / LEAST) / math.log(first / last))
    time = math.ceil(thirds) * third
    return time if time <= _MOST else None


def warmed(healthy: Healthy) -> str:
    """What a person should know of an arm that changed while it was watched, "" if it did not."""
    if not healthy.rates:
        return ""
    third, more = healthy.duration / 3.0, longer(healthy.rates, healthy.duration)
    told = ", ".join(f"{name} by {100 * last * third:+.1f} %" for name, (_, last) in healthy.rates.items())
    advice = "it is warm by now: watch it once more, for lower thresholds"
    if more is None:
        advice = "that does not die away: watch it for twice as long"
    elif more:
        advice = f"let it work for {more / 60.0:.0f} minutes more, and watch it then"
    seen = f"the arm changed while it was watched, in the last {third:.0f} s {told}"
    return f"{seen}, which the monitor allows for; {advice}"
