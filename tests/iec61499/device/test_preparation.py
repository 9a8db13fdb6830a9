"""What takes long in a request keeps no resource waiting, and the requests after it stay in order."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from dtwin.controller.ports import BLOCKS
from dtwin.errors import FunctionBlockError
from iec61499.device import embedded, preparation
from iec61499.device.preparation import Preparation
from iec61499.library import Library
from iec61499.runtime.compile import compile_type
from tests.support.iec61499.networks import Types, chart
from tests.support.iec61499.served_device import DOUBLING, PATIENCE, ServedDevice, build


class Gate:
    """Holds up the calls of a function until it is opened."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.reached = threading.Event()
        self.opened = threading.Event()
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        self.reached.set()
        assert self.opened.wait(PATIENCE)
        return self._function(*arguments)


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Any, str], Gate]]:
    gates = []

    def hold(module: Any, name: str) -> Gate:
        gates.append(Gate(getattr(module, name)))
        monkeypatch.setattr(module, name, gates[-1])
        return gates[-1]

    yield hold
    for held in gates:
        held.opened.set()


@pytest.mark.parametrize(
    ("module", "name"), [(preparation, "compile_type"), (embedded, "Runner")], ids=["CREATE", "START"]
)
def test_a_resource_goes_on_while_another_one_is_compiled(
    served: ServedDevice, gate: Callable[[Any, str], Gate], module: Any, name: str
) -> None:
    with served.client() as client, ThreadPoolExecutor(1) as other:
        build(client, "GOOD", DOUBLING)
        client.start("GOOD")
        held = gate(module, name)

        def built() -> str:
            build(client, "SLOW", "N E_CTU PV=3\nSTART.COLD -> N.CU")
            client.start("SLOW")
            return client.read("SLOW", "N.CV")

        outcome = other.submit(built)
        assert held.reached.wait(PATIENCE)
        with served.connect("S") as peer:
            for number in range(10):
                assert peer.exchange([float(number)]) == (2.0 * number,)
        assert not outcome.done()
        held.opened.set()
        assert outcome.result(PATIENCE) == "1"


def test_requests_of_all_clients_are_carried_out_in_their_order(
    served: ServedDevice, gate: Callable[[Any, str], Gate]
) -> None:
    held = gate(preparation, "compile_type")
    with served.client() as first, served.client() as second, ThreadPoolExecutor(2) as others:
        first.create_block("", "R", "EMB_RES")
        creating = others.submit(first.create_block, "R", "D", "DOUBLER")
        assert held.reached.wait(PATIENCE)
        asking = others.submit(second.blocks, "R")
        held.opened.set()
        creating.result(PATIENCE)
        assert [block.name for block in asking.result(PATIENCE)] == ["START", "D"]


def test_what_is_inside_a_composite_is_prepared_with_it() -> None:
    library = Library([BLOCKS])
    ready = Preparation(library)
    ready.prepare("DIGITAL_TWIN")
    for name in ("DIGITAL_TWIN", "SYSTEM_IDENTIFICATION", "SYS_IDENT_3211SIG", "SERVER_0_1"):
        assert ready.is_ready(name)


def test_only_a_type_that_there_is_takes_time() -> None:
    ready = Preparation(Library([BLOCKS]))
    assert not ready.is_ready("E_CTU")
    assert not ready.is_ready("fb::PATH_PLANNER")
    assert ready.is_ready("NONE")


def test_what_cannot_be_compiled_is_tried_once() -> None:
    wrong = chart("WRONG", "E -> O", "X: DINT -> Q: DINT", {"START": [("Q := NOPE;", "O")]}, [])
    problems = []
    for _ in range(2):
        with pytest.raises(FunctionBlockError, match="NOPE") as problem:
            compile_type(wrong)
        problems.append(problem.value)
    assert problems[0] is problems[1]
    ready = Preparation(Types(wrong))
    ready.prepare("WRONG")
    assert ready.is_ready("WRONG")
