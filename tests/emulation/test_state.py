"""The state of a cell, taken in the middle of a run, brings another cell to the same course, bit by bit."""

import msgspec
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.encoders import NoiseKind
from dtwin.emulation.faults import parse_fault
from dtwin.parameters import PERIOD
from dtwin.signals import BoxCounts, Event, Sensors, Truth, Voltages

COURSE = 1500
"""Number of ticks for which a cell is followed: two fetched boxes."""
FAULTS = (
    "K2*=0.9@3-12",
    "lock3@5-6",
    "drift1+=0.001@4",
    "freeze2@5.5-7",
    "payload*=1.1@2",
    "mu1=0.02@6",
    "late@4.9-6",
    "push1+=0.1@5-5.3",
)


def cell(noise_kind: NoiseKind) -> Emulation:
    faults = tuple(map(parse_fault, FAULTS))
    return Emulation(seed=5, noise=0.003, noise_kind=noise_kind, faults=faults)


Passed = tuple[Sensors, Truth, list[Event], BoxCounts, tuple[float, ...]]


def passed_of(cell: Emulation, command: Voltages) -> Passed:
    """What a tick under a command brings."""
    cell.apply(command)
    cell.advance(PERIOD)
    return cell.read(), cell.truth(), cell.drain_events(), cell.box_counts, cell.placement_errors_mm


MOMENTS = (451, 520, 580, 650, 1700, 4090, 4096)
"""Ticks at which states are taken."""


@pytest.mark.parametrize(("noise_kind", "moments"), [("gaussian", MOMENTS), ("uniform", (650,)), ("none", (520,))])
def test_a_cell_goes_on_from_its_state_to_the_bit(noise_kind: NoiseKind, moments: tuple[int, ...]) -> None:
    undisturbed, controller = cell(noise_kind), EmbeddedController()
    commands: list[Voltages] = []
    states: dict[int, bytes] = {}
    expected: list[Passed] = []
    for tick in range(min(moments[-1] + COURSE, 4500)):
        if tick == 450:
            undisturbed.inject([parse_fault("bias2+=0.01@1-30"), parse_fault("slip@25")])
        if tick in moments:
            states[tick] = msgspec.msgpack.encode(undisturbed.state())
        commands.append(controller.step(undisturbed.read()))
        expected.append(passed_of(undisturbed, commands[-1]))
    assert undisturbed.box_counts.picked > 0
    for tick, state in states.items():
        other = cell(noise_kind)
        other.restore(msgspec.msgpack.decode(state, type=EmulationState))
        assert other.read() == expected[tick - 1][0]
        last = tick + COURSE
        assert [passed_of(other, command) for command in commands[tick:last]] == expected[tick:last], f"from {tick}"
