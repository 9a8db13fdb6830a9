"""Between which values the parameters of a healthy arm lie while it warms, by what its commissioning has seen."""

from __future__ import annotations

import math
from collections.abc import Mapping


def courses(rates: Mapping[str, tuple[float, float]], duration: float) -> dict[str, tuple[float, float]]:
    """Changes between which the parameters of a healthy arm lie, from a cold start to the end of its warming.

    What it has learned is from the end of the log. Before, a parameter went by what was seen from one third to the
    next and, as nothing was seen within the first one, by half as much more. It goes on by what is left of a change
    that gets smaller by the same share in every third, and as far again as it came if it does not get smaller.

    Args:
        rates: rates from the first third of a log to the second, and from there to the last, as shares, 1/s, by name.
        duration: length of that log, s.

    Returns:
        the lowest and the highest change from what was learned, as shares, by name.
    """
    third, found = duration / 3.0, {}
    for name, (first, last) in rates.items():
        came = 1.5 * third * (first + last)
        dies_away = 0.0 < last / first < 1.0 if first else False
        left = third * last * (last / first) / (1.0 - last / first) if dies_away else came
        left = math.copysign(min(abs(left), abs(came)), left)
        found[name] = min(-came, left, 0.0), max(-came, left, 0.0)
    return found
