"""The control of a line on eight 4diac FORTEs: the same events as on one resource, also when it is set up anew."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dtwin.line.control import Control, Exchange, OneResource
from dtwin.line.file import line_of
from dtwin.line.plant import LineEvent
from tests.line.test_line_runs import timed, worked
from tests.support.forte import FORTE, NO_FORTE
from tests.support.lockstep import on_fortes

LINE = line_of("default")
MOVED = {**LINE.assignment, "mark": "a1"}
SECONDS = int(os.environ.get("LINE_SECONDS", "80"))


def events(blocks: Exchange) -> list[LineEvent]:
    """What happens in the line, with another set-up in the middle."""
    plant, control = timed(LINE), Control(LINE, blocks)
    control.set_up(LINE.assignment)
    worked(plant, control, SECONDS // 2)
    while not control.set_up(MOVED):
        worked(plant, control, 1)
    worked(plant, control, SECONDS // 2)
    return plant.drain()


@pytest.mark.skipif(not FORTE, reason=NO_FORTE)
def test_a_line_on_fortes_does_what_it_does_here(tmp_path: Path) -> None:
    with on_fortes(LINE, tmp_path) as blocks:
        there = events(blocks)
    assert there == events(OneResource(LINE))
    assert {event.kind for event in there} >= {"loaded", "unloaded", "work", "done"}
