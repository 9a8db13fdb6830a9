"""Peers that do not belong to the cell: they ask for everything, drive the arm, and tell what is not so."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Final

from dtwin.bus.messages import EVENTS, SENSORS, VOLTAGES
from dtwin.bus.opening import open_configured
from dtwin.bus.session import Bus
from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.signals import Event, EventKind, Sensors, Voltages
from evidence.soak.cell import TroubledCell

HOSTILE: Final = 5.0
"""s for which a stranger speaks"""
OBEYED: Final = 10.0
"""Speed of a joint that tells that the arm has obeyed a stranger, rad/s: its paths stay below half of it, and from
hanging one tick of full voltage makes 26 rad/s."""
_STRANGER: Final = "service"
"""name of the stranger's configuration file, which is everybody's"""


def ask_for_everything(cell: TroubledCell) -> str:
    """Queries all keys at once, with and without a message: nothing may act on it."""
    ticks = cell.summary().ticks
    session = open_configured(cell.folder, _STRANGER)
    try:
        for payload in (b"", b'{"schema":1,"seed":1}', b'{"schema":1,"who":"soak","why":"no"}'):
            list(session.get("dtwin/**", payload=payload, timeout=HOSTILE))
    finally:
        session.close()
    return "started anew" if cell.summary().ticks < ticks else ""


def answer_first(cell: TroubledCell) -> str:
    """Answers every sample with full voltage before the bridge can: the arm may not obey."""
    heard: list[Sensors] = []
    with _stranger(cell) as stranger:
        publish = stranger.publisher(VOLTAGES)
        volts = (VOLTAGE_LIMIT, -VOLTAGE_LIMIT, VOLTAGE_LIMIT, 0.0)

        def answer(sensors: Sensors) -> None:
            publish(Voltages(sensors.sequence, sensors.time, volts, False))
            heard.append(sensors)

        stranger.subscribe(SENSORS, Sensors, answer)
        time.sleep(HOSTILE)
    fastest = max((_speed(before, after) for before, after in pairwise(heard)), default=math.inf)
    return "" if fastest < OBEYED else f"a joint moves at {fastest:.3g} rad/s"


def _speed(before: Sensors, after: Sensors) -> float:
    """Mean speed of the fastest joint between two samples, rad/s; 0 when the cell has begun anew between them."""
    ahead = max(abs(b - a) for a, b in zip(before.theta, after.theta, strict=True))
    return ahead / (after.time - before.time) if after.time > before.time else 0.0


def cry_wolf(cell: TroubledCell) -> str:
    """Says over and over that the arm has no voltage, and makes up samples of the far future."""
    over = threading.Event()
    with _stranger(cell) as stranger:
        tell, sense = stranger.publisher(EVENTS), stranger.publisher(SENSORS)
        began = time.monotonic()
        while time.monotonic() - began < HOSTILE:
            plant = cell.summary().ticks * 0.01
            tell(Event(plant, EventKind.SAFE, "made up"))
            sense(Sensors(10**12, 1e10, (0.0, 0.0, 0.0), 0.9, False, ""))
            over.wait(0.05)
    return ""


@contextmanager
def _stranger(cell: TroubledCell) -> Iterator[Bus]:
    """A session that has joined the cell and does not know its key."""
    with Bus(open_configured(cell.folder, _STRANGER), cell.name) as bus:
        yield bus
