"""Tools that propose: what they propose is checked, kept, and shown to a person; nothing moves without approval."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from pydantic import Field

from dtwin.ai.marking import marked
from dtwin.ai.station import Station
from dtwin.ai.tools.arguments import Box, FaultNames, Kd, Ki, Kp, ModelName, Offsets, TargetTime, Version, Why
from dtwin.ai.tools.ask import gains_of
from dtwin.bus.messages import LOOK, PROPOSE
from dtwin.bus.proposals.messages import Look, Proposal, ProposalRequest
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.errors import ParameterError
from dtwin.identification.store import ModelStore
from dtwin.monitoring.kinds import KINDS, parse_fault_id
from dtwin.parameters import joint_vector


class Proposing:
    """What an AI can propose to people.

    Args:
        station: where it stands.
    """

    def __init__(self, station: Station) -> None:
        self._station = station

    def propose_settings(
        self,
        why: Why,
        based_on: Version,
        *,
        kp: Kp | None = None,
        ki: Ki | None = None,
        kd: Kd | None = None,
        target_time: TargetTime | None = None,
        assumed_box: Box | None = None,
        model: ModelName | None = None,
        encoder_offset: Offsets | None = None,
    ) -> dict[str, Any]:
        """Proposes gains with or without a target time, or alone a model, the mass of a box, or offsets of encoders.

        The twin checks it first and refuses what has no margins or leaves its path. The answer has what it expects.
        """
        now = self._station.doors.ask(LOOK, None, Look).settings
        change = change_of(self._station, now, why, based_on, (kp, ki, kd), target_time)
        change = msgspec.structs.replace(change, **others_of(self._station, assumed_box, model, encoder_offset))
        return self._made(ProposalRequest(self._station.who, why, "settings", change))

    def propose_answer(self, why: Why, parameters: FaultNames) -> dict[str, Any]:
        """Proposes that recovery answers findings as its table says (`recovery_answer`), which may take a minute."""
        check_findings(parameters)
        return self._made(ProposalRequest(self._station.who, why, "answer", parameters=tuple(parameters)))

    def propose_acknowledgement(self, why: Why, parameters: FaultNames) -> dict[str, Any]:
        """Proposes that the monitor takes the arm as it is to be normal, as far as findings go."""
        check_findings(parameters)
        return self._made(ProposalRequest(self._station.who, why, "acknowledge", parameters=tuple(parameters)))

    def propose_stop(self, why: Why) -> dict[str, Any]:
        """Proposes a safe stop of the arm."""
        return self._made(ProposalRequest(self._station.who, why, "stop"))

    def propose_diagnosis(
        self,
        why: Why,
        text: Annotated[str, Field(min_length=3, max_length=1000, description="What you think is wrong")],
    ) -> dict[str, Any]:
        """Lays a diagnosis in words before a person, who may agree with it; nothing is changed by that."""
        return self._made(ProposalRequest(self._station.who, why, "diagnosis", text=text))

    def _made(self, request: ProposalRequest) -> dict[str, Any]:
        made = self._station.doors.ask(PROPOSE, request, Proposal)
        return {"number": made.number, "state": made.state, "effect": marked(made.effect)}


def change_of(
    station: Station,
    now: Upload,
    why: str,
    based_on: int,
    gains: tuple[list[float] | None, list[float] | None, list[float] | None],
    target_time: float | None,
) -> UploadRequest:
    """A request for other gains and target time in the name of the AI.

    Raises:
        ParameterError: a gain is out of range.
    """
    return UploadRequest(station.who, why, based_on, gains_of(now, *gains), target_time)


def others_of(
    station: Station, box: float | None, model: str | None, encoder_offset: list[float] | None
) -> dict[str, Any]:
    """What else a request may change, by the names of its fields.

    Raises:
        ModelError: there is no such model.
    """
    found: dict[str, Any] = {"payload": box}
    if encoder_offset is not None:
        found["encoder_offset"] = joint_vector(encoder_offset)
    if model is not None:
        arm = ModelStore(station.files.store).load(model).arm
        # No upload compensates the Coulomb friction of a model, but the check knows of it.
        found |= {"model": arm.with_values({f"mu{joint}": 0.0 for joint in (1, 2, 3)}), "arm": arm}
    return found


def check_findings(names: list[str]) -> None:
    """Checks that names are those of findings.

    Raises:
        ParameterError: one is not; the message says which.
    """
    for name in names:
        if parse_fault_id(name).kind not in KINDS:
            raise ParameterError(f"parameter {name}: expected what a finding names; see `findings`")
