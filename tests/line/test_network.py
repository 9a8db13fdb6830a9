"""Lines for measurements: wide ones, and ones on hosts that can be cut off."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from dtwin.line.control import Control, OneResource
from dtwin.line.file import line_of
from dtwin.line.floor import check_boxes
from dtwin.line.plant import Plant
from dtwin.line.station import TimedStation, WorkTimes
from evidence.line.network import Relay
from evidence.line.outages import outages
from evidence.line.scale import Scale, routers
from evidence.line.wide import MOST, STATIONS, wide_line
from tests.support.waiting import until

PLACES = ("blue", "red", "green")


@pytest.mark.parametrize(
    "zones",
    [pytest.param(zones, marks=() if zones in (1, MOST) else pytest.mark.thorough) for zones in range(1, MOST + 1)],
)
def test_boxes_pass_a_wide_line(zones: int, tmp_path: Path) -> None:
    file = tmp_path / "wide.toml"
    file.write_text(wide_line(zones))
    line = line_of(str(file))
    assert len(line.stations) == STATIONS * zones
    times = WorkTimes(0.5, dict.fromkeys(PLACES, 2.8), dict.fromkeys(PLACES, 2.3))
    plant = Plant(line, {station.name: TimedStation(times) for station in line.stations})
    control = Control(line, OneResource(line))
    control.set_up(line.assignment)
    for _ in range(3000):
        plant.advance()
        control.step(plant)
    check_boxes(plant)
    assert plant.left
    assert (plant.lost, plant.collisions) == (0, 0)


@pytest.fixture
def echo() -> Iterator[tuple[Relay, socket.socket]]:
    """A relay, and the server to which it leads."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        relay = Relay(server.getsockname()[1])
        yield relay, server
        relay.close()


def test_a_link_passes_everything_until_it_is_cut(echo: tuple[Relay, socket.socket]) -> None:
    relay, server = echo
    near = socket.create_connection(("127.0.0.1", relay.port))
    far, _ = server.accept()
    with near, far:
        near.sendall(b"there")
        assert far.recv(100) == b"there"
        far.sendall(b"and back")
        assert near.recv(100) == b"and back"
        relay.cut()
        assert not far.recv(100)
        assert not near.recv(100)
    relay.mend()
    with socket.create_connection(("127.0.0.1", relay.port)) as again:
        far, _ = server.accept()
        with far:
            again.sendall(b"anew")
            assert far.recv(100) == b"anew"


def test_nothing_passes_while_a_link_is_cut(echo: tuple[Relay, socket.socket]) -> None:
    relay, _ = echo
    relay.cut()

    def refused() -> bool:
        with socket.create_connection(("127.0.0.1", relay.port)) as near:
            near.settimeout(10.0)
            try:
                return not near.recv(1)
            except ConnectionError:
                return True

    until(refused, "the connection ends")


def test_a_thousand_arms_take_as_many_routers_as_their_messages() -> None:
    scale = Scale(arms=16, seconds=1.0, late=0.0, messages=1600.0, bytes=1.0, flooded=50_000.0, row=40.0)
    assert routers(scale) == 4, "100,000 messages a second, 25,000 for each router"


@pytest.mark.thorough
def test_twins_that_are_ended_frozen_or_cut_off_come_back_and_agree() -> None:
    found = outages("default", 4, 3)
    assert [each for each in found if not each.kept] == []
