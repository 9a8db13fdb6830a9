"""A monitor whose process ended is brought back with what it knew, from what it has heard."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec
import pytest

from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick, JointTicks
from dtwin.bus.messages import TOGETHER, Acted, PassedTick, PassedTicks
from dtwin.bus.twin_messages import AcknowledgeRequest, WatchRequest
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.emulation.faults import parse_fault
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import ArmParameters
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings, run
from dtwin.run.emulate import emulate
from dtwin.run.loop import run as run_loop
from dtwin.run.settings import CellSettings
from dtwin.services.chain import monitoring as chain
from dtwin.services.monitoring import HEARD, Monitoring
from dtwin.services.parts.watching.heard import Heard
from dtwin.signals import Event, StepRecord
from tests.support.disks import full_disk

KINDS = WatchRequest, AcknowledgeRequest
SAID = [WatchRequest("ann", bool(k % 2)) if k % 3 else AcknowledgeRequest(f"K{k}") for k in range(400)]


class Frame:
    """A service's frame, which is its bus too and keeps what is published."""

    def __init__(self) -> None:
        self.bus, self.stopping, self.doing = self, False, ""
        self.inbox: SimpleQueue[object] = SimpleQueue()
        self.told: list[msgspec.Struct] = []

    def publisher(self, topic: object) -> Any:
        return self.told.append

    def subscribe(self, *what: object) -> None:
        pass

    answer = refuse = subscribe

    def report_due(self) -> bool:
        return False

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        yield


def kept(folder: Path, size: int = 1 << 20) -> list[msgspec.Struct]:
    return list(Heard(folder, KINDS, size).entries())


def test_what_is_kept_comes_back_in_order(tmp_path: Path) -> None:
    for half in (SAID[:90], SAID[90:]):
        heard = Heard(tmp_path, KINDS)
        assert list(heard.entries()) == SAID[: SAID.index(half[0])]
        for message in half:
            heard.note(message)
    assert kept(tmp_path) == SAID
    heard.forget()
    heard.note(SAID[0])
    assert kept(tmp_path) == SAID[:1]


def test_the_first_and_the_newest_are_kept_of_more_than_has_room(tmp_path: Path) -> None:
    heard = Heard(tmp_path, KINDS, size=1000)
    for message in SAID:
        heard.note(message)
    found = kept(tmp_path)
    assert len(list(tmp_path.iterdir())) == 3
    first = next(k for k, message in enumerate(found) if message != SAID[k])
    assert first > 10
    assert found[first:] == SAID[-(len(found) - first) :]
    sizes = [path.stat().st_size for path in sorted(tmp_path.iterdir())]
    assert 3000 <= sizes[0] < 3100
    assert max(sizes[1:]) < 1100


@pytest.mark.parametrize("cut", [1, 3, 5, 12])
def test_what_a_kill_left_is_cut_off_and_it_goes_on_behind(tmp_path: Path, cut: int) -> None:
    heard = Heard(tmp_path, KINDS)
    for message in SAID[:10]:
        heard.note(message)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-cut])
    again = Heard(tmp_path, KINDS)
    assert list(again.entries()) == SAID[:9]
    again.note(SAID[50])
    assert kept(tmp_path) == [*SAID[:9], SAID[50]]


def test_a_full_disk_costs_what_it_cannot_take(tmp_path: Path) -> None:
    heard = Heard(tmp_path, KINDS)
    heard.note(SAID[0])
    with full_disk(0):
        heard.note(SAID[1])
    heard.note(SAID[2])
    assert kept(tmp_path) == [SAID[0], SAID[2]]


def thesis_ticks() -> list[PassedTicks]:
    """Twenty seconds of the healthy arm, and three with an encoder that is off."""
    settings = CellSettings(seed=3, noise=0.002, faults=(parse_fault("bias2+=0.05@18"),))
    records: list[StepRecord] = []
    run_loop(emulate(settings), EmbeddedController(settings.control), 2300, record=records.append)
    ticks = []
    for record in records:
        sensors, command = record.sensors, record.voltages
        acted = Acted(command.sequence, command.time, command.volts, command.box_gripped)
        ticks.append(PassedTick(sensors, acted))
    return [PassedTicks(tuple(ticks[k : k + TOGETHER])) for k in range(0, len(ticks), TOGETHER)]


def arm_ticks() -> tuple[ChainSettings, list[JointTicks]]:
    """The same of an arm of two joints, which is learned in the first twenty seconds."""
    settings = ArmCell(arm="planar-2r", machine="2302").settings(36.0, 2302)
    ran = run(replace(settings, faults=(parse_chain_fault("K2*=0.8@28", 2),)))
    ticks = [
        JointTick(
            JointSensors(k, float(t), tuple(ran.q[k].tolist())),
            JointCommands(k, float(t), tuple(ran.command[k].tolist()), tuple(ran.target[k].tolist())),
        )
        for k, t in enumerate(ran.t)
    ]
    return settings, [JointTicks(tuple(ticks[k : k + TOGETHER])) for k in range(0, len(ticks), TOGETHER)]


@pytest.mark.parametrize(("arm", "fault"), [("thesis", "bias2"), ("planar-2r", "K2")])
def test_a_monitor_that_comes_back_knows_what_the_last_one_knew(tmp_path: Path, arm: str, fault: str) -> None:
    settings, ticks = (None, thesis_ticks()) if arm == "thesis" else arm_ticks()

    def service(frame: Any) -> Any:
        if settings is None:
            belief = assumed(ArmParameters(), (0.002, 0.002, 0.002))
            return Monitoring(frame, lambda: Monitor(belief), "the arm", Heard(tmp_path, HEARD))
        return chain.Watching(frame, settings, 20.0, None, Heard(tmp_path, chain.HEARD), None)

    def verdict(of: Any) -> Any:
        return of._watch.monitor.verdict()

    first, frame = service(Frame()), Frame()
    for message in ticks:
        first._take(message)
    assert verdict(first).units["joint 2"].parameter == fault
    again = service(frame)
    again._watch.recall(again._take)
    assert verdict(again) == verdict(first)
    assert [said.kind for said in frame.told if isinstance(said, Event)] == ["restored"], "nothing is told twice"
    again._take(AcknowledgeRequest(fault))
    assert verdict(again).units["joint 2"].parameter == ""
    third = service(Frame())
    third._watch.recall(third._take)
    assert verdict(third) == verdict(again), "what people have said is known, too"
    Heard(tmp_path, HEARD if settings is None else chain.HEARD).note(AcknowledgeRequest("D1"))
    third = service(Frame())
    third._watch.recall(third._take)
    assert verdict(third) == verdict(again), "what was not kept may have been acknowledged"
    third._take(WatchRequest("ann", False))
    fourth = service(Frame())
    fourth._watch.recall(fourth._take)
    assert not fourth._watch.running, "who was stopped does not begin by itself"
    assert verdict(fourth) == verdict(service(Frame())), "and has forgotten the arm"
