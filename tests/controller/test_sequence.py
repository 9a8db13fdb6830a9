"""The sequence of a cell, and how a system gets one."""

import math
from collections.abc import Sequence
from typing import cast

import pytest

from dtwin.controller.application import Application
from dtwin.controller.device import ControlLoop, Outcome
from dtwin.controller.ports import BLOCKS, MOTION_SYSTEM, SYSTEM
from dtwin.controller.sequence import AMONG_BODIES, CALLS, SEQUENCES, STRAIGHT, with_sequence
from dtwin.errors import CommunicationError, FunctionBlockError
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.resource import Resource


@pytest.mark.parametrize(("name", "sequence"), [(None, STRAIGHT), *SEQUENCES.items()])
def test_a_system_gets_a_sequence(name: None, sequence: object) -> None:
    library = Library([BLOCKS])
    system = with_sequence(library.load_system(BLOCKS / SYSTEM), name)
    resource = Resource(resource_network(system), library)
    for other in SEQUENCES.values():
        found = {port: resource.read(port) for port in other.inputs()}
        assert (not other.differing(found)) == (other == sequence)


def test_a_system_without_a_sequence_is_named() -> None:
    system = Library([BLOCKS]).load_system(BLOCKS / MOTION_SYSTEM)
    with pytest.raises(FunctionBlockError, match=r"motion\.sys.*no block has the parameter PLANNER\.VIA"):
        with_sequence(system, "among_bodies")


def test_the_blocks_know_every_call() -> None:
    assert AMONG_BODIES.via
    text = (BLOCKS / "PICK_AND_PLACE.fbt").read_text()
    assert f"HELP := {len(CALLS) - 1};" in text
    assert f"HELP := {len(CALLS)};" not in text


class Answering:
    """An application whose sequence calls for help by a number, and whose stop has a number."""

    def __init__(self, help_: float, stop: float) -> None:
        self.help = help_
        self.stop = stop

    def watched(self, names: Sequence[str]) -> list[float]:
        return [0.1, 0.2, 0.3, self.help, self.stop]


@pytest.mark.parametrize("number", [-1.0, 7.0, 1.5, 1e300, math.nan, math.inf])
def test_a_call_for_help_or_a_stop_that_nobody_knows_is_refused(number: float) -> None:
    loop = ControlLoop.__new__(ControlLoop)
    loop._application = cast(Application, Answering(2.0, 3.0))
    assert loop.outcome() == Outcome((0.1, 0.2, 0.3), 2, "torque off")
    loop._application = cast(Application, Answering(number, 0.0))
    with pytest.raises(CommunicationError, match=r"HELP: expected a whole number from 0 to 6"):
        loop.outcome()
    loop._application = cast(Application, Answering(0.0, number))
    with pytest.raises(CommunicationError, match=r"STOP: expected a whole number from 0 to 3"):
        loop.outcome()
