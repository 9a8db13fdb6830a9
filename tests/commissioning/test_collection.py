"""A log of a running cell, put together from its bus."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from dtwin.bus.messages import ACTED, SENSORS, VOLTAGES, Acted
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.commissioning.collection import Collection, collect
from dtwin.errors import CommunicationError
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Voltages
from tests.support.ports import free_port


def sample(number: int) -> Sensors:
    return Sensors(number, round(number * PERIOD, 2), (0.001 * number, -1.0, 0.5), 0.9, True, "red")


def command(number: int, volts: float = 1.0) -> Voltages:
    return Voltages(number, round(number * PERIOD, 2), (volts, 2.0, 3.0, 4.0), number % 2 == 0)


def test_a_row_has_the_sample_and_what_acted_after_it() -> None:
    rows = Collection()
    for number in range(10, 15):
        rows.add(sample(number))
        rows.add(command(number))
        if number == 12:
            rows.add(Acted(12, 0.12, (0.0, 0.0, 0.0, 0.0), False))
    log = rows.log()
    assert log.columns["t"].tolist() == pytest.approx([0.10, 0.11, 0.12, 0.13])
    assert log.columns["volts_1"].tolist() == [1.0, 1.0, 0.0, 1.0]
    assert log.columns["box_gripped"].tolist() == [True, False, False, False]
    assert log.columns["measured_1"].tolist() == pytest.approx([0.010, 0.011, 0.012, 0.013])
    assert log.columns["box_colour"].tolist() == ["red"] * 4
    assert np.isnan(log.stack("theta")).all()


def test_another_run_of_the_cell_begins_the_rows_anew() -> None:
    rows = Collection()
    for number in (*range(50, 60), *range(5)):
        rows.add(sample(number))
        rows.add(command(number))
    assert rows.log().columns["t"].tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03])


@pytest.fixture
def buses() -> Iterator[tuple[Bus, Bus]]:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet), "cell") as cell, Bus(open_peer(meet), "cell") as operator:
        yield cell, operator


def test_what_passes_on_the_bus_is_collected(buses: tuple[Bus, Bus]) -> None:
    cell, operator = buses
    over = threading.Event()
    publish, answer = cell.publisher(SENSORS, lossless=True), cell.publisher(VOLTAGES, lossless=True)
    cell.publisher(ACTED)

    def work() -> None:
        number = 0
        while not over.is_set():
            publish(sample(number))
            answer(command(number))
            number += 1
            over.wait(0.001)

    told: list[float] = []
    worker = threading.Thread(target=work)
    worker.start()
    try:
        log = collect(operator, 2.0, told.append)
    finally:
        over.set()
        worker.join()
    assert len(log) >= 200
    assert told[:2] == [1.0, 2.0]
    assert log.columns["measured_1"].tolist() == pytest.approx((0.1 * log.columns["t"]).tolist())
    assert set(log.columns["volts_4"].tolist()) == {4.0}


def test_a_cell_that_says_nothing_is_told(buses: tuple[Bus, Bus]) -> None:
    with pytest.raises(CommunicationError, match=r"nothing has come from the cell for 0\.05 s: does it run\?"):
        collect(buses[1], 1.0, lambda done: None, patience=0.05)
