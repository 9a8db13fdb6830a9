"""Whole resources in machine code: timed blocks there, other services in this process, equal to Python to the bit."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from iec61499.errors import FunctionBlockError
from iec61499.management.bootfile import load_boot_file
from iec61499.management.protocol import ManagedBlock
from iec61499.native.hosted import HostedResource
from iec61499.native.resource import NativeResource
from iec61499.runtime.communication import LocalTransport
from iec61499.runtime.resource import Resource
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.networks import Types, network
from tests.support.iec61499.surveys import native_load

pytestmark = needs_compiler

TIMED = """DELAY: E_DELAY; AGAIN: E_RDELAY; CYCLE: E_CYCLE; FAST: E_CYCLE; WATCH: E_STOPWATCH;
C1: E_CTU; C2: E_CTU; C3: E_CTU; C4: E_CTU; LAST: E_T_FF; TRAIN: E_TRAIN"""
EVENTS = """DELAY.EO -> C1.CU; AGAIN.EO -> C2.CU; CYCLE.EO -> C3.CU; FAST.EO -> C4.CU; CYCLE.EO -> DELAY.START;
FAST.EO -> AGAIN.START; C1.CUO -> LAST.CLK; C3.CUO -> WATCH.ET; C2.CUO -> LAST.CLK; TRAIN.EO -> WATCH.START"""
INPUTS = [
    *(f"{block}.{event}" for block in ("DELAY", "AGAIN", "CYCLE", "FAST") for event in ("START", "STOP")),
    *("TRAIN.START", "TRAIN.STOP", "WATCH.START", "WATCH.STOP", "WATCH.RESET"),
]
TIMES = ["DELAY.DT", "AGAIN.DT", "CYCLE.DT", "FAST.DT", "TRAIN.DT"]


@pytest.mark.parametrize("seed", range(8))
def test_timed_blocks_issue_at_the_same_times_in_the_same_order(seed: int) -> None:
    rng = random.Random(seed)
    drawn = network(TIMED, EVENTS)
    both = (HostedResource(drawn, Types()), Resource(drawn, Types()))
    alone = NativeResource(drawn, Types())
    for resource in (*both, alone):
        resource.start()
        resource.write("TRAIN.N", 4)
    for _ in range(150):
        name, time = rng.choice(TIMES), rng.choice([0, 1, 999_999, 1_000_000, 2_500_000, 4_000_000, 2**62])
        event = rng.choice(INPUTS)
        passed = rng.choice([0, 1_000_000, 3_700_000, 20_000_000])
        for resource in (*both, alone):
            resource.write(name, time)
            resource.trigger(event)
            resource.run_until_idle()
            resource.advance(passed)
        assert both[0].states() == both[1].states() == alone.states()
        assert both[0].time == both[1].time == alone.time
        assert both[0].next_timer() == alone.next_timer()
        if (due := both[1].next_timer()) is not None and due < 2**62:
            assert both[0].next_timer() == due
    for resource in (*both, alone):
        resource.stop()
        resource.advance(10_000_000)
        assert resource.next_timer() is None
    assert both[0].states() == both[1].states() == alone.states()


SENDER = """SEND: PUBLISH_2; NAME: STRING2STRING; N: INT2INT; COUNT: E_CTU; SWITCH: E_SWITCH"""
RECEIVER = (
    """GET: SUBSCRIBE_2; NAME: STRING2STRING; N: INT2INT; COUNT: E_CTU; ASK: CLIENT_1_1; A: INT2INT; B: INT2INT"""
)
ANSWERER = """ASKED: SERVER_1_1; SUM: F_ADD; C: INT2INT; R: INT2INT"""


def trio(kinds: Sequence[type[HostedResource | Resource]]) -> list[HostedResource | Resource]:
    """Three resources that talk to one another in process."""
    transport = LocalTransport()
    drawn = [
        network(
            SENDER,
            "NAME.CNF -> N.REQ; N.CNF -> SEND.REQ; SEND.CNF -> COUNT.CU",
            "NAME.OUT -> SEND.SD_1; N.OUT -> SEND.SD_2",
        ),
        network(
            RECEIVER,
            "GET.IND -> NAME.REQ; NAME.CNF -> N.REQ; N.CNF -> A.REQ; A.CNF -> ASK.REQ;"
            "ASK.CNF -> B.REQ; B.CNF -> COUNT.CU",
            "GET.RD_1 -> NAME.IN; GET.RD_2 -> N.IN; N.OUT -> A.IN; A.OUT -> ASK.SD_1; ASK.RD_1 -> B.IN",
        ),
        network(
            ANSWERER,
            "ASKED.IND -> C.REQ; C.CNF -> SUM.REQ; SUM.CNF -> R.REQ; R.CNF -> ASKED.RSP",
            "ASKED.RD_1 -> C.IN; C.OUT -> SUM.IN1; C.OUT -> SUM.IN2; SUM.OUT -> R.IN; R.OUT -> ASKED.SD_1",
        ),
    ]
    return [kind(each, Types(), transport) for kind, each in zip(kinds, drawn, strict=True)]


def scenario(resources: list[HostedResource | Resource], seed: int) -> list[Any]:
    rng = random.Random(seed)
    sender, receiver, answerer = resources
    sender.write("SEND.ID", "a")
    receiver.write("GET.ID", "a")
    receiver.write("ASK.ID", "b")
    answerer.write("ASKED.ID", "b")
    blocks = [(sender, "SEND"), (receiver, "GET"), (receiver, "ASK")]
    for resource, block in (*blocks, (answerer, "ASKED")):
        resource.write(f"{block}.QI", True)
        resource.trigger(f"{block}.INIT")
        resource.run_until_idle()
    seen: list[Any] = []
    for _ in range(60):
        if rng.random() < 0.3:
            resource, block = rng.choice(blocks)
            resource.write(f"{block}.QI", rng.random() < 0.8)
            resource.trigger(f"{block}.INIT")
        sender.write("NAME.IN", rng.choice(["", "text", "\xe4"]))
        sender.write("N.IN", rng.randrange(-(2**15), 2**15))
        sender.trigger("NAME.REQ")
        for _ in range(3):
            for each in resources:
                each.run_until_idle()
        seen.append([each.states() for each in resources])
    return seen


@pytest.mark.parametrize("seed", range(4))
def test_communication_says_and_gives_the_same(seed: int) -> None:
    expected = scenario(trio([Resource, Resource, Resource]), seed)
    assert scenario(trio([HostedResource, HostedResource, HostedResource]), seed) == expected
    assert scenario(trio([Resource, HostedResource, Resource]), seed) == expected
    assert any(state[1]["B"]["OUT"] for state in expected)


def test_what_fails_in_a_service_is_an_error_of_its_event() -> None:
    drawn = network("CHECK: TEST_CONDITION; END: STEST_END", "CHECK.CNF -> END.REQ")
    for resource in (HostedResource(drawn, Types()), Resource(drawn, Types())):
        resource.trigger("CHECK.REQ")
        with pytest.raises(FunctionBlockError, match=r"END.REQ: the test has ended"):
            resource.run_until_idle()
        assert list(resource.checks.failed) == ["CHECK"]
        assert resource.is_idle


def test_a_text_that_is_too_long_is_told() -> None:
    resources = trio([Resource, HostedResource, Resource])
    for resource, block, name in ((resources[0], "SEND", "a"), (resources[1], "GET", "a")):
        resource.write(f"{block}.ID", name)
        resource.write(f"{block}.QI", True)
        resource.trigger(f"{block}.INIT")
        resource.run_until_idle()
    resources[0].write("NAME.IN", "x" * 300)
    resources[0].trigger("NAME.REQ")
    with pytest.raises(FunctionBlockError, match="text of 300 bytes: expected at most 254 in machine code"):
        resources[0].run_until_idle()


def test_it_begins_anew_after_a_reset_and_is_not_changed() -> None:
    drawn = network(
        "START: E_RESTART; CYCLE: E_CYCLE; COUNT: E_CTU", "START.COLD -> CYCLE.START; CYCLE.EO -> COUNT.CU"
    )
    both = (HostedResource(drawn, Types()), Resource(drawn, Types()))
    for resource in both:
        resource.write("CYCLE.DT", 10_000_000)
        resource.start()
        resource.advance(35_000_000)
        assert resource.read("COUNT.CV") == 3
        resource.reset()
        assert (resource.read("COUNT.CV"), resource.next_timer(), resource.time) == (0, None, 35_000_000)
    with pytest.raises(FunctionBlockError, match="machine code stays as it is"):
        both[0].halt_block("CYCLE")


def test_many_events_wait_in_a_wide_network() -> None:
    count = 1200
    blocks = "START: E_RESTART; CYCLE: E_CYCLE; " + "; ".join(f"C{k}: E_CTU" for k in range(count))
    events = "START.COLD -> CYCLE.START; " + "; ".join(f"CYCLE.EO -> C{k}.CU" for k in range(count))
    resource = HostedResource(network(blocks, events), Types())
    resource.start()
    resource.advance(3_000_000)
    assert {resource.read(f"C{k}.CV") for k in range(count)} == {3}


def test_the_load_that_is_measured_is_a_boot_file(tmp_path: Path) -> None:
    file = tmp_path / "load.fboot"
    file.write_text(native_load.boot_file(3, 2.0, 61000))
    commands = load_boot_file(file)
    types = [c.request.subject.type_name for c in commands if isinstance(c.request.subject, ManagedBlock)]
    assert types == ["EMB_RES", "E_CYCLE", "E_CTU", "PUBLISH_1", "E_T_FF", "E_T_FF", "E_T_FF"]
    assert commands[-1].request.action == "START"
    measured = native_load.Measured([0.0] * 99 + [5.0], 200, 0.25)
    assert measured.row() == "100 of 200 | 0.000 | 0.050 | 5.000 | 25 %"
