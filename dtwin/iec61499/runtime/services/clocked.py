"""FB_TON, FB_TOF, FB_TP (IEC 61131-3, 6.6.3.5.5) and E_STOPWATCH, on the resource's clock, as in 4diac FORTE.

The timers look at the clock when REQ comes: an edge starts the time, and a later REQ sees that it is over.
"""

from __future__ import annotations

from typing import Any, Final

from dtwin.iec61499.runtime.service_interface import ServiceBehaviour


def _on_delay(s: Any) -> None:
    if not s.IN:
        s.Q, s.ET, s.start__ = False, 0, None
    elif s.start__ is None:
        s.start__ = s.resource__.time
    else:
        elapsed = s.resource__.time - s.start__
        s.Q = s.Q or elapsed >= s.PT
        s.ET = min(elapsed, s.PT)
    s.extend__(s.to__CNF)


def _off_delay(s: Any) -> None:
    if s.IN:
        s.Q, s.ET, s.start__, s.armed__ = True, 0, None, True
    elif s.armed__ and s.start__ is None:
        s.start__ = s.resource__.time
    elif s.armed__:
        elapsed = s.resource__.time - s.start__
        s.Q = s.Q and elapsed < s.PT
        s.ET = min(elapsed, s.PT)
    s.extend__(s.to__CNF)


def _pulse(s: Any) -> None:
    if s.start__ is not None:
        if s.ET >= s.PT:
            s.Q, s.start__ = False, None
        else:
            s.ET = s.resource__.time - s.start__
    elif s.IN and s.ET == 0:
        s.Q, s.start__ = True, s.resource__.time
    elif not s.IN:
        s.ET = 0
    s.extend__(s.to__CNF)


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
    "FB_TP": ServiceBehaviour({"REQ": _pulse}, {"start__": None}),
    "E_STOPWATCH": ServiceBehaviour(
        {"START": _watch_start, "ET": _watch_lap, "STOP": _watch_stop, "RESET": _watch_reset}, {"start__": None}
    ),
}
"""Behaviour by type name."""
