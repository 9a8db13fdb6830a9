"""The proposals of an AI at the simulation service: checked on the twin, kept, and decided by a person."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from contextlib import AbstractContextManager

from dtwin.bus.messages import DECIDE_PROPOSAL, LOOK, PROPOSE
from dtwin.bus.proposals.messages import Effect, Look, LookRequest, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.controller.bounds import check_model
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.simulation.checks import ExpectedTracking, Refused
from dtwin.simulation.proposals.book import Book, check_form
from dtwin.simulation.upload import Proposal as Change
from dtwin.simulation.upload import Uploader


class Proposing:
    """Answers who looks, who proposes, and who decides. It has no way to the controller.

    Args:
        book: the book of proposals.
        lock: held while the uploader is used.
        there: gives the uploader, or raises CommunicationError while there is none.
        time: gives the plant time, s.
        change: makes the change that an upload stands for.
        now: gives the settings in force as they are told.
        tell: tells everybody of a proposal, in words.
        arm: arm of the cell's record, for the checks; None for the controller's model.
    """

    def __init__(
        self,
        book: Book,
        lock: AbstractContextManager[object],
        there: Callable[[], Uploader],
        time: Callable[[], float],
        change: Callable[[Uploader, UploadRequest], Change],
        now: Callable[[], Upload],
        tell: Callable[[Proposal], None],
        arm: ArmParameters | None,
    ) -> None:
        self._book = book
        self._lock = lock
        self._there = there
        self._time = time
        self._change = change
        self._now = now
        self._tell = tell
        self._arm = arm

    def answer(self, bus: Bus) -> None:
        """Begins to answer."""
        bus.answer(LOOK, LookRequest, None, self._look)
        bus.answer(PROPOSE, ProposalRequest, self._propose)
        bus.answer(DECIDE_PROPOSAL, ProposalDecision, self._decide)

    def _look(self) -> Look:
        with self._lock:
            uploader = self._there()
            return Look(self._now(), self._book.newest(self._time(), uploader.version))

    def _propose(self, asked: ProposalRequest) -> Proposal:
        check_form(asked)
        if asked.kind == "set-up":
            raise ParameterError("set-up: expected one of a line; this is a cell")
        with self._lock:
            uploader = self._there()
            self._book.make_room(self._time(), uploader.version, asked.who)
            effect = None if asked.change is None else self._effect(uploader, asked.change)
            made = self._book.add(asked, effect, self._time())
        self._tell(made)
        return made

    def _decide(self, decision: ProposalDecision) -> Proposal:
        with self._lock:
            uploader = self._there()
            decided = self._book.decide(decision, self._time(), uploader.version)
        self._tell(decided)
        return decided

    def _effect(self, uploader: Uploader, asked: UploadRequest) -> Effect:
        if asked.arm is not None:
            check_model(asked.arm)
        change, arm = self._change(uploader, asked), asked.arm or self._arm
        expected = uploader.try_out(change, arm, asked.late)
        now = self._expected_now(uploader, arm)
        return Effect(
            expected.tracking,
            expected.disk_margin,
            expected.peak_volts,
            tuple(differences(uploader.settings, change.applied(uploader.settings))),
            None if now is None else now.tracking,
            0.0 if now is None else now.disk_margin,
        )

    def _expected_now(self, uploader: Uploader, arm: ArmParameters | None) -> ExpectedTracking | None:
        """The same of the settings in force; None where the checks would refuse them."""
        same = Change("", "", uploader.version, target_time=uploader.settings.target_time)
        try:
            return uploader.try_out(same, arm)
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
