"""`dtwin monitor LOG --arm NAME`: the first fault of any arm in its own log."""

from __future__ import annotations

import math

from dtwin.api.arm.health import ArmMonitored
from dtwin.monitoring.chain.finding import hidden_in_words
from dtwin.terminal import print_json, printable


def print_first_fault(seen: ArmMonitored, json: bool) -> int:
    """Prints what the monitor made of a log; returns the exit status, 1 with a finding."""
    found, known = seen.finding, seen.arm
    if json:
        finding = None
        if found is not None:
            finding = {"time": found.time, "cause": found.cause, "size": found.size, "others": found.others}
        print_json(
            {
                "arm": known.name,
                "healthy": seen.learned,
                "judged": seen.judged,
                "finding": finding,
                "unobservable": {cause: size if math.isfinite(size) else None for cause, size in seen.hidden.items()},
            }
        )
        return int(found is not None)
    print(printable(f"arm {known.name}: learned in {seen.learned:g} s, judged until {seen.end:g} s"))
    print(printable("nothing is wrong" if found is None else found.text(known)))
    if seen.hidden:
        said = "; ".join(hidden_in_words(known, *each) for each in seen.hidden.items())
        print(printable(f"the last seconds that were judged could not have shown: {said}"))
    return int(found is not None)
