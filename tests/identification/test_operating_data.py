"""Data from the traffic of a cell at work, and what has changed of a known arm."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from dtwin.bus.ticks import APART, Tick
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.errors import IdentificationError
from dtwin.identification.operating_data import MEMORY, PIECE, PIECES, OperatingData
from dtwin.identification.running import estimate_from, renewed
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.signals import Sensors, Voltages

SHEET = ArmParameters()
ERRORS = {"D1": 1e-4, "D3": 1e-4}
FAULT = 20.0


@pytest.fixture(scope="module")
def traffic() -> list[tuple[Sensors, Voltages]]:
    """40 s of a cell in which the friction of joint 2 grows."""
    emulation = Emulation(seed=1, noise=0.002, faults=[parse_fault(f"D2*=1.6@{FAULT}")])
    controller = EmbeddedController()
    passed = []
    for _ in range(4000):
        sensors = emulation.read()
        command = controller.step(sensors)
        passed.append((sensors, command))
        emulation.apply(command)
        emulation.advance(PERIOD)
    return passed


def heard(ticks: Iterable[Tick]) -> OperatingData:
    data = OperatingData()
    for tick in ticks:
        data.extend([tick])
    return data


def test_pieces_are_empty_moving_and_whole(traffic: list[tuple[Sensors, Voltages]]) -> None:
    by_time = {sensors.theta: (sensors, command) for sensors, command in traffic}
    pieces = heard(traffic).pieces(5.0)
    assert len(pieces) >= PIECES
    for piece in pieces:
        ticks = [by_time[tuple(row)] for row in piece.measured.tolist()]
        numbers = [sensors.sequence for sensors, _ in ticks]
        assert numbers == list(range(numbers[0], numbers[0] + PIECE))
        assert ticks[0][0].time >= 5.0
        assert not any(command.box_gripped for _, command in ticks)
        assert np.ptp(piece.measured, axis=0).max() > 0.1
        assert [tuple(row) for row in piece.volts.tolist()] == [command.volts[:3] for _, command in ticks]


def test_gaps_part_pieces_and_ticks_may_come_together(traffic: list[tuple[Sensors, Voltages]]) -> None:
    together = OperatingData()
    together.extend(traffic)
    assert [p.fingerprint for p in together.pieces(0.0)] == [p.fingerprint for p in heard(traffic).pieces(0.0)]
    assert heard(tick for k, tick in enumerate(traffic) if k % (PIECE - 1)).pieces(0.0) == []


def test_memory_is_bounded_and_ends_with_the_run(traffic: list[tuple[Sensors, Voltages]]) -> None:
    data = heard(traffic)
    data.extend(traffic[:1])
    assert data.pieces(0.0) == []
    long = OperatingData()
    for number in range(MEMORY + 2 * APART):
        sensors = Sensors(number, number * PERIOD, (0.01 * number, 0.0, 0.0), 0.9, False, "none")
        long.extend([(sensors, Voltages(number, number * PERIOD, (0.0, 0.0, 0.0, 0.0), False))])
    assert len(long.pieces(0.0)) == MEMORY // PIECE


def test_grown_friction_is_found_in_motion_at_work(traffic: list[tuple[Sensors, Voltages]]) -> None:
    pieces = heard(traffic).pieces(FAULT)
    settings = renewed(SHEET, ERRORS, ("D1", "D2", "D3"), ("D2",))
    assert settings.free == ("D1", "D2", "D3")
    assert settings.priors["D1"].mean == SHEET.get("D1")
    estimate, model = estimate_from(pieces[:PIECES], settings, "test")
    assert estimate.converged
    assert model.arm.get("D2") == pytest.approx(1.6 * SHEET.get("D2"), rel=0.01)
    assert abs(model.arm.get("D2") - 1.6 * SHEET.get("D2")) < 4.5 * model.standard_errors["D2"]
    assert min(model.validity.fit) > 0.9
    before = heard(tick for tick in traffic if tick[0].time < FAULT).pieces(0.0)
    healthy, _ = estimate_from(before, settings, "test")
    assert abs(healthy.values["D2"] - SHEET.get("D2")) < 4.5 * healthy.standard_errors["D2"]


def test_what_is_not_known_to_be_uncertain_stays_fixed() -> None:
    assert renewed(SHEET, ERRORS, ("D1", "D2", "D3", "K1"), ("D2",)).free == ("D1", "D2", "D3")
    assert renewed(SHEET, {}, ("D1", "D2"), ()).free == ("D1", "D2")
    assert renewed(SHEET, {}, ("D1", "D2"), ()).priors == {}
    with pytest.raises(IdentificationError, match="--anew K1: expected some of the free parameters, D1, D2"):
        renewed(SHEET, {}, ("D1", "D2"), ("K1",))
    with pytest.raises(IdentificationError, match="expected at least 3 pieces of motion, got 0"):
        estimate_from([], renewed(SHEET, {}, ("D1",), ()), "test")
