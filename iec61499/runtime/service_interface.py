"""What a service interface block does when the embedded runtime executes it (IEC 61499-1, clause 6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

EventHandler = Callable[[Any], None]
"""Executes a block for one event, given its instance."""


@dataclass(frozen=True, slots=True)
class ServiceBehaviour:
    """Behaviour of a service interface block.

    Attributes:
        handlers: the handler of every event input.
        state: further attributes that belong to the instance's state, with the values they start with.
        wiring: further attributes that are no part of its state.
        fire: called when the time comes that the block asked for with `resource__.schedule`.
        prepare: called once for every new instance.
    """

    handlers: Mapping[str, EventHandler] = field(default_factory=dict)
    state: Mapping[str, Any] = field(default_factory=dict)
    wiring: tuple[str, ...] = ()
    fire: EventHandler | None = None
    prepare: EventHandler | None = None
