"""The state of a cell, taken in the middle of a run, brings another cell to the same course, bit by bit."""

import msgspec
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.faults import parse_fault
from dtwin.parameters import PERIOD
from dtwin.signals import Event, Sensors, Truth, Voltages

FAULTS = ("K2*=0.9@3-12", "lock3@5-6", "drift1+=0.001@4", "freeze2@5.5-7", "payload*=1.1@2", "mu1=0.02@6")


def cell(noise_kind: str) -> Emulation:
    faults = tuple(map(parse_fault, FAULTS))
    return Emulation(seed=5, noise=0.003, noise_kind=noise_kind, faults=faults)  # type: ignore[arg-type]


def course(cell: Emulation, commands: list[Voltages]) -> list[tuple[Sensors, Truth, list[Event]]]:
    passed = []
    for command in commands:
        cell.apply(command)
        cell.advance(PERIOD)
        passed.append((cell.read(), cell.truth(), cell.drain_events()))
    return passed


@pytest.mark.parametrize("noise_kind", ["none", "uniform", "gaussian"])
def test_a_cell_goes_on_from_its_state_to_the_bit(noise_kind: str) -> None:
    undisturbed, controller = cell(noise_kind), EmbeddedController()
    commands, states = [], {}
    for tick in range(4500):
        if tick == 450:
            undisturbed.inject([parse_fault("bias2+=0.01@1-30"), parse_fault("slip@25")])
        if tick in (451, 520, 580, 650, 1700, 4090, 4096):
            undisturbed.drain_events()
            states[tick] = msgspec.msgpack.encode(undisturbed.state())
        command = controller.step(undisturbed.read())
        commands.append(command)
        undisturbed.apply(command)
        undisturbed.advance(PERIOD)
    assert undisturbed.box_counts.picked > 0
    reference, expected = cell(noise_kind), []
    expected += course(reference, commands[:450])
    reference.inject([parse_fault("bias2+=0.01@1-30"), parse_fault("slip@25")])
    expected += course(reference, commands[450:])
    for tick, state in states.items():
        other = cell(noise_kind)
        other.restore(msgspec.msgpack.decode(state, type=EmulationState))
        assert other.read() == expected[tick - 1][0]
        assert course(other, commands[tick:]) == expected[tick:], f"from tick {tick}"
        assert other.box_counts == reference.box_counts
        assert other.placement_errors_mm == reference.placement_errors_mm
