"""The judgement of runs of a line whose arms fail."""

from dataclasses import replace

import pytest

from dtwin.errors import DtwinError
from dtwin.line.file import line_of
from dtwin.line.run import LineRun, LineSettings
from dtwin.parameters import ROOT
from evidence.line.expected import Known, expected, scaled_times
from evidence.line.faults import (
    CAUSES,
    LineOutcome,
    LineTrial,
    faults_report,
    kept_promises,
    line_tried,
    soon,
    trials,
)
from evidence.line.otherwise import Otherwise

CELLS = ROOT / "lines" / "cells"

FAILED = LineOutcome(
    LineTrial("default", 0, "a2", "K2*=0.1", 100.0, 2000.0, True), 96.0, 100.0, 97.0, 0.5, "", 0.0, 0, 0, False
)
"""A run with a fault after which the line is as fast as is asked."""
HEALTHY = LineOutcome(
    LineTrial("default", 0, "", "", 0.0, 2000.0, True), 97.5, 120.0, 100.0, None, "", None, 0, 0, False
)
"""A run without one that is as was predicted, though another assignment would be faster."""


@pytest.mark.parametrize("kept", [FAILED, HEALTHY])
def test_what_is_as_asked_passes_and_what_is_not_fails(kept: LineOutcome) -> None:
    assert kept_promises([kept])
    for spoiled in (
        replace(kept, lost=1),
        replace(kept, collisions=1),
        replace(kept, stood=True),
        replace(kept, rate=94.0),
    ):
        assert not kept_promises([kept, spoiled])


def test_a_line_that_is_faster_than_its_twins_say_was_not_predicted() -> None:
    assert not kept_promises([replace(HEALTHY, rate=104.0)])
    assert not kept_promises([replace(FAILED, rate=104.0)])
    short = replace(FAILED.trial, duration=400.0)
    assert kept_promises([replace(FAILED, rate=104.0, trial=short)]), "single boxes decide what it is"


def test_without_twins_a_line_may_stand_but_loses_nothing() -> None:
    alone = replace(FAILED, trial=replace(FAILED.trial, twins=False), rate=0.0, stood=True)
    assert kept_promises([alone])
    assert not kept_promises([replace(alone, lost=1)])


def test_the_page_has_the_best_and_what_was_predicted() -> None:
    text = faults_report([FAILED, HEALTHY]).text
    assert "96.0" in text
    assert "81.2 %" in text
    assert "100.0" in text


def test_an_answer_counts_from_the_fault_or_from_the_first_motion_after_it() -> None:
    late = replace(FAILED, noticed=15.0, moves=12.0)
    never = replace(FAILED, noticed=None, moves=12.0)
    assert [soon([FAILED, late, never, HEALTHY], moving) for moving in (False, True)] == [1, 2]


def test_what_twins_predict_begins_anew_when_the_work_is_shared_out_otherwise() -> None:
    usual = line_of("default")
    run = LineRun(replace(usual, source=replace(usual.source, every=12.0)), LineSettings(160.0, "off"))
    known: list[Known] = []
    while not run.over:
        run.step()
        if run.time > 100.0 and run.work.version == 0:
            moved = {**usual.assignment, "pack": "b1"}
            assert run.floor.control.set_up(moved)
            run.work.adopt(moved, 1)
        if run.time > 70.0 and (not known or known[-1].differs(run)):
            known.append(Known.of(run))
    assert [(round(each.time), each.assignment["pack"]) for each in known] == [(70, "b2"), (100, "b1")]
    assert expected(run.line, known, 160.0) == pytest.approx(run.rate(70.0), rel=0.05)
    slow = replace(known[0], times={name: scaled_times(times, 6.0) for name, times in known[0].times.items()})
    assert expected(run.line, [slow, known[1]], 160.0) > 1.2 * expected(run.line, [slow], 160.0)


@pytest.mark.parametrize("arm", ["planar-2r", "servo-2r", "six-axis"])
def test_a_station_may_have_another_arm_than_the_file_says(arm: str) -> None:
    what = Otherwise(12.0, (("a2", str(CELLS / f"{arm}.toml")),), "71")
    drawn = trials("default", 6, 1, 600.0, 0, (True, False), "slowing", [what])
    assert len(drawn) == 13
    line = line_tried(drawn[0])
    assert line.source.every == 12.0
    plan = next(station for station in line.stations if station.name == "a2")
    assert (plan.machine, plan.cell_file) == ("71", str(CELLS / f"{arm}.toml"))
    assert {trial.station for trial in drawn[1:]} <= {"a1", "b1", "b2"}
    assert {trial.fault for trial in drawn[1:]} <= set(CAUSES["slowing"])


@pytest.mark.parametrize(
    ("station", "words"),
    [
        ("a3", "expected a1, a2, b1 or b2, got 'a3'"),
        ("a2", r"zones\.a\.stations\.a2: source\.mass: expected at most"),
    ],
)
def test_a_cell_that_cannot_be_a_station_is_refused(station: str, words: str) -> None:
    usual = line_of("default")
    heavy = replace(usual, source=replace(usual.source, heaviest=9.0))
    with pytest.raises(DtwinError, match=words):
        Otherwise(cells=((station, str(CELLS / "planar-2r.toml")),)).applied(heavy)
