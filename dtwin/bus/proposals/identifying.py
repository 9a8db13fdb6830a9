"""An identification of a running arm, from its request to the proposed model."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Final

from dtwin.bus.messages import IDENTIFICATION, IDENTIFY
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationRequest, IdentificationState
from dtwin.errors import CommunicationError, IdentificationError

_LOOK: Final = 0.5
"""Longest wait for a published state before the state is asked for, s."""


def identified(
    bus: Bus, request: IdentificationRequest, patience: float, progress: Callable[[IdentificationState], None]
) -> IdentificationState:
    """Asks the identification service for a model, and waits until it proposes one.

    Args:
        bus: session on which is asked.
        request: what is asked for.
        patience: time in which there must be a model, s.
        progress: is told every state on the way.

    Raises:
        CommunicationError: there is no such service, it is busy, or there is no model in time.
        IdentificationError: the data are too poor, or do not come.
    """
    state = bus.ask(IDENTIFY, request, IdentificationState)
    states: SimpleQueue[IdentificationState] = SimpleQueue()
    subscription = bus.subscribe(IDENTIFICATION, IdentificationState, states.put)
    try:
        deadline = time.monotonic() + patience
        while state.phase not in ("proposed", "refused"):
            progress(state)
            if time.monotonic() > deadline:
                raise CommunicationError(f"no model within {patience:g} s; the identification goes on")
            try:
                state = states.get(timeout=_LOOK)
            except Empty:
                state = bus.ask(IDENTIFY, None, IdentificationState)
    finally:
        subscription.end()
    if state.phase == "refused":
        raise IdentificationError(state.text)
    return state
