"""An arm that has fallen for a while: the blocks catch it with the velocity that it has."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, cast

import pytest

from dtwin.controller.device import ControlLoop
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.parameters import PERIOD
from dtwin.run.options import ControlOptions
from dtwin.services.parts.recent import Recent
from dtwin.services.parts.strides import strides
from dtwin.signals import Sensors, Voltages
from iec61499.net.client import BlockingClient

STOP = "TWIN.MONITORING.DECISION.STOP"
LATE = 5


class Here(ControlLoop):
    """A control loop over the blocks in this process."""

    def __init__(self, blocks: EmbeddedController) -> None:
        self.blocks = blocks

    def answer(self, sensors: Sensors) -> Voltages:
        return self.blocks.step(sensors)

    @contextmanager
    def _requests(self) -> Iterator[BlockingClient]:
        yield cast(BlockingClient, self)

    def exchange(self, values: Sequence[Any]) -> None:
        self.blocks.resource.port("TWIN.IDENTIFICATION.REQUEST").deliver(tuple(values))


@pytest.mark.parametrize(
    ("seed", "worked", "fell"),
    [
        (784, 884, 46),
        (964, 993, 33),
        (511, 1601, 14),
        (572, 1356, 20),
        (425, 997, 25),
        (63, 1481, 159),
        (562, 869, 236),
        (245, 1120, 199),
    ],
)
def test_an_arm_that_falls_is_caught_without_a_stop(seed: int, worked: int, fell: int) -> None:
    """Without its velocity, too early, or led in long strides, it would leave its path, which stops it for good."""
    emulation, loop, recent = Emulation(seed=seed), Here(EmbeddedController(ControlOptions().control())), Recent()

    def obey(command: Voltages) -> None:
        emulation.apply(command)
        emulation.advance(PERIOD)

    for _ in range(worked):
        before = emulation.read()
        recent.add(before)
        command = loop.answer(before)
        obey(command)
    for tick in range(LATE + fell + 1000):
        now = emulation.read()
        recent.add(now)
        if tick >= LATE + fell and not recent.falls():
            break
        limp = Voltages(now.sequence, now.time, (0.0, 0.0, 0.0, 0.0), command.box_gripped)
        obey(command if tick < LATE else limp)
    loop.restart(strides(before, recent.samples[0]), list(recent.samples))
    for _ in range(300):
        obey(loop.answer(emulation.read()))
        assert loop.blocks.resource.read(STOP) == 0
