"""ENCODER_OFFSET, and the application that takes known offsets off the angles."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import OFFSETS
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.emulation.faults import parse_fault
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.signals import Sensors, Voltages
from tests.support.driven import Driven, triple

RAMP = 0.0002
angles = st.lists(st.floats(-4, 4), min_size=3, max_size=3)
offsets = st.lists(st.floats(-0.01, 0.01), min_size=3, max_size=3)
BIASED = (0.01, -0.02, 0.015)
CONTROL = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")


def taken(block: Driven, theta: list[float], offset: list[float]) -> list[float]:
    assert block.fire("REQ", **triple("THETA", theta), **triple("OFFSET", offset)) == ["CNF"]
    return [a - angle for a, angle in zip(theta, block.triple("ANGLE").tolist(), strict=True)]


@given(angles)
def test_no_offset_leaves_every_bit(theta: list[float]) -> None:
    block = Driven("ENCODER_OFFSET")
    for _ in range(3):
        block.fire("REQ", **triple("THETA", theta))
        assert block.triple("ANGLE").tolist() == theta


@given(offsets, offsets)
def test_an_offset_counts_at_once_at_first_and_by_small_steps_later(first: list[float], then: list[float]) -> None:
    block, zero = Driven("ENCODER_OFFSET"), [0.0, 0.0, 0.0]
    before = taken(block, zero, first)
    assert before == first
    for _ in range(101):
        now = taken(block, zero, then)
        assert max(abs(a - b) for a, b in zip(now, before, strict=True)) <= RAMP * (1 + 1e-9)
        before = now
    assert before == then


def test_an_arm_with_known_offsets_moves_as_one_without() -> None:
    settings = CellSettings(duration=40.0, seed=3, control=CONTROL)
    healthy = Cell(settings)
    healthy.run()
    faults = tuple(parse_fault(f"bias{joint}+={offset}@0") for joint, offset in enumerate(BIASED, 1))
    biased = Cell(replace(settings, faults=faults, control=replace(CONTROL, encoder_offset=BIASED)))
    biased.run()
    apart = np.abs(healthy.log.freeze().stack("theta") - biased.log.freeze().stack("theta")).max()
    assert apart < 1e-9


class Later:
    """A controller that gets offsets at a plant time (s)."""

    def __init__(self, time: float) -> None:
        self._controller = EmbeddedController(CONTROL)
        self._time = time
        self.target, self.drain_events = self._controller.target, self._controller.drain_events

    def step(self, sensors: Sensors) -> Voltages:
        if math.isclose(sensors.time, self._time):
            EmbeddedPort(self._controller).put(OFFSETS, ControlSettings(encoder_offset=BIASED))
        return self._controller.step(sensors)


def test_offsets_that_come_later_move_the_voltages_by_little() -> None:
    volts = {}
    for time in (10.0, 1000.0):
        cell = Cell(CellSettings(duration=12.0, seed=3, control=CONTROL), Later(time))
        cell.run()
        volts[time] = cell.log.freeze().stack("volts")[:, :3]
    steps = np.abs(np.diff(volts[10.0] - volts[1000.0], axis=0)).max(axis=1)
    assert 0.0 < steps.max() < 0.2
