"""The proposals of an AI at the simulation service: checked on the twin, kept, and decided by a person."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from dtwin.bus.messages import DECIDE_PROPOSAL, LOOK, PROPOSE
from dtwin.bus.proposals.messages import Effect, Look, LookRequest, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.bounds import check_model
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.services.parts.uploading.uploading import Uploading
from dtwin.settings.change import Refused
from dtwin.simulation.checks import Checker, ExpectedTracking
from dtwin.simulation.history import Entry
from dtwin.simulation.proposals.book import Book, check_form
from dtwin.simulation.upload import Uploader


class Proposing:
    """Answers who looks, who proposes, and who decides. It has no way to the controller.

    Args:
        book: the book of proposals.
        uploading: uploads to the controller, whose settings in force proposals are based on.
        checker: checker of uploads.
        time: gives the plant time, s.
        tell: tells everybody of a proposal, in words.
        arm: arm of the cell's record, for the checks; None for the controller's model.
    """

    def __init__(
        self,
        book: Book,
        uploading: Uploading[ControlSettings, Entry, Upload],
        checker: Checker,
        time: Callable[[], float],
        tell: Callable[[Proposal], None],
        arm: ArmParameters | None,
    ) -> None:
        self._book = book
        self._uploading = uploading
        self._checker = checker
        self._time = time
        self._tell = tell
        self._arm = arm

    def answer(self, bus: Bus) -> None:
        """Begins to answer."""
        bus.answer(LOOK, LookRequest, None, self._look)
        bus.answer(PROPOSE, ProposalRequest, self._propose)
        bus.answer(DECIDE_PROPOSAL, ProposalDecision, self._decide)

    def _look(self) -> Look:
        with self._uploading.lock:
            uploader = self._uploading.there()
            return Look(self._uploading.now(), self._book.newest(self._time(), uploader.version))

    def _propose(self, asked: ProposalRequest) -> Proposal:
        check_form(asked)
        if asked.kind == "set-up":
            raise ParameterError("set-up: expected one of a line; this is a cell")
        with self._uploading.lock:
            uploader = self._uploading.there()
            self._book.make_room(self._time(), uploader.version, asked.who)
            effect = None if asked.change is None else self._effect(uploader, asked.change)
            made = self._book.add(asked, effect, self._time())
        self._tell(made)
        return made

    def _decide(self, decision: ProposalDecision) -> Proposal:
        with self._uploading.lock:
            uploader = self._uploading.there()
            decided = self._book.decide(decision, self._time(), uploader.version)
        self._tell(decided)
        return decided

    def _effect(self, uploader: Uploader[ControlSettings, Entry], asked: UploadRequest) -> Effect:
        if asked.arm is not None:
            check_model(asked.arm)
        proposal, arm = self._uploading.proposal(asked), asked.arm or self._arm
        uploader.refuse_outdated(proposal)
        now = uploader.settings
        wished = proposal.change.apply(now)
        expected = self._checker.check(wished, arm or wished.model, late=asked.late, in_force=now)
        usual = self._expected_now(now, arm)
        return Effect(
            expected.tracking,
            expected.disk_margin,
            expected.peak_volts,
            tuple(differences(now, wished)),
            None if usual is None else usual.tracking,
            0.0 if usual is None else usual.disk_margin,
        )

    def _expected_now(self, now: ControlSettings, arm: ArmParameters | None) -> ExpectedTracking | None:
        """The same of the settings in force; None where the checks would refuse them."""
        try:
            return self._checker.check(now, arm or now.model, in_force=now)
        except Refused:
            return None


def differences(before: ControlSettings, after: ControlSettings) -> list[str]:
    """What changes from settings to others, in words, one for each value."""
    pairs: list[tuple[str, float, float]] = [
        ("target time, s", before.target_time, after.target_time),
        ("box, kg", before.payload, after.payload),
    ]
    for field in dataclasses.fields(before.gains):
        old, new = (getattr(each.gains, field.name) for each in (before, after))
        pairs += [(f"{field.name}{joint}", a, b) for joint, (a, b) in enumerate(zip(old, new, strict=True), 1)]
    pairs += zip(PARAMETER_NAMES, before.model.vector(), after.model.vector(), strict=True)
    offsets = zip(before.encoder_offset, after.encoder_offset, strict=True)
    pairs += [(f"offset of encoder {joint}, rad", a, b) for joint, (a, b) in enumerate(offsets, 1)]
    return [f"{name}: {a:.6g} becomes {b:.6g}" for name, a, b in pairs if a != b]
