"""A cell of any machine goes on from its state to the bit, and equal cells are equal to the bit."""

import msgspec
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import Drive, Machine, Sensing, Transmission
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Truth, Voltages

EVERYTHING = Machine(
    "everything",
    drive=Drive(lag=(0.004,) * 3, back_emf=(0.1,) * 3, bits=10, dead_zone=(0.1,) * 3, sag=0.02, delay=0.0125),
    transmission=Transmission(
        coulomb=(0.02,) * 3,
        static=(0.03,) * 3,
        presliding=(20.0, 0.0, 30.0),
        rotor_inertia=(0.001,) * 3,
        stiffness=(50.0, 60.0, 0.0),
        backlash=(0.01, 0.005, 0.0),
        ripple=(0.004,) * 3,
        cable=(0.01,) * 3,
    ),
    sensing=Sensing(
        motor_side=(1.0, 0.0, 0.0),
        bits=12,
        noise=0.001,
        noise_kind="correlated",
        spike_rate=1.0,
        spike=0.02,
        loss_rate=2.0,
        delay=0.0125,
    ),
)
FAULTS = ("K2*=0.9@1-3", "lock3@2-2.5", "freeze2@2.2-3", "mu1=0.05@1.5", "drift1+=0.001@1")


def cell(machine: Machine) -> Emulation:
    return Emulation(machine=machine, seed=5, noise=0.001, faults=tuple(map(parse_fault, FAULTS)))


def course(cell: Emulation, commands: list[Voltages]) -> list[tuple[Sensors, Truth]]:
    passed = []
    for command in commands:
        cell.apply(command)
        cell.advance(PERIOD)
        passed.append((cell.read(), cell.truth()))
    return passed


@pytest.mark.parametrize("machine", [EVERYTHING, machine_of("servo"), machine_of("17")], ids=lambda m: m.name)
def test_a_machine_goes_on_from_its_state_to_the_bit(machine: Machine) -> None:
    undisturbed, controller = cell(machine), EmbeddedController()
    commands, states = [], {}
    for tick in range(400):
        if tick in (0, 1, 2, 99, 151, 220, 240, 301):
            states[tick] = msgspec.msgpack.encode(undisturbed.state())
        command = controller.step(undisturbed.read())
        commands.append(command)
        undisturbed.apply(command)
        undisturbed.advance(PERIOD)
    expected = course(cell(machine), commands)
    assert expected[-1] == (undisturbed.read(), undisturbed.truth())
    for tick, state in states.items():
        other = cell(machine)
        other.restore(msgspec.msgpack.decode(state, type=EmulationState))
        assert course(other, commands[tick:]) == expected[tick:], f"from tick {tick}"


def test_the_boxes_do_not_depend_on_the_machine() -> None:
    cells = cell(machine_of("ideal")), cell(EVERYTHING)
    still = [Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)] * 3000
    for tested in cells:
        course(tested, still)
    first, second = ([event for event in c.drain_events() if "arriv" in event.kind] for c in cells)
    assert first == second
    assert first
