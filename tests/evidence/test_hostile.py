"""A small part of what `dtwin fb fuzz` sends."""

from __future__ import annotations

import random
from pathlib import Path

from evidence.hostile.inputs import Inputs
from evidence.hostile.trial import fuzz


def test_the_inputs_of_a_seed_are_the_same_every_time() -> None:
    first, second = Inputs(random.Random(5)), Inputs(random.Random(5))
    assert [first.request() for _ in range(200)] == [second.request() for _ in range(200)]
    assert [first.datagram() for _ in range(200)] == [second.datagram() for _ in range(200)]


def test_a_device_survives_mutated_input(tmp_path: Path) -> None:
    outcome = fuzz(2000, 1000, 7, tmp_path / "device.log", lambda number: None)
    assert outcome.answered == 2000
    assert outcome.growth < 20e6
    assert outcome.lines <= 100
    assert outcome.ticks > 0
