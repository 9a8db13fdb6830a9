"""E_RESTART and the timed event blocks of IEC 61499-1, annex A, on the resource's clock.

`due__` is the resource time in ns at which the block issues its event, None while it waits for START. Times shorter
than a tick last a tick, as in 4diac FORTE.
"""

from __future__ import annotations

from typing import Any, Final

from iec61499.runtime.service_interface import ServiceBehaviour


def _start(s: Any) -> None:
    if s.due__ is None:
        _restart(s)


def _restart(s: Any) -> None:
    _stop(s)
    s.due__ = s.resource__.schedule(s.name__, s.DT)


def _stop(s: Any) -> None:
    if s.due__ is not None:
        s.resource__.cancel(s.name__)
        s.due__ = None


def _elapsed(s: Any) -> None:
    s.due__ = None
    s.extend__(s.to__EO)


def _start_cycle(s: Any) -> None:
    if s.due__ is None:
        s.period__ = s.DT
        s.due__ = s.resource__.schedule(s.name__, s.period__)


def _cycle(s: Any) -> None:
    s.due__ = s.resource__.schedule(s.name__, s.period__)
    s.extend__(s.to__EO)


BEHAVIOURS: Final = {
    "E_RESTART": ServiceBehaviour(),
    "E_DELAY": ServiceBehaviour({"START": _start, "STOP": _stop}, {"due__": None}, fire=_elapsed),
    "E_RDELAY": ServiceBehaviour({"START": _restart, "STOP": _stop}, {"due__": None}, fire=_elapsed),
    "E_CYCLE": ServiceBehaviour({"START": _start_cycle, "STOP": _stop}, {"due__": None, "period__": 0}, fire=_cycle),
}
"""Behaviour by type name."""
