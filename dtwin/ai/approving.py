"""A proposal to answer findings, carried out by recovery at the session of the person who approves it."""

from __future__ import annotations

from typing import Final

from dtwin.ai.answering import STANDING, Answering
from dtwin.bus.messages import StopRequest
from dtwin.bus.proposals.deciding import Door
from dtwin.bus.proposals.messages import Proposal
from dtwin.bus.session import Bus
from dtwin.bus.stopping import stop
from dtwin.errors import CommunicationError
from dtwin.parameters import ArmParameters
from dtwin.recovery.desk import CriticalFinding, DeadlinePassed, StoppedByController

HEARD: Final = 5.0
"""Plant time in which the monitor has to tell of the findings again, s."""


def answering_door(healthy: ArmParameters | None) -> Door:
    """What carries out such a proposal.

    Args:
        healthy: the healthy arm as it is known; the model in force when None.
    """

    def carry_out(bus: Bus, proposal: Proposal, who: str) -> str:
        answering = Answering(bus, healthy, who)
        names = proposal.request.parameters
        try:
            began = None
            try:
                for _ in answering.desk.messages():
                    began = answering.desk.time if began is None else began
                    found = [answering.desk.findings[name] for name in names if name in answering.desk.findings]
                    if len(found) == len(names):
                        break
                    if answering.desk.time > began + HEARD:
                        raise CommunicationError(f"nothing settled is found of {' and '.join(names)} any more")
                answering.put_into_force()
            except CriticalFinding as critical:
                found = [critical.finding]
            except (StoppedByController, DeadlinePassed) as over:
                raise CommunicationError(str(over)) from None
            came = answering.now(found)
            if came.outcome in STANDING:
                stopped = stop(bus, StopRequest(who, f"proposal {proposal.number}: {came.text}"[:1000]))
                return f"{came.outcome}: {came.text}; stop: {stopped.state.stop}"
            return f"{came.outcome}: {came.text}"
        finally:
            answering.close()

    return carry_out
