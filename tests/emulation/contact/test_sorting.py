"""A cell with contact: what becomes of boxes is read from where they are."""

from collections.abc import Callable

import msgspec
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.sequence import AMONG_BODIES
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.sections import Contact, Machine
from dtwin.errors import FaultError, ParameterError
from dtwin.parameters import PERIOD, PLACES
from dtwin.signals import BoxCounts, Event, EventKind, Sensors, Truth, Voltages

COURSE = 800
"""Number of ticks for which a cell is followed: one fetched box."""
MACHINE = Machine(contact=Contact(enabled=True))


def cell(*faults: str, machine: Machine = MACHINE) -> Emulation:
    return Emulation(machine=machine, seed=0, faults=map(parse_fault, faults))


def controller() -> EmbeddedController:
    return EmbeddedController(ControlSettings(target_time=1.2), sequence=AMONG_BODIES)


def run(cell: Emulation, duration: float, each: Callable[[Emulation, Voltages], None] | None = None) -> list[Event]:
    blocks, events = controller(), []
    for _ in range(round(duration / PERIOD)):
        command = blocks.step(cell.read())
        cell.apply(command)
        cell.advance(PERIOD)
        events += cell.drain_events()
        if each:
            each(cell, command)
    return events


def times(events: list[Event], kind: EventKind) -> list[float]:
    return [event.time for event in events if event.kind == kind]


def test_boxes_arrive_are_picked_and_lie_at_their_places_and_nothing_is_touched() -> None:
    emulation = cell()
    loads = []
    events = run(emulation, 60.0, lambda c, _: loads.append(c.truth().payload_mass))
    counts = emulation.box_counts
    assert counts.picked == counts.delivered == 4
    assert counts.misplaced == counts.held == 0
    assert not times(events, EventKind.COLLISION)
    assert len(emulation.placement_errors_mm) == 4
    assert max(emulation.placement_errors_mm) < 5.0
    assert set(loads) > {0.0}
    assert all(load == 0.0 or 0.19 <= load < 0.21 for load in loads)


def test_the_sensor_sees_a_box_from_its_arrival_until_it_is_lifted() -> None:
    emulation = cell()
    seen: list[tuple[bool, str]] = []

    def look(cell: Emulation, _: Voltages) -> None:
        sample = cell.read()
        if not seen or seen[-1] != (sample.box_present, sample.box_colour):
            seen.append((sample.box_present, sample.box_colour))

    events = run(emulation, 19.0, look)
    assert seen == [(False, ""), (True, "green"), (False, "")]
    arrived, picked = times(events, EventKind.ARRIVED), times(events, EventKind.PICKED)
    assert len(arrived) == len(picked) == 1
    assert picked[0] > arrived[0] + 0.8


def test_a_tray_is_emptied_for_the_next_box() -> None:
    emulation = cell()
    run(emulation, 27.0)
    bodies = emulation.state().bodies
    assert emulation.box_counts.delivered == 1
    assert bodies is not None
    assert [body.order for body in bodies.bodies if body] == [1]


def test_a_jaw_without_voltage_loses_its_box_which_lies_where_it_fell_and_is_reported() -> None:
    emulation = cell("cutgripper@18-22")
    events = run(emulation, 24.0)
    lost = [event for event in events if event.kind == EventKind.SLIPPED]
    assert len(lost) == 1
    assert 18.0 < lost[0].time < 20.0
    assert "was lost by the gripper and lies at (" in lost[0].text
    bodies = emulation.state().bodies
    assert bodies is not None
    assert [str(body.stage) for body in bodies.bodies if body and body.order == 0] == ["lying"]


@pytest.mark.parametrize("fault", ["slip@18", "pads*=0.3@18-20"])
def test_a_box_slips_out_of_weak_pads_and_the_next_one_is_fetched(fault: str) -> None:
    events = run(cell(fault), 40.0)
    assert len(times(events, EventKind.SLIPPED)) == 1
    assert times(events, EventKind.DELIVERED)


def test_a_box_that_falls_back_on_the_belt_comes_again() -> None:
    events = run(cell("slip@16.5"), 26.0)
    (lost,) = times(events, EventKind.SLIPPED)
    first, again = times(events, EventKind.PICKED)[:2]
    assert first < lost < again
    assert [time for time in times(events, EventKind.ARRIVED) if lost < time < again]
    assert times(events, EventKind.DELIVERED)[0] > again


def test_a_box_that_cannot_be_lifted_is_tried_once_more_and_then_help_is_called() -> None:
    emulation, blocks = cell("pads=0.05@0"), controller()
    closings, helped, last = 0, [], 3.0
    for tick in range(4000):
        command = blocks.step(emulation.read())
        emulation.apply(command)
        emulation.advance(PERIOD)
        closings += last > 0 > command.volts[3]
        last = command.volts[3]
        if blocks.resource.read("SEQUENCE.HELP"):
            helped.append(tick)
    assert emulation.box_counts.picked == 0
    assert closings == 2
    assert helped
    assert helped == list(range(helped[0], 4000))


def test_faults_of_pads_need_contact() -> None:
    with pytest.raises(FaultError, match=r"pads\*=0\.5@3: the pads have friction in a cell with contact only"):
        cell("pads*=0.5@3", machine=Machine())
    with pytest.raises(FaultError, match="at least 0"):
        cell("pads=-1@3")


def test_equal_cells_are_equal_to_the_bit() -> None:
    first: list[tuple[Truth, Voltages]] = []
    second: list[tuple[Truth, Voltages]] = []
    run(cell(), 20.0, lambda c, v: first.append((c.truth(), v)))
    run(cell(), 20.0, lambda c, v: second.append((c.truth(), v)))
    assert first == second


Passed = tuple[Sensors, Truth, list[Event], BoxCounts, tuple[float, ...]]


def passed_of(cell: Emulation, command: Voltages) -> Passed:
    """What a tick under a command brings."""
    cell.apply(command)
    cell.advance(PERIOD)
    return cell.read(), cell.truth(), cell.drain_events(), cell.box_counts, cell.placement_errors_mm


def test_a_cell_goes_on_from_its_state_to_the_bit() -> None:
    first, blocks = cell("payload*=1.1@2", "pads*=0.9@17"), controller()
    passed: list[tuple[Voltages, Passed]] = []
    states = {}
    for tick in range(3600):
        if tick in (100, 1500, 1545, 1590, 1650, 1720, 2140, 2200, 2500):
            states[tick] = msgspec.msgpack.encode(first.state())
        command = blocks.step(first.read())
        passed.append((command, passed_of(first, command)))
    assert first.box_counts.delivered == 2
    for tick, state in states.items():
        other = cell("payload*=1.1@2", "pads*=0.9@17")
        other.restore(msgspec.msgpack.decode(state, type=EmulationState))
        for command, expected in passed[tick : tick + COURSE]:
            assert passed_of(other, command) == expected, f"from tick {tick}"


def test_a_state_fits_only_a_cell_of_its_kind() -> None:
    with pytest.raises(ParameterError, match="with or without contact"):
        cell(machine=Machine()).restore(cell().state())


def test_a_fallen_arm_touches_the_belt_and_it_is_said_once() -> None:
    emulation = Emulation(machine=MACHINE, seed=0, theta=(0.0, 0.0, 0.0))
    events = []
    for _ in range(300):
        emulation.advance(PERIOD)
        events += emulation.drain_events()
    touched = [event.text for event in events if event.kind == EventKind.COLLISION]
    assert touched
    assert any("conveyor" in text for text in touched)
    assert emulation._plant.tip()[1] > -0.35


def test_every_place_has_a_tray_beneath_it() -> None:
    emulation = cell()
    bodies = emulation._plant.bodies
    assert bodies is not None
    for index, place in enumerate(PLACES.values()):
        bodies.put(index, (place.x, 0.0, place.y), 0.2)
    for _ in range(100):
        emulation._plant.advance(PERIOD)
    for index, place in enumerate(PLACES.values()):
        x, y, z = bodies.position(index)
        assert (x, y) == pytest.approx((place.x, 0.0), abs=5e-4)
        assert 0.002 < place.y - z < 0.003
