"""A line whose messages are lost and whose devices begin anew: no zone is left standing, no box leaves unfinished."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import pytest

from dtwin.line.control import Control, OneResource
from dtwin.line.file import line_of
from dtwin.line.plant import Plant
from dtwin.line.station import TimedStation, WorkTimes
from dtwin.line.system import plant_of, system
from evidence.line.kills import at_ports
from evidence.line.losses import LossOutcome, LossTrial, _Run, _trouble, troubled
from evidence.line.timed import TimedLine
from evidence.line.troubled import Message, TroubledDevices
from iec61499.mapping import management_address

LINE = line_of("default")
TIMES = WorkTimes(0.5, dict.fromkeys(("blue", "red", "green"), 2.8), dict.fromkeys(("blue", "red", "green"), 2.3))


def begun(seconds: float) -> _Run:
    run = _Run(LINE, np.random.default_rng(1))
    run.work(seconds)
    return run


def goes_on(run: _Run, seconds: float, least: int) -> None:
    before, plant = len(run.plant.left), run.plant
    run.work(seconds)
    assert len(plant.left) - before >= least
    assert (plant.lost, plant.collisions, plant.unfinished) == (0, 0, 0)


def several(first: int, count: int) -> range:
    return range(first, first + count)


def busiest(devices: TroubledDevices) -> str:
    return next(name for name in devices.names if name.startswith("ZONE"))


@pytest.mark.parametrize("seconds", [44.0, pytest.param(52.0, marks=pytest.mark.thorough), 63.0])
def test_an_order_that_is_lost_is_told_again(seconds: float) -> None:
    run = begun(seconds)
    run.devices.messages.trouble, run.devices.messages.share = "lost", 0.5
    run.work(4.0)
    run.devices.messages.well()
    goes_on(run, 120.0, 3)


def test_a_zone_that_begins_anew_learns_from_vehicles_which_boxes_they_have() -> None:
    run = begun(40.0)
    zone = busiest(run.devices)
    while not run.plant.vehicles["a_agv1"].box:
        run.work(0.1)
    for _ in range(2):
        run.devices.end(zone)
        run.work(1.0)
        run.devices.begin(zone)
        run.work(7.0)
    goes_on(run, 120.0, 3)


@pytest.mark.parametrize(("device", "seconds"), [("VEHICLES_B", 56.0), ("VEHICLES_A", 45.0)])  # with boxes in them
def test_vehicles_whose_control_begins_anew_bring_their_boxes_where_they_belong(device: str, seconds: float) -> None:
    run = begun(seconds)
    run.devices.end(device)
    run.work(1.0)
    run.devices.begin(device)
    goes_on(run, 100.0, 3)


def test_a_zone_that_begins_anew_between_two_samples_is_set_up_again() -> None:
    run = begun(60.0)
    zone = busiest(run.devices)
    run.devices.end(zone)
    run.devices.begin(zone)
    assert not run.control.absent
    goes_on(run, 100.0, 3)


class Belated(OneResource):
    """Blocks whose answers to vehicles are those to the sample before."""

    def __init__(self) -> None:
        super().__init__(LINE)
        self._before: dict[str, tuple[Any, ...]] = {}
        self._vehicles = {plant_of(vehicle.name) for zone in LINE.zones for vehicle in zone.vehicles}

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        answer = super().exchange(block, values)
        if block not in self._vehicles:
            return answer
        before, self._before[block] = self._before.get(block, answer), answer
        return before


@pytest.mark.parametrize(("blocks", "stands"), [(Belated, True), (partial(OneResource, LINE), False)])
def test_a_vehicle_takes_no_node_of_an_answer_to_an_earlier_sample(
    blocks: type[Belated] | partial[OneResource], stands: bool
) -> None:
    plant = Plant(LINE, {station.name: TimedStation(TIMES) for station in LINE.stations})
    control = Control(LINE, blocks())
    control.set_up(LINE.assignment)
    for _ in range(100):
        plant.advance()
        control.step(plant)
    assert all(vehicle.driven == 0.0 for vehicle in plant.vehicles.values()) == stands


def test_a_plant_that_begins_anew_goes_on_with_blocks_that_have_heard_later_samples() -> None:
    run = begun(90.0)
    devices = run.devices
    anew = TimedLine(LINE, devices, dict.fromkeys((station.name for station in LINE.stations), TIMES))
    anew.work(150.0)
    assert len(anew.plant.left) >= 3
    assert (anew.plant.lost, anew.plant.collisions, anew.plant.unfinished) == (0, 0, 0)


def test_devices_that_begin_anew_drop_what_was_told_before() -> None:
    outcome = troubled(LossTrial("default", 501, 3, together=True))
    assert all(" messages " in told for told in outcome.told)
    assert outcome.kept


def test_a_message_that_differs_from_the_last_one_by_its_number_alone_is_no_news() -> None:
    run = _Run(LINE, np.random.default_rng(0))
    messages = run.devices.messages
    port = next(port for port in run.devices._opened["STATION_A1"] if port.name.startswith("FROM_"))
    before, counted = messages.news, []
    for number, mask in ((1, 3), (2, 3), (3, 1), (3, 3)):
        messages.send(Message("STATION_A1", port, (number, mask)))
        counted.append(messages.news - before)
    assert counted == [1, 1, 2, 3]


def test_equal_seeds_give_equal_troubles() -> None:
    told = []
    for _ in range(2):
        generator = np.random.default_rng(12)
        run = _Run(LINE, generator)
        told.append([_trouble(run, generator) for _ in range(3)] + run.plant.drain())
    assert told[0] == told[1]


def test_boxes_go_on_leaving_after_drawn_troubles() -> None:
    outcome = troubled(LossTrial("default", 3, 1))
    assert outcome.told
    assert outcome.kept


def test_a_line_that_stands_or_loses_something_is_not_kept() -> None:
    trial = LossTrial("default", 0, 6)
    assert LossOutcome(trial, 8, 0, 0, 0).kept
    for spoiled in ((3, 0, 0, 0), (8, 1, 0, 0), (8, 0, 1, 0), (8, 0, 0, 1)):
        assert not LossOutcome(trial, *spoiled).kept


def test_lines_at_ports_of_their_own_are_at_addresses_of_their_own() -> None:
    hosts = []
    for first in (40000, 40300):
        whole = at_ports(system(LINE), partial(several, first))
        hosts.append({management_address(device).rpartition(":")[0] for device in whole.devices})
    assert [len(each) for each in hosts] == [1, 1]
    assert hosts[0] != hosts[1]
