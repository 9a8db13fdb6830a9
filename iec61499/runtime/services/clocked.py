"""FB_TON, FB_TOF, FB_TP (IEC 61131-3, 6.6.3.5.5, table 46) and E_STOPWATCH, on the resource's clock.

The timers look at the clock when REQ comes: an edge starts the time, and a later REQ sees that it is over.
"""

from __future__ import annotations

from typing import Any, Final

from iec61499.runtime.service_interface import ServiceBehaviour


def _on_delay(s: Any) -> None:
    if s.IN:
        over = _count(s)
        s.Q = s.Q or over
    else:
        s.Q, s.ET, s.start__ = False, 0, None
    s.extend__(s.to__CNF)


def _off_delay(s: Any) -> None:
    if s.IN:
        s.Q, s.ET, s.start__, s.armed__ = True, 0, None, True
    elif s.armed__:
        over = _count(s)
        s.Q = s.Q and not over
    s.extend__(s.to__CNF)


def _pulse(s: Any) -> None:
    if s.start__ is not None and _count(s):
        s.Q, s.start__ = False, None
    if s.start__ is None:
        if s.IN and not s.before__:
            s.Q = not _count(s)
            if not s.Q:
                s.start__ = None
        elif not s.IN:
            s.ET = 0
    s.before__ = s.IN
    s.extend__(s.to__CNF)


def _count(s: Any) -> bool:
    """Lets ET count, from now on when it did not; whether it has reached PT."""
    now = s.resource__.time
    if s.start__ is None:
        s.start__ = now
    elapsed = now - s.start__
    s.ET = min(elapsed, max(s.PT, 0))
    return bool(elapsed >= s.PT)


def _watch_start(s: Any) -> None:
    if s.start__ is None:
        s.start__ = s.resource__.time


def _watch_lap(s: Any) -> None:
    if s.start__ is not None:
        s.TD = s.resource__.time - s.start__
        s.extend__(s.to__ETO)


def _watch_stop(s: Any) -> None:
    if s.start__ is not None:
        s.TD, s.start__ = s.resource__.time - s.start__, None
        s.extend__(s.to__EO)


def _watch_reset(s: Any) -> None:
    s.TD, s.start__ = 0, None
    s.extend__(s.to__RESETO)


BEHAVIOURS: Final = {
    "FB_TON": ServiceBehaviour({"REQ": _on_delay}, {"start__": None}),
    "FB_TOF": ServiceBehaviour({"REQ": _off_delay}, {"start__": None, "armed__": False}),
    "FB_TP": ServiceBehaviour({"REQ": _pulse}, {"start__": None, "before__": False}),
    "E_STOPWATCH": ServiceBehaviour(
        {"START": _watch_start, "ET": _watch_lap, "STOP": _watch_stop, "RESET": _watch_reset}, {"start__": None}
    ),
}
"""Behaviour by type name."""
