"""Puts what a recorder has missed into its rows, before what passes now."""

from __future__ import annotations

import logging
from typing import Final

from dtwin.bus.messages import (
    ANSWER_BACKLOG,
    BACKLOG_PAGE,
    SAMPLE_BACKLOG,
    AnswerBacklog,
    BacklogRequest,
    Path,
    SampleBacklog,
)
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.services.parts.rows import Rows
from dtwin.signals import Sensors, Voltages

log = logging.getLogger(__name__)

_PATIENCE: Final = 2.0
"""s that an answer may take"""


def catch_up(bus: Bus, rows: Rows, since: int, now: float) -> dict[int, Sensors]:
    """Asks emulator and bridge for what they have published, page by page, up to now.

    Args:
        bus: session on which to ask; what passes meanwhile must wait elsewhere.
        rows: rows that take it.
        since: number of the first sample that is missing.
        now: time of the clock of the rows, s.

    Returns:
        the samples that were caught by their numbers; each may come again with what passes now.
    """
    caught: dict[int, Sensors] = {}
    try:
        while True:
            asked = BacklogRequest(since)
            page = bus.ask(SAMPLE_BACKLOG, asked, SampleBacklog, _PATIENCE)
            if page.sensors:
                _add_page(rows, page, bus.ask(ANSWER_BACKLOG, asked, AnswerBacklog, _PATIENCE), now)
                caught |= {sample.sequence: sample for sample in page.sensors}
                since = page.sensors[-1].sequence + 1
            if len(page.sensors) < BACKLOG_PAGE:
                return caught
    except CommunicationError as error:
        log.warning("what was missed stays missing: %s", error)
        return caught


def _add_page(rows: Rows, page: SampleBacklog, answers: AnswerBacklog, now: float) -> None:
    """Gives a page to the rows in the order in which it was published."""
    truths = {truth.time: truth for truth in page.truths}
    acted = {each.sequence: each for each in page.acted}
    answered: list[Voltages | Path] = [*answers.voltages, *answers.paths]
    for sample in page.sensors:
        rows.sensors(sample, now)
        for answer in answered:
            if answer.sequence == sample.sequence:
                rows.answer(answer, now)
        if sample.time in truths:
            rows.truth(truths[sample.time], now)
        if sample.sequence in acted:
            rows.acted(acted[sample.sequence], now)
