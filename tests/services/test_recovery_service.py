"""The recovery service at a running cell: it proposes and a person approves, or it acts by itself."""

from __future__ import annotations

import pytest

from dtwin.bus.messages import LOOK, SETTINGS, STOP, SettingsInForce, StopState
from dtwin.bus.proposals.messages import Look, Proposal
from dtwin.bus.session import Bus
from dtwin.services.runfile import join
from tests.support.desk import Desk, busy_cell
from tests.support.waiting import until

ALL = ("--monitoring", "--identification", "--simulation", "--noise", "0.002", "--seed", "2", "--pace", "lockstep")


def started(desk: Desk, mode: str) -> None:
    files = ("--history", str(desk.folder / "history.jsonl"), "--store", str(desk.folder / "store"))
    desk.detach(*ALL, "--recovery", mode, *busy_cell(desk.folder), *files)
    desk.until_watched()


def proposals(bus: Bus) -> tuple[Proposal, ...]:
    return bus.ask(LOOK, None, Look).proposals


def test_recovery_proposes_and_does_what_a_person_approves(desk: Desk) -> None:
    started(desk, "propose")
    with join("cell") as bus:
        before = bus.ask(SETTINGS, None, SettingsInForce)
        desk.run("fault", "inject", "bias2+=0.05")
        until(lambda: proposals(bus), "recovery proposes", 120.0)
        assert bus.ask(SETTINGS, None, SettingsInForce) == before
        said = desk.run("mcp", "approve", "1", "--yes", "--who", "carol")
        assert "answer bias2 by recovery: approved, carol" in said
        until(lambda: proposals(bus)[0].outcome, "it is done", 120.0)
        assert proposals(bus)[0].outcome == "uploaded, and its trial passed"
        assert bus.ask(SETTINGS, None, SettingsInForce).encoder_offset[1] == pytest.approx(0.05, abs=2e-3)
        assert bus.ask(STOP, None, StopState).stop == "none"
        assert "by carol: proposal 1 of recovery: bias2 is +" in desk.run("history")


@pytest.mark.thorough
def test_recovery_acts_and_stops_what_it_cannot_answer(desk: Desk) -> None:
    """The test before tries the service, tests/recovery what it decides."""
    started(desk, "act")
    with join("cell") as bus:
        desk.run("fault", "inject", "bias2+=0.05")
        until(lambda: "recovery: bias2 is +" in desk.run("history"), "recovery acts", 120.0)
        desk.run("fault", "inject", "freeze3")
        until(lambda: bus.ask(STOP, None, StopState).stop != "none", "recovery stops the arm", 120.0)
        assert proposals(bus) == ()


def test_recovery_needs_what_it_works_by(desk: Desk) -> None:
    said = desk.up("--recovery", "act", "--monitoring", status=2)
    assert "--recovery: expected --monitoring, --identification and --simulation too" in said
