"""How far an identification is, as operators are told."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from msgspec.structs import replace

from dtwin.bus.messages import EVENTS, IDENTIFICATION
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationDecision, IdentificationState
from dtwin.errors import IdentificationError
from dtwin.signals import Event, EventKind

log = logging.getLogger(__name__)
M = TypeVar("M")


class Progress:
    """The state of an identification, published at every change, and told in an event at every phase.

    Args:
        bus: session on which it is published.

    Attributes:
        state: the state.
    """

    def __init__(self, bus: Bus) -> None:
        self.state = IdentificationState("idle", "ready")
        self._phase = ""
        self._publish: Callable[[IdentificationState], None] = bus.publisher(IDENTIFICATION)
        self._tell: Callable[[Event], None] = bus.publisher(EVENTS)

    def request(self, text: str) -> IdentificationState:
        """The state after a request, which the main thread deals with later.

        Args:
            text: what is waited for.

        Raises:
            IdentificationError: another identification is under way.
        """
        self.ensure_free()
        self.state = IdentificationState("measuring", text)
        return self.state

    def ensure_free(self) -> None:
        """Makes sure that no identification is under way.

        Raises:
            IdentificationError: one is.
        """
        if self.state.phase in ("measuring", "estimating"):
            raise IdentificationError(f"an identification is {self.state.phase}; wait for it")

    def decidable(self, decision: IdentificationDecision, model: M | None) -> M:
        """The model that a decision is about.

        Args:
            decision: the decision.
            model: what was identified last, if anything was.

        Raises:
            IdentificationError: none waits for a decision, or it is in doubt and shall be kept all the same.
        """
        state = self.state
        if state.phase != "proposed" or model is None:
            raise IdentificationError(f"no model waits for a decision: the identification is {state.phase}")
        if decision.accept and state.doubts and not decision.anyway:
            raise IdentificationError(
                f"the model is in doubt, {state.doubts}: expected to be kept anyway, or rejected"
            )
        return model

    def decide(
        self,
        decision: IdentificationDecision,
        found: M | None,
        keep: Callable[[M], tuple[Path, str]],
        upload: Callable[[M, str], str],
        time: float,
    ) -> IdentificationState:
        """Does what was decided about the model that was identified last.

        Args:
            decision: the decision.
            found: the model, if anything was identified.
            keep: keeps it; gives its file, and what became of it in words.
            upload: gives it to the controller, for a reason in words; gives what became of that.
            time: plant time, s.

        Raises:
            IdentificationError: as of `decidable`.
            DtwinError: it cannot be kept.
        """
        model = self.decidable(decision, found)
        if not decision.accept:
            self.enter(replace(self.state, phase="rejected", text="the model was not kept"), time)
            return self.state
        path, text = keep(model)
        if decision.upload:
            text = f"{text}, {upload(model, text)}"
        self.enter(replace(self.state, phase="accepted", text=text[:1000], model_file=str(path)), time)
        return self.state

    def enter(self, state: IdentificationState, time: float) -> None:
        """Publishes another state.

        Args:
            state: the state.
            time: plant time, s.
        """
        if state.phase != self._phase:
            self._tell(Event(time, EventKind.IDENTIFICATION, f"{state.phase}: {state.text}"[:1000]))
        self.state, self._phase = state, state.phase
        self._publish(state)
        log.info("%s: %s", state.phase, state.text)
